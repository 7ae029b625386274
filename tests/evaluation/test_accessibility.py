"""Every kind of page, held against the rules of axe-core: in light on a desk, and in dark on a phone.

axe sees names, roles, contrast and the order of headings. Keys and focus are tested with the page that they belong to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.page import write_episode, write_report
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.web.site import BrowserGames
from tests.evaluation.report_runs import BANDIT, HANOI, RPS

view = pytest.importorskip("smartplay_tools.web.site")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
pytestmark = pytest.mark.slow

DESK = {"viewport": {"width": 1280, "height": 900}, "color_scheme": "light"}
PHONE = {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"}

Open = Callable[[str], Any]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    short = sp.Budget(prompt_tokens=700, tool_calls=30)
    sp.evaluate([HANOI, BANDIT], ["rule", "random"], out=folder / "one", budgets=short, trials=2, executor="inline")
    masked = sp.Budget(
        history=5, beyond_history="mask", prompt_tokens=1200, slack=0.5, summary_tokens=80, tool_calls=30
    )
    sp.evaluate([RPS, "Crafter-v0"], ["rule-notes"], out=folder / "two", budgets=masked, trials=1, executor="inline")
    return folder


@pytest.fixture(params=[pytest.param(DESK, id="desk-light"), pytest.param(PHONE, id="phone-dark")])
def opened(browser, request) -> Iterator[Open]:
    """Open a page on a screen."""
    context = browser.new_context(**request.param)

    def show(url: str) -> Any:
        page = context.new_page()
        page.goto(url)
        page.wait_for_selector("body[data-ready]")
        return page

    yield show
    context.close()


def assert_accessible(page: Any) -> None:
    """Fail with what axe finds, everything that can be opened being open."""
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    page.wait_for_timeout(100)  # what opens is filled when it has opened
    rules = axe.Axe().run(page).response["violations"]
    assert [
        f"{rule['id']} ({rule['impact']}): {node['html'][:200]} {node['failureSummary']}"
        for rule in rules
        for node in rule["nodes"]
    ] == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "the page fits the width of the screen"


def records(folder: Path) -> list[str]:
    return [f"{folder.name}/episodes/{path.stem}" for path in sorted(RunFolder(folder).records())]


def test_the_site(opened, runs):
    with view.ViewServer(view.RunList([runs])) as server:
        page = opened(f"{server.url}#run=one")
        page.locator("#rows a").first.wait_for()
        assert_accessible(page)
        for record in [*records(runs / "one")[::3], *records(runs / "two")]:
            assert_accessible(opened(f"{server.url}episode/{record}#turn=20"))


def test_the_report_of_several_runs_and_a_page_to_send(opened, runs, tmp_path):
    write_report([runs / "one", runs / "two"], tmp_path / "report.html")
    write_episode(next(RunFolder(runs / "two").records()), tmp_path / "some.html")
    for name in ("report", "some"):
        assert_accessible(opened((tmp_path / f"{name}.html").as_uri()))


def test_playing_in_the_browser(opened, tmp_path):
    budget = sp.Budget(prompt_tokens=900, notes_tokens=50, tool_calls=2)
    play = BrowserGames([game for game in sp.GAMES if sp.GAMES.is_loaded(game)], tmp_path / "human", budget=budget)
    with play, view.ViewServer(view.RunList(own=[play.folder]), play=play) as server:
        page = opened(f"{server.url}play")
        assert_accessible(page)
        assert page.locator(".game svg").count() == 6
        page.get_by_role("link", name=HANOI).click()
        page.locator("#actions button").first.wait_for()
        assert_accessible(page)
        for number in (1, 2):
            page.wait_for_selector(f"body[data-number='{number}']")
            page.keyboard.press("o")
        page.locator("#beside table").wait_for()
        assert_accessible(page)
        assert page.get_by_label("A link that replays it").input_value().startswith(server.url)
