"""Excerpts: some turns of one episode as a page of their own."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from smartplay_tools.cli import app
from tests.evaluation.report_runs import BANDIT, record

pytest.importorskip("jinja2")


@pytest.fixture
def episode(tmp_path):
    return record(tmp_path / "episode.jsonl", BANDIT, history=None, prompt_tokens=700)


def share(episode, *arguments: str):
    return CliRunner().invoke(app, ["share", str(episode), *arguments])


def test_turns_after_an_excerpt_are_not_in_its_page(episode, tmp_path):
    from tests.evaluation.test_report import Page

    out = tmp_path / "lost.html"
    assert share(episode, "--turns", "20-24", "--out", str(out)).exit_code == 0
    data = Page(out).episode("episode")
    assert data["excerpt"] == {"first": 20, "last": 24, "count": 50}
    assert len(data["turns"]) == 25, "the turns before are there, because prompts show them"
    assert len(data["drawing"]["actions"]) == 25
    assert max(gone["prompt"] for gone in data["departures"]) <= 24


@pytest.mark.parametrize(
    ("turns", "sentence"),
    [
        ("40-60", "The episode has turns 0 to 49; there is no range 40-60 of them."),
        ("9-3", "there is no range 9-3 of them."),
        ("some", "--turns is a turn or a range of turns such as 20-40, not 'some'."),
    ],
)
def test_turns_that_are_not_there_are_refused(episode, tmp_path, turns, sentence):
    done = share(episode, "--turns", turns, "--out", str(tmp_path / "page.html"))
    assert done.exit_code == 2
    assert sentence in " ".join(done.output.split())


def test_a_folder_is_not_an_episode(tmp_path):
    done = share(tmp_path, "--out", str(tmp_path / "page.html"))
    assert done.exit_code == 2
    assert "is not the record of an episode" in " ".join(done.output.split())


@pytest.mark.slow
def test_an_excerpt_is_played_between_its_ends_and_has_no_list(episode, tmp_path, browser):
    out = tmp_path / "lost.html"
    share(episode, "--turns", "20-24", "--out", str(out))
    page = browser.new_page()
    page.goto(out.as_uri())
    page.wait_for_selector("body[data-ready]")
    assert page.locator("#turn-title").text_content() == "Turn 20"
    assert not page.locator("header.top, .crumbs").first.is_visible()
    page.keyboard.press("End")
    assert page.locator("#turn-title").text_content() == "Turn 24"
    page.keyboard.press("Home")
    assert page.locator("#turn-title").text_content() == "Turn 20"
    page.keyboard.press("Escape")
    assert page.locator("#player").is_visible()
    page.close()
