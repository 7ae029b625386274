"""The page of the experiment agrees with its results: a part of it is played again and compared word for word."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.sweeps import sweep

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "experiments" / "context.py"
PAGES = [ROOT / "docs" / name for name in ("experiments.md", "context-cost.md", "memory.md", "compaction.md")]

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="not in a checkout")


@pytest.fixture(scope="module")
def experiment():
    yield from script("context")


@pytest.fixture(scope="module")
def arena():
    yield from script("arena")


@pytest.fixture(scope="module")
def curves():
    yield from script("arena_curves")


@pytest.fixture(scope="module")
def ruler():
    yield from script("ruler")


@pytest.fixture(scope="module")
def compaction():
    yield from script("compaction")


@pytest.fixture(scope="module")
def claims():
    yield from script("arena_claims")


def script(name):
    """The module of a script, which finds those beside it while it is loaded; games that it registers go with it."""
    before, games = set(sys.modules), dict(sp.GAMES._specs)
    spec = importlib.util.spec_from_file_location(f"{name}_experiment", SCRIPT.with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    sys.path.insert(0, str(SCRIPT.parent))
    spec.loader.exec_module(module)
    sys.path.remove(str(SCRIPT.parent))
    yield module
    sp.GAMES._specs = games
    for loaded in set(sys.modules) - before:
        if Path(getattr(sys.modules[loaded], "__file__", None) or "").parent == SCRIPT.parent:
            del sys.modules[loaded]


def published(name):
    """The lines of a table in the pages."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    marked = re.search(rf"<!-- table: {name} -->\n(.*?)<!-- end -->", text, flags=re.DOTALL)
    return marked[1].strip().splitlines()


def test_every_question_has_its_table_in_the_page(experiment):
    for name, question in experiment.QUESTIONS.items():
        rows = [line for line in published(name) if line.startswith("| `")]
        players = set(question["players"]) - ({experiment.CONTROL} if name == "history" else set())
        cells = len(players) * len(question["games"])
        for values in question.get("vary", {}).values():
            cells *= len(values)
        assert len(rows) == cells, name
        assert {row.split(" | ")[3] for row in rows} == {str(question["trials"])}, name


def test_a_table_is_renewed_between_its_marks_and_nowhere_else(tmp_path, experiment):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- table: b -->\n\nold\n\n<!-- end -->\nc <!-- end -->\n", encoding="utf-8")
    experiment.publish_table(page, "b", "| new \\1 |")
    assert page.read_text(encoding="utf-8") == "a\n<!-- table: b -->\n\n| new \\1 |\n\n<!-- end -->\nc <!-- end -->\n"
    with pytest.raises(ValueError, match="no place for the table d"):
        experiment.publish_table(page, "d", "")


def test_figures_are_small_enough_for_a_repository():
    figures = sorted((ROOT / "docs" / "figures").glob("*.svg"))
    assert figures
    assert all(figure.stat().st_size < 190_000 for figure in figures)


@pytest.mark.slow
def test_the_page_says_what_is_played(experiment, tmp_path):
    """The ends of the first curve: 200 episodes of its 2,800."""
    question = experiment.QUESTIONS["history"] | {
        "games": ["BanditTwoArmedHighLowFixed-v0"],
        "players": ["rule"],
        "vary": {"history": (1, 50)},
    }
    played = sweep(**question, out=tmp_path, executor="inline")
    rows = [line for line in experiment.table("history", played).splitlines() if line.startswith("| `")]
    assert len(rows) == 2
    assert set(rows) <= set(published("history"))


@pytest.mark.slow
def test_the_same_questions_go_to_another_player(experiment, tmp_path, monkeypatch, capsys):
    asked = ["context.py", "--player", "random", "--questions", "slack", "--trials", "1", "--reply-tokens", "90",
             "--workers", "1", "--out", str(tmp_path)]  # fmt: skip
    monkeypatch.setattr(sys, "argv", asked)
    experiment.main()
    shown = capsys.readouterr().out
    assert shown.count("| random |") == 2 * len(experiment.QUESTIONS["slack"]["vary"]["slack"])
    assert (tmp_path / "slack" / "figures" / "effects-of-slack.svg").exists()
    assert (tmp_path / "tables.md").read_text(encoding="utf-8").strip() in shown


def cells_of(lines):
    """The cells of a table's rows without the difference, which depends on what else is compared."""
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| `")]
    return [[*row[:5], *row[6:]] for row in rows]


def test_the_arena_has_a_row_for_every_strategy_and_cap(arena):
    rows = cells_of(published("arena"))
    assert len(rows) == len(arena.GAMES) * len(arena.budgets([arena.FIRST_AND_NEWEST]))
    assert "of which 0 differ in score" in published("arena")[-1]


def test_a_custom_strategy_is_the_same_as_the_windows_own(arena):
    """Showing the first three turns and the newest ones is what `first_turns=3` does, as far as the cap decides."""
    rows = cells_of(published("arena"))
    own, custom = ([row for row in rows if name in row[2]] for name in ("first turns 3", "FirstAndNewest:turns=3"))
    assert len(own) == len(arena.GAMES) * len(arena.CAPS)
    assert [row[3:5] for row in own] == [row[3:5] for row in custom]
    assert [row[3:] for row in own if row[2].startswith("700")] == [
        row[3:] for row in custom if row[2].startswith("700")
    ]


@pytest.mark.slow
def test_the_arenas_table_says_what_is_played(arena, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    budgets = [budget for budget in arena.budgets([arena.FIRST_AND_NEWEST]) if budget.prompt_tokens == arena.CAPS[0]]
    played = [budgets[0], budgets[-1]]
    game, silent = list(arena.GAMES.items())[1]
    done = arena.sp.evaluate([game], [silent], budgets=played, trials=20, out=tmp_path / "run", executor="inline")
    rows = cells_of(arena.table(done.rows).splitlines())
    assert len(rows) == 2
    assert all(row in cells_of(published("arena")) for row in rows)


@pytest.mark.slow
def test_the_areas_in_the_page_are_those_of_the_published_rows(curves):
    assert published("arena-curve-areas") == [*curves.areas_table(curves.areas_of(curves.read_rows(curves.PUBLISHED)))]


@pytest.mark.slow
def test_the_curves_in_the_page_are_those_of_the_published_rows(curves):
    assert published("arena-curves") == [*curves.curves_table(curves.read_rows(curves.PUBLISHED))]


@pytest.mark.slow
def test_the_first_worlds_of_a_curve_played_again_are_the_published_rows(curves, tmp_path):
    whole = curves.STAGES["RockPaperScissorBasic-v0"]
    stage = curves.Stage(whole.game, whole.caps[:1], [{}, {"notes_tokens": 200}])
    rows = curves.play(stage, [curves.SUBJECT], (), tmp_path, trials=1, seed=curves.SEED, executor="inline")
    curves.write_rows(rows, tmp_path / "rows.xz")
    played = curves.read_rows(tmp_path / "rows.xz")
    assert len(played) == 4
    # These prompts hold nothing in which the versions of the prompts differ.
    assert {row.pop("prompts") for row in played} == {"v2"}
    later = {"prompts": "v1", "limited_prompts": None, "play_sha256": None}
    known = [row | {name: None for name in later if name != "prompts"} for row in curves.read_rows(curves.PUBLISHED)]
    assert [row for row in played if row | later not in known] == []


def test_the_ruler_in_the_page_is_that_of_the_published_rows(ruler):
    assert published("ruler") == ruler.table(ruler.read_rows(ruler.PUBLISHED)).splitlines()


@pytest.mark.slow
def test_the_tables_of_compaction_are_those_of_the_published_rows(compaction):
    cells = compaction.cells_of(compaction.read_rows(compaction.PUBLISHED))
    for name, written in compaction.tables(cells).items():
        assert published(name) == written.splitlines()


def test_a_claim_is_confirmed_by_an_interval_on_its_side_alone(claims):
    better = claims.Claim(claims.BANDIT, {"notes_tokens": 200}, better=True)
    worse = claims.Claim(claims.BANDIT, {"notes_tokens": 200}, better=False)
    above, around = claims.Outcome(64, 0.1, 0.05, 0.15), claims.Outcome(64, 0.1, -0.05, 0.25)
    assert [above.of(better), above.of(worse)] == ["confirmed", "contradicted"]
    assert [around.of(better), around.of(worse)] == ["undecided", "undecided"]


@pytest.mark.slow
def test_the_outcomes_in_the_page_are_those_of_the_published_rows_of_fresh_worlds(claims):
    rows = claims.read_rows(claims.PUBLISHED)
    assert published("arena-claims") == [*claims.table(rows)]
    old = {(row["game"], row["seed"]) for row in claims.read_rows(claims.PUBLISHED.with_name("rows.jsonl.xz"))}
    assert not old & {(row["game"], row["seed"]) for row in rows}
