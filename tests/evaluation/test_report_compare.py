"""Several runs on one replay page."""

from __future__ import annotations

from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.page import write_report
from tests.evaluation.command import refused, shown_by
from tests.evaluation.report_runs import BANDIT, HANOI, RPS
from tests.evaluation.test_report import Page

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> list[Path]:
    """The same episodes with full context, and with that of two steps, which another player plays as well."""
    folder = tmp_path_factory.mktemp("runs")
    sp.evaluate([RPS, HANOI], ["rule"], out=folder / "full", trials=2, executor="inline")
    short = sp.Budget(history=2)
    sp.evaluate([RPS, HANOI], ["random", "rule"], budgets=short, out=folder / "short", trials=2, executor="inline")
    return [folder / "full", folder / "short"]


@pytest.fixture(scope="module")
def page(runs, tmp_path_factory) -> Page:
    return page_of(runs, tmp_path_factory.mktemp("page"))


def page_of(runs: list[Path], folder: Path) -> Page:
    return Page(write_report(runs, folder / "page.html"))


def test_several_runs_become_a_page_that_compares_them(runs, page):
    index = page.unpack("index")["episodes"]
    assert [(episode["run"], episode["player"]) for episode in index[::2]] == [
        *[("A", "rule")] * 2,
        *[("B", "random"), ("B", "rule")] * 2,
    ]
    assert len({episode["key"] for episode in index}) == 12
    for words in ("Compared", "B rule, history 2", "reference", "W/T/L", "12 episodes."):
        assert words in page.words, words
    assert "The run’s manifest (A)" in page.words
    names = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    assert "Figure: frontier" in names
    assert len(names) == len(set(names)), "one of each, and not one for each run"
    assert not any((run / "figures").exists() for run in runs), "a report writes its page and nothing else"


def test_runs_without_a_game_in_common_are_one_page_without_a_comparison(runs, tmp_path):
    sp.evaluate([BANDIT], ["rule"], out=tmp_path / "other", trials=1, executor="inline")
    page = page_of([runs[0], tmp_path / "other"], tmp_path)
    assert "Compared" not in page.words.partition("Results")[0]
    assert "5 episodes." in page.words


def test_the_command_takes_several_runs(runs, tmp_path):
    out = tmp_path / "both.html"
    shown_by("report", *runs, "--out", out)
    assert "W/T/L" in Page(out).words
    assert "named twice" in refused("report", runs[0], runs[0], "--out", out)
