"""Metrics: what is estimated, what is counted, and what differs from the paper."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.details import details
from smartplay_tools.evaluation.analysis.grouping import by_cell, conditions
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.pairs import completion
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.analysis.tables import cell_rows
from smartplay_tools.providers.prices import Price
from tests.evaluation.players import act
from tests.evaluation.runs import failed_row, play_row, play_rows

BANDIT, RPS, HANOI = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"


def cell_summary(rows):
    (summary,) = summarize(rows).cells
    return summary


# How well it plays.


def test_means_are_over_episodes():
    rows = play_rows(BANDIT, "random", trials=5)
    summary = cell_summary(rows)
    scores = [row["score"] for row in rows]
    assert summary.episodes == summary.score.episodes == 5
    assert summary.score.mean == pytest.approx(sum(scores) / 5)
    assert 0 <= summary.score.low < summary.score.mean < summary.score.high <= 50
    assert summary.normalized_score.mean == pytest.approx(summary.score.mean / 45)
    assert summary.reward.mean == pytest.approx(sum(row["reward"] for row in rows) / 5)


def test_completion_is_a_figure_of_games_with_an_objective():
    assert cell_summary(play_rows(HANOI, trials=2)).completion.mean == 1
    games = {spec.family: {"game": spec.id, "completed": True} for spec in sp.GAMES.values()}
    with_objective = {family for family, row in games.items() if completion(row) is not None}
    assert with_objective == {"hanoi", "messenger", "minecraft", "lockers"}


def test_the_order_of_rows_changes_no_figure():
    rows = play_rows(RPS, "random", trials=6)
    assert summarize(rows[::-1]).cells == summarize(rows).cells


# What is counted.


def test_mistakes_ends_and_tokens_are_added_up():
    idle = {"role": "assistant", "content": "Hm."}
    broken = act("Rock")
    broken["tool_calls"][0]["function"]["arguments"] = "{"
    clumsy = sp.ScriptedPlayer([act("Well"), broken, act("Rock"), idle, idle, idle])
    quitter = sp.ScriptedPlayer([idle, idle, idle])
    rows = [play_row(RPS, clumsy, trial=0), play_row(RPS, quitter, trial=1)]
    summary = cell_summary(rows)
    assert summary.counts["illegal_actions"] == 1
    assert summary.counts["malformed_calls"] == 1
    assert summary.counts["idle_replies"] == 6
    assert summary.counts["steps"] == 1
    assert summary.end_reasons == {"no_tool_call": 2}
    assert summary.tokens.prompt == sum(row["tokens"]["prompt"] for row in rows)
    assert 0 < summary.tokens.prefix_share < 1


def test_fallbacks_of_the_papers_protocol_are_counted():
    mumbling = sp.ScriptedPlayer([{"role": "assistant", "content": "Hm."}] * 100)
    summary = cell_summary([play_row(BANDIT, mumbling, protocol="paper")])
    assert summary.counts["fallback_actions"] == 50


def test_drift_is_told_for_episodes_whose_provider_told_its_count():
    usage = sp.Usage(prompt=1000, reply=10, requests=2)
    with_usage = sp.ScriptedPlayer([act("Rock")] * 50, usage)
    without = sp.ScriptedPlayer([act("Rock")] * 50)
    asked_only = sp.ScriptedPlayer([act("Rock")] * 50, sp.Usage(requests=2))
    rows = [play_row(RPS, player, trial) for trial, player in enumerate((with_usage, without, asked_only))]
    tokens = cell_summary(rows).tokens
    assert tokens.requests == 200
    assert tokens.prompt_drift.episodes == 1
    assert tokens.prompt_drift.provider == 50_000
    assert tokens.prompt_drift.ours == rows[0]["tokens"]["prompt"]
    assert tokens.prompt_drift.difference == 50_000 - rows[0]["tokens"]["prompt"]
    assert tokens.reply_drift.ratio == pytest.approx(500 / rows[0]["tokens"]["reply"])
    assert cell_summary(rows[1:]).tokens.prompt_drift is None
    assert cell_summary(rows[1:]).tokens.requests == 100


def test_cost_is_a_sum_and_unknown_as_soon_as_one_price_is():
    rock, usage = [act("Rock")] * 50, sp.Usage(prompt=1_000, reply=10)
    priced = [play_row(RPS, sp.ScriptedPlayer(rock, usage), trial, price=Price.per_million(2, 10)) for trial in (0, 1)]
    unpriced = play_row(RPS, sp.ScriptedPlayer(rock, usage), 2)
    assert cell_summary(priced).cost == pytest.approx(2 * 50 * (1_000 * 2 + 10 * 10) / 1_000_000)
    assert cell_summary([*priced, unpriced]).cost is None
    assert cell_summary(play_rows(HANOI, trials=3)).cost == 0


def test_failures_are_counted_apart():
    failing = sp.ScriptedPlayer([act("Rock")])
    failed = failed_row(play_row(RPS, failing))
    assert failed["end_reason"] == "player_error"
    rows = play_rows(RPS, trials=2)
    summary = summarize(rows, [failed, {**failed, "attempt": 2}])
    assert summary.cells == summarize(rows).cells
    (failures,) = summary.failures
    assert (failures.game, failures.player, failures.attempts, failures.missing) == (RPS, "scripted", 2, 1)
    assert failures.reasons == {"player_error": 2}
    assert "StopIteration" in failures.last_error
    interrupted = {**failed_row(rows[0]), "end_reason": "interrupted", "error": None}
    (failures,) = summarize(rows, [interrupted]).failures
    assert (failures.attempts, failures.missing, failures.last_error) == (1, 0, None), "a later attempt finished it"


# Deviations from the paper.


def test_every_deviation_is_told():
    budget = sp.Budget(history=2, prompt_tokens=2_000, tool_calls=20)
    deviations = cell_summary(play_rows(HANOI, trials=3, budget=budget)).deviations
    assert deviations == {
        "history": {"paper": 30, "played": 2},
        "protocol": {"paper": "paper", "played": "tools"},
        "manual": {"paper": "pinned", "played": "tool"},
        "batch": {"paper": "one action a prompt", "played": "all"},
        "prompt_tokens": {"paper": None, "played": 2_000},
        "result_tokens": {"paper": None, "played": deviations["result_tokens"]["played"]},
        "tool_calls": {"paper": None, "played": 20},
        "trials": {"paper": 10, "played": 3},
    }


# Cells and conditions.


@pytest.mark.parametrize(
    "asked",
    [
        {"player": "random"},
        {"protocol": "paper"},
        {"manual": "pinned"},
        {"batch": "first_act"},
        {"budget": sp.Budget(history=3)},
        {"budget": sp.Budget(slack=0.5)},
        {"tokenizer": "approximate"},
    ],
    ids=str,
)
def test_whatever_was_asked_for_makes_a_cell(asked):
    rows = [*play_rows(HANOI, trials=2), *play_rows(HANOI, **{"trials": 2, **asked})]
    assert [len(members) for _, members in by_cell(rows)] == [2, 2]


def condition_cells(*rows):
    return [
        (c.player, c.label, [cell.game for cell in c.cells]) for c in conditions([cell for cell, _ in by_cell(rows)])
    ]


def test_the_papers_numbers_are_one_condition():
    rows = [play_row(game) for game in (BANDIT, HANOI, "MessengerL1-v0")]
    assert condition_cells(*rows) == [("rule", "", [BANDIT, HANOI, "MessengerL1-v0"])]


def test_a_budget_is_named_as_it_was_asked_for_even_where_the_number_is_the_papers():
    (alone,) = condition_cells(play_row(HANOI, budget=sp.Budget(history=30)))
    assert alone == ("rule", "history 30", [HANOI])
    swept = [play_row(g, budget=sp.Budget(history=h)) for g in (BANDIT, HANOI) for h in (5, 30)]
    assert condition_cells(*swept) == [
        ("rule", "history 5", [BANDIT, HANOI]),
        ("rule", "history 30", [BANDIT, HANOI]),
    ]
    both = [play_row(g, budget=sp.Budget(history=h)) for g in (BANDIT, HANOI) for h in (30, "game")]
    assert condition_cells(*both) == [("rule", "history 30", [BANDIT, HANOI]), ("rule", "", [BANDIT, HANOI])]


def test_caps_and_rules_are_part_of_a_condition():
    budget = sp.Budget(prompt_tokens=2_000, slack=0.5)
    rows = [play_row(game, budget=budget, manual="pinned") for game in (BANDIT, HANOI)]
    label = "prompts <= 2,000, slack 0.5, manual pinned"
    assert condition_cells(*rows) == [("rule", label, [BANDIT, HANOI])]
    capped = [play_row(game, budget=sp.Budget(prompt_tokens=2_000, result_tokens=100)) for game in (BANDIT, HANOI)]
    assert condition_cells(*capped) == [("rule", "prompts <= 2,000, results <= 100", [BANDIT, HANOI])]


def test_a_game_that_was_played_in_two_ways_splits_its_condition():
    plain, corrected = play_row("MessengerL1-v0"), play_row("MessengerL1-v0", options={"text": "corrected"})
    assert condition_cells(play_row(HANOI), plain, corrected) == [
        ("rule", "no options", [HANOI, "MessengerL1-v0"]),
        ("rule", "text=corrected", [HANOI, "MessengerL1-v0"]),
    ]


def test_a_player_with_two_sets_of_options_is_told_apart_everywhere():
    row = play_row(HANOI)
    warm, cold = ({**row, "player_options": {"parameters": {"temperature": t, "top_p": 1}, "n": 1}} for t in (1, 0))
    summary = summarize([warm, cold])
    named = ['rule, parameters={"temperature":1,"top_p":1}', 'rule, parameters={"temperature":0,"top_p":1}']
    assert [line[0].strip() for line in headline(summary).rows[1:]] == named
    assert [f"rule, {each['condition']}" for each in cell_rows(summary)] == named
    assert [column.heading for column in next(t for t in details(summary) if "capab" in t.title).columns[1:]] == named
    compared = comparison_tables(compare({"run": [warm, cold]}))[0]
    assert [line[0].strip() for line in compared.rows[1:]] == named


# Profiles.


def test_every_player_has_a_profile():
    rows = [row for player in ("random", "rule") for game in (BANDIT, HANOI) for row in play_rows(game, player)]
    random, rule = summarize(rows).profiles
    assert (random.condition.player, rule.condition.player) == ("random", "rule")
    scores = {score.capability: score.estimate.mean for score in rule.capabilities.scores}
    cells = {c.cell.game: c.normalized_score.mean for c in summarize(rows).cells if c.cell.player == "rule"}
    assert scores["planning"] == pytest.approx((cells[BANDIT] + 3 * cells[HANOI]) / 4)
