"""The tables in the pages are those of the published rows, of which a part is played again."""

from __future__ import annotations

import importlib.util
import random
import re
import sys
import tarfile
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.prompts.wording import VERSION
from smartplay_tools.statistics.intervals import Bounds, mean_estimate

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "experiments" / "context.py"
MARK = re.compile(r"<!-- table: (\S+) -->")
OF_SERVERS = {"chat", "responses", "messages", "set", "errors", "refusals", "names", "fields"}
"""Tables of what clients do with servers' replies, which have tests of their own."""

pytestmark = [
    pytest.mark.skipif(not SCRIPT.exists(), reason="not in a checkout"),
    pytest.mark.usefixtures("beside_the_scripts"),
]


@pytest.fixture(scope="module")
def experiments():
    return importlib.import_module("tables").experiments()


def published(name):
    """The lines of a table in its page."""
    pages = importlib.import_module("page_tables")
    text = pages.page_of(name).read_text(encoding="utf-8")
    return text.partition(pages.mark(name))[2].partition(pages.END)[0].strip().splitlines()


def made(*experiments):
    """The tables of experiments by their names, from the published rows."""
    return {name: table for each in experiments for name, table in each.tables(each.rows()).items()}


def test_tables_in_the_pages_are_those_of_the_published_rows(experiments):
    """Of the experiments with the fewest rows."""
    few = ("cap-audit", "degrees", "models", "money", "ruler", "window-for-a-budget")
    for name, table in made(*(experiments[name] for name in few)).items():
        assert published(name) == table.splitlines(), name


@pytest.mark.slow
def test_every_table_in_the_pages_is_that_of_the_published_rows(experiments):
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md")]
    marked = {name for page in pages for name in MARK.findall(page)}
    tables = made(*experiments.values())
    assert marked - set(tables) == OF_SERVERS
    for name, table in tables.items():
        assert published(name) == table.splitlines(), name


@pytest.mark.parametrize(
    ("right", "enters"),
    [([6] * 16, True), ([6] * 15, False), ([6] * 7 + [5] * 9, True), ([6] * 6 + [5] * 10, False), ([0] * 24, False)],
    ids=str,
)
def test_a_model_enters_with_nine_tenths_of_the_best_score_in_enough_worlds(right, enters):
    entry = importlib.import_module("entry")
    assert entry.enters(of_lockers(right)) == enters


def of_lockers(scores, **facts):
    """Rows of worlds of Lockers with these scores."""
    facts = {"game": "Lockers6-v0", "end_reason": "terminated", "repeat": 0, "budget": {}} | facts
    return [{"score": score, "seed": world, "trial": world, **facts} for world, score in enumerate(scores)]


def test_a_knee_is_where_a_player_begins_to_have_nine_tenths_of_its_own_score():
    entry = importlib.import_module("entry")
    asked = entry.ASKED["four"]
    scores = dict(zip((entry.IN_VIEW, *asked.curves), (3, 3, 1, 2.9, 2.7, 3, 3, *[2] * 6), strict=True))
    about = {"worlds": "four", "game": asked.game}
    rows = [row for way, score in scores.items() for row in of_lockers([score] * 4, way=way, **about)]
    played = [row | {"player": player} for player in (entry.QWEN, "random") for row in rows]
    played += [row | {"player": "reader", "score": 4} for row in rows]
    table = entry.knees_table(played)
    assert table.splitlines()[2:] == [
        f"| {entry.QWEN} | 4 | {rest} |" for rest in ("cap | 470 | 390", "history | none | 1")
    ]
    some = [row for row in played if row["way"] != "cap 390"]
    assert "cap" not in entry.knees_table(some), "of a curve that is not whole nothing is said"


def test_two_players_agree_about_ways_as_far_as_their_worlds_say():
    script = importlib.import_module("summaries")
    ways, played = [way for way in script.WAYS if way != script.IN_VIEW], {}
    for rank, way in enumerate(ways):
        for player, scores in ((script.QWEN, [rank, rank + 1]), (script.READER, [rank, rank])):
            played[player, way] = of_lockers(scores, way=way, player=player, questions=1)
    assert script.agreement(played) == (pytest.approx(1), pytest.approx(1), pytest.approx(1), len(ways))
    turned = {(player, way): played[player, ways[::-1][ways.index(way)]] for player, way in played}
    turned |= {place: rows for place, rows in played.items() if place[0] == script.READER}
    assert script.agreement(turned)[0] == pytest.approx(-1)


@pytest.mark.parametrize("name", ["models", "entry", "summaries"])
def test_published_records_of_models_replay_without_the_model(name, tmp_path, experiments):
    with tarfile.open(experiments[name].path.with_name("records.tar.xz")) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 and later
        archive.extractall(tmp_path)
    fields, has_popgym = ("worlds", "player", "game", "way", "trial"), importlib.util.find_spec("popgym")
    scores = {tuple(row[field] for field in fields): row["score"] for row in experiments[name].rows()}
    records = [
        each
        for each in tmp_path.rglob("*.jsonl")
        if has_popgym or name != "models" or not sp.GAMES[each.parts[-3]].memory
    ]
    assert len(records) > (50 if name == "models" else 10)
    if name != "models":
        worlds = Counter(place[:4] for place in scores if place[1] not in importlib.import_module("entry").SCRIPTS)
        kept = Counter(tuple(record.relative_to(tmp_path).parts[:4]) for record in records)
        assert kept == {cell: min(count, 3) for cell, count in worlds.items()}
    for record in records if name != "models" else {record.parent: record for record in records}.values():
        replayed = sp.replay(record)
        assert replayed.identical, record
        assert replayed.result.score == scores[(*record.relative_to(tmp_path).parts[:4], int(record.stem))]


def test_what_a_budget_buys_is_what_an_episode_under_it_plays():
    """The experiment cuts whole episodes where their budget would have ended them."""
    script = importlib.import_module("window_for_a_budget")
    seed, played = script.FIRST + 3, [*script.CELLS[:1], *script.CELLS[3:]]
    for row in script.EXPERIMENT.rows():
        if row["seed"] != seed or (row["game"], row["player"]) not in played or row["cap"] not in (600, None):
            continue
        for rule in ("none", "openai-5-5", "anthropic-512", "deepseek-4"):
            budget = script.budget(row["cap"], episode_cost=script.COST, cost_rule=rule)
            with sp.Episode(row["game"], seed=seed, budget=budget) as episode:
                result = sp.play(episode, sp.get_player(row["player"], seed=seed))
            assert result.reward == row["bought"][rule]
            assert result.spent_cost <= script.COST


def test_what_an_early_end_leaves_out_is_out_of_view():
    """The way that ended early saw all that it was asked, and has not half of what the others have."""
    in_view = importlib.import_module("in_view")

    def row(way: str, seen: int, unseen: int, points: float) -> dict[str, Any]:
        memory = {"in view": [seen, seen], "out of view": [0, unseen], "in view: summary": [seen, seen]}
        ended = {"end_reason": "terminated", "game": "Hanoi3Disk-v0"}
        return {"stage": "k", "way": way, "questions_up_to": 0, "seed": 1, "memory": memory, "score": points, **ended}

    rows = [row("asks", 10, 0, 1.0), row("drops", 5, 5, 0.5), row("ended", 4, 0, 0.1)]
    assert in_view.in_view_table(rows).splitlines()[-1] == "| k | 3 | 1.00 | none differ |"
    assert in_view.rank_correlation([(1, 3), (2, 2), (3, 1), (3, 1)]) == pytest.approx(-1)


def check_played(experiment, rows, folder):
    """Hold rows against the published ones, of which those of version 1 of the prompts say less.

    Of earlier versions only those without slack are played again: with slack a window moved by other steps.
    """
    tables = importlib.import_module("page_tables")
    known = experiment.rows()
    if known[0]["prompts"] != VERSION:
        rows = [row for row in rows if not row["budget"]["slack"]]
    tables.write_rows(rows, folder / "rows.jsonl.xz")
    differs = {"v1": ("prompts", "limited_prompts", "play_sha256"), "v2": ("prompts", "play_sha256")}
    later = dict.fromkeys(differs.get(known[0]["prompts"], ()))
    known = [row | later for row in known]
    played = [row | later for row in tables.read_rows(folder / "rows.jsonl.xz")]
    assert played
    assert [row for row in played if row not in known] == []


def test_the_rows_of_the_cap_audit_are_what_the_context_manager_sends(experiments):
    """Those of other projects need their packages; of ours the first history of each kind is fitted again."""
    audit = importlib.import_module("cap_audit")
    rows = [row for row in experiments["cap-audit"].rows() if row.get("package") == "smartplay-tools"]
    for row in rows:
        if row["seed"] == "confirmed" and row["cap"] <= 2_000 and not row["number"]:
            given = audit.given_history(row["seed"], row["kind"], row["cap"], row["number"])
            trim = audit.OURS[row["package"], row["trimmer"], row["counter"]]
            played = audit.judged(trim, given, row["cap"])
            assert row | played | {"ms": row.get("ms")} == row | {"ms": row.get("ms")}


def test_the_judge_of_the_cap_audit_finds_each_fault(experiments):
    histories = importlib.import_module("cap_audit_histories")
    given = histories.history(random.Random(0), "parallel", 1_000)
    tokens = histories.prompt_tokens(given)
    assert histories.verdict(given, given, tokens) == {
        "used": tokens, "over": False, "texts": False, "broken": False, "empty": False, "task": False, "newest": False,
    }  # fmt: skip
    for name, shown, cap in [
        ("over", given, tokens - 1),
        ("broken", given[:-1], tokens),
        ("broken", [*given[:2], *given[3:]], tokens),
        ("empty", given[:2], tokens),
        ("newest", given[:2], tokens),
        ("task", [given[0], *given[2:]], tokens),
    ]:
        assert histories.verdict(given, shown, cap)[name], name


@pytest.mark.slow
def test_the_first_worlds_of_the_arena_played_again_are_the_published_rows(experiments, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    arena = importlib.import_module("arena")
    game, silent = list(arena.GAMES.items())[1]
    budgets = arena.budgets([arena.FIRST_AND_NEWEST])
    done = sp.evaluate([game], [silent], budgets=budgets, trials=1, out=tmp_path / "run", executor="inline")
    check_played(experiments["arena"], done.rows, tmp_path)


@pytest.mark.slow
def test_the_first_worlds_of_a_curve_played_again_are_the_published_rows(experiments, tmp_path):
    curves = importlib.import_module("arena_curves")
    whole = curves.STAGES["RockPaperScissorBasic-v0"]
    stage = curves.Stage(whole.game, whole.caps[:1], [{}, {"notes_tokens": 200}])
    rows = curves.play(stage, tmp_path, trials=1, seed=curves.SEED, executor="inline")
    check_played(experiments["arena-curves"], rows, tmp_path)


@pytest.mark.slow
def test_the_same_questions_go_to_another_player(tmp_path, monkeypatch, capsys):
    asked = ["context.py", "--player", "random", "--questions", "slack", "--trials", "1", "--reply-tokens", "90",
             "--workers", "1", "--out", str(tmp_path)]  # fmt: skip
    monkeypatch.setattr(sys, "argv", asked)
    context = importlib.import_module("context")
    context.main()
    shown = capsys.readouterr().out
    assert shown.count("| `") == 2 * len(context.QUESTIONS["slack"]["vary"]["slack"])
    assert (tmp_path / "slack" / "figures" / "frontier.svg").exists()


def test_a_custom_strategy_is_the_same_as_the_windows_own(experiments):
    """Showing the first three turns and the newest ones is what `first_turns=3` does, as far as the cap decides."""
    rows = [line.strip("| ").split(" | ") for line in published("arena") if line.startswith("| `")]
    own, custom = ([row for row in rows if name in row[1]] for name in ("first turns 3", "FirstAndNewest:turns=3"))
    assert [row[2:] for row in own] == [row[2:] for row in custom]
    under_cap = [row for row in experiments["arena"].rows() if row["budget"]["prompt_tokens"] == 700]
    own, custom = (
        [row["tokens"] for row in under_cap if row["budget"].get(field)] for field in ("first_turns", "strategy")
    )
    assert own
    assert own == custom
    assert "of which 0 differ in score" in published("arena")[-1]


def test_a_claim_is_confirmed_by_an_interval_on_its_side_alone():
    outcome = importlib.import_module("page_tables").outcome
    above, around = mean_estimate([0.1, 0.2, 0.1, 0.2], Bounds(0, 1)), mean_estimate([0.1, -0.2, 0.1], Bounds(-1, 1))
    assert [outcome(above, better=better) for better in (True, False)] == ["confirmed", "contradicted"]
    assert [outcome(around, better=better) for better in (True, False)] == ["undecided", "undecided"]


@pytest.mark.slow
def test_claims_are_held_against_worlds_that_are_in_no_other_table(experiments):
    worlds = [
        {(row["game"], row["seed"]) for row in experiments[name].rows()} for name in ("arena-claims", "arena-curves")
    ]
    assert not set.intersection(*worlds)
