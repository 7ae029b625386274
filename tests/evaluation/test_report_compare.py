"""Runs and episodes side by side on the replay page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.page import write_report
from tests.evaluation.command import refused, shown_by
from tests.evaluation.report_runs import BANDIT, HANOI, RPS, record
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
    for words in ("Side by side", "B rule, history 2", "reference", "W/T/L", "over all games"[:4], "12 episodes."):
        assert words in page.words, words
    assert "In all of A: 4 finished episodes" in page.words
    assert "In all of B: 8 finished episodes" in page.words
    assert "The run’s manifest (A)" in page.words
    names = [attributes["alt"] for tag, attributes in page.elements if tag == "img"]
    assert "Figure: frontier" in names
    assert len(names) == len(set(names)), "one of each, and not one for each run"
    assert not any((run / "figures").exists() for run in runs), "a report writes its page and nothing else"


def test_pairs_met_the_same_world_and_are_of_the_same_player_where_there_is_one(page):
    links = [
        attributes["href"]
        for tag, attributes in page.elements
        if tag == "a" and (attributes.get("href") or "").startswith("#compare=")
    ]
    pairs = [re.fullmatch(r"#compare=(A\.\w+)&with=(B\.\w+)", link).groups() for link in links]
    assert len(pairs) == 8, "each of the second run's episodes has its counterpart"
    for one, other in pairs:
        first, second = page.episode(one), page.episode(other)
        assert (first["game"], first["seed"], first["trial"]) == (second["game"], second["seed"], second["trial"])
        assert first["player"] == "rule"


def test_runs_without_a_game_in_common_are_one_page_without_a_comparison(runs, tmp_path):
    sp.evaluate([BANDIT], ["rule"], out=tmp_path / "other", trials=1, executor="inline")
    page = page_of([runs[0], tmp_path / "other"], tmp_path)
    assert "Side by side" not in page.words.partition("Results")[0]
    assert "5 episodes." in page.words


def test_the_command_takes_several_runs(runs, tmp_path):
    out = tmp_path / "both.html"
    shown_by("report", *runs, "--out", out)
    assert "W/T/L" in Page(out).words
    assert "named twice" in refused("report", runs[0], runs[0], "--out", out)


# In a browser.


def test_two_episodes_are_moved_through_together(show, runs):
    page = show(runs)
    page.click("#pairs a >> nth=2")  # the rule player with full and with a short history
    page.wait_for_selector("#compare:not([hidden])")
    assert page.locator("#run").is_hidden()
    assert page.locator("#compare-place").text_content().startswith("step 0 of ")
    first = int(re.search(r"They part at step (\d+)", page.text_content("#compare-lead"))[1])
    page.click("#compare-difference")
    assert page.locator("#compare-place").text_content().startswith(f"step {first} of ")
    assert f"step={first}" in page.url
    one, other = (page.locator(f"#compare-sides .side{at} .side-answer").text_content() for at in (0, 1))
    assert one != other
    page.keyboard.press("ArrowLeft")
    one, other = (page.locator(f"#compare-sides .side{at} .side-answer").text_content() for at in (0, 1))
    assert one == other, "before they part, both have seen the same"
    assert page.locator("#compare-sides svg").count() > 2, "the games are drawn"
    assert page.locator("#compare-scores .curve").count() == 2
    assert "history" in page.locator("#compare-facts tr.differs").all_text_contents()[-1]
    page.keyboard.press("End")
    assert re.search(r"step (\d+) of \1", page.text_content("#compare-place"))
    page.keyboard.press("Escape")
    page.wait_for_selector("#run:not([hidden])")


def test_strategies_on_one_seed_are_compared_with_one_clock(show, tmp_path):
    budgets = {"drop": {"history": 4}, "long": {"history": 8}, "notes": {"history": 4, "notes_tokens": 100}}
    for name, budget in budgets.items():
        record(tmp_path / "run" / f"{name}.jsonl", BANDIT, "rule-notes", **budget)
    page = show(tmp_path / "run")
    assert page.locator("#compare-picked").is_disabled()
    for box in page.locator("#episodes .pick").all():
        box.check()
    page.click("#compare-picked")
    page.wait_for_selector("#compare:not([hidden])")
    titles = page.locator("#compare-sides h2").all_text_contents()
    assert titles == ["history 4", "history 8", "history 4, notes ≤ 100"], "the rest they have in common"
    assert "From step 7 on their prompts do not reach equally far back" in page.text_content("#compare-lead")
    page.keyboard.press("End")
    assert page.locator(".side-band svg").count() == page.locator("#compare-scores .curve").count() == 3
    assert page.url.count("with=") == 2
    page.reload()
    page.wait_for_selector("body[data-ready]")
    assert page.locator("#compare-sides .side").count() == 3
    page.locator(".card.side0 h2 a").click()
    page.wait_for_selector("#player:not([hidden])")
    page.go_back()
    page.wait_for_selector("#compare:not([hidden])")


def test_equal_episodes_are_said_to_be_equal(show, tmp_path):
    record(tmp_path / "run" / "a.jsonl", RPS)
    record(tmp_path / "run" / "b.jsonl", RPS)
    page = show(tmp_path / "run", "#compare=a&with=b")
    assert "the same actions and see the same observations" in page.text_content("#compare-lead")
    assert page.locator("#compare-difference").is_disabled()
    assert page.locator("#compare-facts tr.differs").count() == 0
