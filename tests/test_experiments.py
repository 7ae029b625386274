"""The page of the experiment agrees with its results: a part of it is played again and compared word for word."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest

from smartplay_tools.evaluation.runs.sweeps import sweep

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "experiments" / "context.py"
PAGES = [ROOT / "docs" / name for name in ("experiments.md", "context-cost.md")]

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="not in a checkout")


@pytest.fixture(scope="module")
def experiment():
    spec = importlib.util.spec_from_file_location("context_experiment", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


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


def test_figures_are_small_enough_for_a_repository():
    figures = sorted((ROOT / "docs" / "figures").glob("*.svg"))
    assert figures
    assert all(figure.stat().st_size < 170_000 for figure in figures)


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
