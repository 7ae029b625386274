"""Caps on a whole run are never exceeded; paused episodes are not results, and continue with a higher cap."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.episode.cells import cell_config
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.run_folder.follower import run_snapshot
from smartplay_tools.evaluation.runs.plan import prices_in_tables
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.providers.prices import Price, find_price
from smartplay_tools.records.record import UNANSWERED, Record
from smartplay_tools.transcript.file import append_exception
from tests.evaluation.players import Metered, Uncounted, Wordy

BANDIT = "BanditTwoArmedHighLowFixed-v0"
BUDGET = sp.Budget(reply_tokens=100)


def spent(run: Run) -> int:
    """The tokens in all records of a run, counted independently."""
    total = 0
    for record in run.folder.records():
        total += sum(e["prompt"] + e["reply"] for e in sp.read_transcript(record) if e["event"] == "usage")
    return total


@pytest.fixture(scope="module")
def one_episode(tmp_path_factory) -> int:
    """Tokens that an episode of the random player takes at the bandit."""
    out = tmp_path_factory.mktemp("run")
    run = sp.evaluate([BANDIT], ["random"], out=out, trials=1, budgets=BUDGET, executor="inline")
    return run.spending.results.tokens


@pytest.mark.parametrize(
    ("executor", "workers"), [("inline", 1), ("async", 4), pytest.param("processes", 2, marks=pytest.mark.slow)]
)
def test_episodes_begin_only_while_a_cap_has_room_for_them(tmp_path, one_episode, executor, workers):
    cap = round(2.5 * one_episode)
    run = sp.evaluate(
        [BANDIT], ["random"], out=tmp_path, trials=4, budgets=BUDGET, run_tokens=cap, executor=executor, workers=workers
    )
    assert run.cap_reached
    assert 1.5 * one_episode < spent(run) <= cap
    assert [row["end_reason"] for row in run.rows] == ["rollout"] * 2
    assert run.failures == []


def test_a_cap_pauses_an_episode_that_takes_more_than_was_expected_and_a_higher_one_goes_on(tmp_path):
    """Its replies are longer than the estimate assumes, so the cap is reached in the middle of the episode."""
    arguments = {"games": [BANDIT], "players": {"wordy": Wordy}, "trials": 2, "executor": "inline"}
    whole = sp.evaluate(out=tmp_path / "whole", **arguments)
    cap = spent(whole) // 4
    paused = sp.evaluate(out=tmp_path / "run", run_tokens=cap, **arguments)
    assert paused.cap_reached
    assert paused.rows == []
    assert {failure["end_reason"] for failure in paused.failures} == {"run_budget"}
    assert paused.status.paused == 1
    assert 0.9 * cap < paused.spending.total.tokens
    again = sp.evaluate(out=tmp_path / "run", run_tokens=cap, **arguments)
    assert (again.rows, again.failures) == ([], paused.failures)
    more = sp.evaluate(out=tmp_path / "run", run_tokens=10_000_000, **arguments)
    assert more.complete
    assert not more.cap_reached
    results = (tmp_path / name / "results.jsonl" for name in ("whole", "run"))
    assert len({path.read_bytes() for path in results}) == 1


def test_a_cap_on_cost_counts_what_the_provider_counts_at_the_given_price(tmp_path):
    price = Price.per_million(10.0, 20.0, 1.0)
    call = (19_500 * 10 + 500 * 1 + 100 * 20) / 1e6
    run = sp.evaluate(
        [BANDIT],
        {"metered": Metered},
        out=tmp_path,
        trials=1,
        budgets=BUDGET,
        executor="inline",
        run_cost=20.5 * call,
        player_options={"prompt": 20_000},
        prices={"metered": price},
    )
    assert run.status.paused == 1
    total = run_snapshot(run.folder).spending.total
    assert total.cost == pytest.approx(total.replies * call)
    assert 0 < total.cost <= 20.5 * call


def test_where_a_provider_reports_no_tokens_a_known_price_is_that_of_our_count(tmp_path):
    prices = {"uncounted": Price.per_million(10.0, 20.0)}
    arguments = {"games": [BANDIT], "players": {"uncounted": Uncounted}, "trials": 2, "executor": "inline"}
    run = sp.evaluate(out=tmp_path / "run", prices=prices, **arguments)
    costs = [(10 * row["tokens"]["prompt"] + 20 * row["tokens"]["reply"]) / 1e6 for row in run.rows]
    assert [row["cost"] for row in run.rows] == pytest.approx(costs)
    assert run.spending.total.cost == pytest.approx(sum(costs))
    capped = sp.evaluate(out=tmp_path / "capped", prices=prices, run_cost=costs[0] / 2, **arguments)
    assert capped.cap_reached
    assert capped.spending.total.cost <= costs[0] / 2


def test_what_a_run_has_used_in_all_stands_beside_what_its_results_have(tmp_path):
    price = {"metered": Price.per_million(10.0, 20.0, 1.0)}
    arguments = {"players": {"metered": Metered}, "out": tmp_path, "trials": 1, "executor": "inline", "prices": price}
    run = sp.evaluate([BANDIT], **arguments)
    (record,) = (tmp_path / "episodes").iterdir()
    lines = record.read_text().splitlines(keepends=True)
    place = max(at for at, line in enumerate(lines) if '"event": "view"' in line)
    (tmp_path / "attempts" / f"{record.stem}.1.jsonl").write_text("".join(lines[: place + 1]))
    spending = run.spending
    (row,) = run.rows
    assert spending.results.tokens == row["tokens"]["prompt"] + row["tokens"]["reply"]
    assert spending.results.cost == pytest.approx(row["cost"])
    assert spending.other_attempts.replies == row["turns"] - 1
    assert spending.other_attempts.unknown_calls == 1
    assert spending.total.cost == pytest.approx(spending.results.cost + spending.other_attempts.cost)


@pytest.mark.parametrize(
    "error", [None, "The worker process died while it played this episode.", "SystemExit: 3", UNANSWERED]
)
def test_a_call_without_a_reply_may_be_charged_however_its_attempt_ended(tmp_path, error):
    path = tmp_path / "episode.jsonl"
    episode = sp.Episode(BANDIT, seed=1, transcript=path, budget=sp.Budget(reply_tokens=50))
    conversation = sp.Conversation(episode, player="openai:m")
    prompt = conversation.prompt()
    if error is not None:
        append_exception(path, error)
    for record in (Record.read(path), Record.follow(path)):
        assert record.open_call.unknown_calls == 1
        assert record.open_call.unknown_tokens == episode.counter.prompt(prompt.messages, prompt.tools) + 50
    episode.ledger.writer.close()
    again = sp.resume(path, transcript=tmp_path / "again.jsonl")
    again.conversation.prompt()
    assert Record.read(tmp_path / "again.jsonl").open_call.unknown_calls == 1, "asked once more, and no reply again"
    again.conversation.give_up(RuntimeError("no reply"))
    again.episode.close()
    assert Record.read(tmp_path / "again.jsonl").open_call.unknown_calls == 0


def test_a_cap_on_cost_is_not_pretended_where_nobody_knows_the_price(tmp_path):
    arguments = {"out": tmp_path, "trials": 3, "executor": "inline", "run_cost": 1.0}
    with pytest.raises(sp.InvalidArgumentError, match="needs the price of metered"):
        sp.evaluate([BANDIT], {"metered": Metered}, **arguments)
    assert len(RunFolder(tmp_path).rows()) == 1  # what was played is kept, and no further episode began
    free = {"metered": Price.per_million(0.0, 0.0)}
    assert sp.evaluate([BANDIT], {"metered": Metered}, prices=free, **arguments).complete


@pytest.mark.parametrize("prices", [{"rule": (10.0, 40.0)}, {"rule": 10.0}, [("rule", 10.0)]])
def test_prices_of_another_form_are_refused_in_a_sentence(prices, tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match=r"is a `Price`|a price for each player's name"):
        sp.evaluate(["Hanoi3Disk-v0"], ["rule"], out=tmp_path / "run", trials=1, prices=prices)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("rate", [10.0, (), ((5, 1.0),), ((0, -1.0),), ((0, float("nan")),), (10.0,), [(0, 1.0)]])
def test_a_price_has_rates(rate):
    with pytest.raises(sp.InvalidArgumentError, match="an output rate that cannot be"):
        Price(input=((0, 1.0),), output=rate, cached=((0, 1.0),), source="given")


def test_prices_come_from_the_tables_or_from_the_user():
    assert find_price("openai:gpt-5-mini", {}) == find_price("openai-responses:gpt-5-mini", {})
    assert find_price("openai:gpt-5-mini", {"base_url": "http://127.0.0.1:8000"}) is None
    assert find_price("openai:a-model-nobody-knows", {}) is None
    assert find_price("rule", {}) is None
    tiered = find_price("anthropic:claude-sonnet-4-5", {})
    assert tiered is not None
    short, long = sp.Usage(prompt=100_000), sp.Usage(prompt=400_000)
    assert tiered.cost(long) > 4 * tiered.cost(short)
    assert Price.from_json(tiered.to_json()) == tiered
    assert Price.parse("2,8").cost(sp.Usage(prompt=500_000, reply=250_000, cached=100_000)) == pytest.approx(3.0)
    for wrong in ("", "2", "2,x", "-1,2", "1,2,3,4,5", "nan,1", "1,inf"):
        with pytest.raises(sp.InvalidArgumentError, match="write INPUT,OUTPUT"):
            Price.parse(wrong)
    for rates in ((-1, 2), (1, float("inf")), (1, 2, float("nan")), (1, 2, 1, -1)):
        with pytest.raises(sp.InvalidArgumentError, match="finite and not negative"):
            Price.per_million(*rates)


def test_a_name_has_the_price_in_the_tables_only_where_no_cell_has_a_server_of_its_own():
    def cell(player, **options):
        return cell_config(BANDIT, player=player, player_options=options)

    hosted = [cell("openai:gpt-5-mini"), cell("openai:gpt-5-mini", stream=True)]
    price = find_price("openai:gpt-5-mini", {})
    assert prices_in_tables([*hosted, cell("rule")]) == {"openai:gpt-5-mini": price}
    assert prices_in_tables([*hosted, cell("openai:gpt-5-mini", base_url="http://127.0.0.1:8000")]) == {}


def test_a_price_that_is_given_later_is_that_of_all_episodes(tmp_path):
    arguments = {"games": [BANDIT], "players": {"metered": Metered}, "executor": "inline"}
    price = {"metered": Price.per_million(10.0, 20.0)}
    first = sp.evaluate(trials=1, out=tmp_path / "a", **arguments)
    assert first.rows[0]["cost"] is None
    later = sp.evaluate(trials=2, out=tmp_path / "a", prices=price, **arguments)
    assert later.rows == sp.evaluate(trials=2, out=tmp_path / "b", prices=price, **arguments).rows


def test_the_price_that_a_run_began_with_stays(tmp_path):
    arguments = {"games": [BANDIT], "players": {"metered": Metered}, "out": tmp_path, "executor": "inline"}
    first = sp.evaluate(trials=1, prices={"metered": Price.per_million(10.0, 20.0)}, **arguments)
    second = sp.evaluate(trials=2, **arguments)
    assert [row["cost"] for row in second.rows] == [first.rows[0]["cost"]] * 2
