"""The site in a browser: lists, filters, links, keys, what is being played; that nothing hostile runs.

Every test fails on an error in the browser's console and on any request to another server.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.web.site import BrowserGames
from tests.evaluation.conftest import pages_of
from tests.evaluation.players import FirstMoves
from tests.evaluation.runs import under_way
from tests.evaluation.test_view import BANDIT, HANOI, large

view = pytest.importorskip("smartplay_tools.web.site")
site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")
sync_api = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.slow

SCRIPT = "<img src=x onerror=alert(1)><script>alert(2)</script>"


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    sp.evaluate([HANOI, BANDIT], ["rule", "random"], out=folder / "one", trials=2, executor="inline")
    sp.evaluate([BANDIT], {SCRIPT: FirstMoves}, out=folder / "two", trials=1, executor="inline")
    large(folder / "zero", folder / "one", 10_000)
    return folder


@pytest.fixture
def show(browser) -> Iterator[Any]:
    """Open a page of a site on this machine."""
    with pages_of(browser, "http://127.0.0.1:", "data:") as opened:
        yield lambda site, path="", **options: opened(site + path, **options)


@pytest.fixture(scope="module")
def site(runs) -> Iterator[str]:
    with view.ViewServer(view.RunList([runs])) as server:
        yield server.url


def shown(page: Any) -> list[str]:
    return page.locator("#rows > div").all_inner_texts()


def test_a_list_is_filtered_sorted_and_linked(show, site):
    page = show(site)
    assert page.locator("#runs .run").count() == 3
    page.locator("#runs .run b", has_text="one").click()
    sync_api.expect(page.locator("#count")).to_have_text("8 episodes")
    heads, rows = page.locator("#head [role=columnheader]"), page.locator("#rows [role=row]")
    assert page.locator("#rows [role=gridcell]").count() == heads.count() * rows.count(), "a table for screen readers"
    page.keyboard.press("/")
    page.keyboard.type("hanoi random")
    assert page.locator("#count").inner_text() == "2 episodes"
    page.locator("#head button", has_text="score").click()
    link = page.url
    assert "find=hanoi+random" in link
    assert "sort=score" in link
    again = show(site, link.removeprefix(site))
    assert shown(again) == shown(page)
    page.select_option("#only", "failed")
    assert page.locator("#count").inner_text() == "0 episodes"


def test_episodes_are_grouped_with_their_means(show, site):
    page = show(site, "#run=one")
    page.select_option("#group", "player")
    groups, rows = page.locator("#rows .group"), page.locator("#rows > div")
    assert [text.split("\n")[0] for text in groups.all_inner_texts()] == [
        "▾ rule: 4 episodes, means",
        "▾ random: 4 episodes, means",
    ]
    place = page.locator("#head [role=columnheader]").all_inner_texts().index("normalized")
    scores = [float(rows.nth(at).locator(":scope > *").nth(place).inner_text()) for at in range(1, 5)]
    means = groups.first.locator(":scope > *").all_inner_texts()
    assert float(means[place - 3]) == pytest.approx(sum(scores) / 4, abs=0.005)
    page.keyboard.press("Enter")
    sync_api.expect(rows).to_have_count(6)
    assert groups.first.get_attribute("aria-expanded") == "false"
    page.keyboard.press("j")
    page.keyboard.press("j")
    page.keyboard.press("Enter")
    page.wait_for_selector("body[data-ready] #player:not([hidden])")
    page.keyboard.press("Escape")
    page.wait_for_selector("body[data-ready] #rows > div")
    assert page.input_value("#group") == "player", "the way back leads to the same list"


def test_runs_are_grouped_and_episodes_have_their_date(show, site):
    page = show(site, "#run=one&cards=day")
    heads = page.locator("#runs .of-cards")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d: \d runs?", heads.first.inner_text())
    page.select_option("#cards-by", "player")
    assert page.locator("#runs > *").first.inner_text().endswith("run")
    assert "cards=player" in page.url
    page.select_option("#cards-by", "")
    assert (heads.count(), page.locator("#runs .run").count()) == (0, 3)
    place = page.locator("#head [role=columnheader]").all_inner_texts().index("date")
    date = page.locator("#rows > div").first.locator(":scope > *").nth(place)
    assert re.fullmatch(r"\d\d-\d\d \d\d:\d\d", date.inner_text())
    assert date.get_attribute("title").endswith(f"{date.inner_text()} UTC")


def test_an_episode_has_its_list_and_the_neighbours_of_that_list(show, site):
    page = show(site, "#run=one&find=hanoi&sort=score&down=1")
    records = page.locator("#rows a").evaluate_all("links => links.map(link => link.getAttribute('href'))")
    page.locator("#list").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("body[data-ready] #player:not([hidden])")
    assert page.url.partition("#")[0].endswith(records[0])
    page.keyboard.press("ArrowRight")
    assert "turn=1" in page.url
    page.keyboard.press("n")
    page.wait_for_url(f"**{records[1]}*")
    page.wait_for_selector("body[data-ready] #player:not([hidden])")
    page.locator(".crumbs a").first.click()
    page.wait_for_selector("body[data-ready] #rows > div")
    assert "sort=score" in page.url


def test_ten_thousand_episodes_are_few_elements(show, site):
    page = show(site, "#run=zero")
    assert page.locator("#count").inner_text() == "10,000 episodes"
    assert page.locator("#rows > div").count() < 80
    page.evaluate("document.getElementById('list').scrollTop = 1e9")
    page.locator('#rows > div[aria-rowindex="10001"]').wait_for()
    assert page.locator("#rows > div").count() < 80


def test_names_stay_text_and_without_scripts_a_page_says_that_it_needs_them(show, site, browser):
    page = show(site, "#run=two")
    assert SCRIPT in page.locator("#rows > div").first.inner_text()
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(site)
    assert "scripts are switched off" in page.inner_text("body")


def test_an_episode_is_followed_while_it_is_played(show, runs, tmp_path):
    """New turns come into the open page; who steps back stays there; at the end it shows the result."""
    folder = tmp_path / "run"
    shutil.copytree(runs / "one", folder)
    key = json.loads((folder / "manifest.json").read_text())["episodes"][2]["key"]
    whole, record = under_way(folder, key, 14)
    with view.ViewServer(view.RunList([folder])) as server:
        page = show(server.url)
        page.locator("#playing a").click()
        page.wait_for_selector("body[data-ready] #player:not([hidden])")
        page.evaluate("window.isTheSamePage = true")
        place, chips = page.locator("#place"), page.locator("#chips")
        assert "being played" in chips.inner_text()
        assert "before the end" not in chips.inner_text()
        entries = page.evaluate("history.length")
        before = place.inner_text()
        record.write_text("".join(whole[:30]))
        sync_api.expect(place).not_to_have_text(before, timeout=60_000)
        sync_api.expect(page.locator("#live")).to_contain_text("run: 7 of 8 episodes")
        page.keyboard.press("Home")
        page.evaluate("window.scrollTo(0, 300)")
        version = page.evaluate("document.body.dataset.version")
        record.write_text("".join(whole[:40]))
        page.wait_for_function("version => document.body.dataset.version !== version", arg=version, timeout=60_000)
        assert place.inner_text().startswith("turn 0 of")
        assert page.evaluate("window.scrollY") == 300
        page.keyboard.press("End")
        (folder / "episodes" / f"{key}.jsonl").write_text("".join(whole))
        record.unlink()
        sync_api.expect(page.locator("#live")).to_have_text("over", timeout=60_000)
        assert "finished" in chips.inner_text()
        turns = place.inner_text().replace(",", " ").split()
        assert turns[1] == turns[3], "the last turn, with the result"
        assert page.evaluate("history.length") == entries
        assert page.evaluate("window.isTheSamePage")
        page.go_back()
        page.wait_for_selector("body[data-ready] #rows > div")


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (400, "dark")])
def test_a_person_plays_an_episode(show, tmp_path, width, scheme):
    budget = sp.Budget(history=1, tool_calls=4)
    playing = BrowserGames([HANOI], tmp_path / "human", budget=budget)
    with playing as games, view.ViewServer(view.RunList(own=[games.folder]), play=games) as server:
        page = show(server.url, "play", viewport={"width": width, "height": 900}, color_scheme=scheme)
        late: list[Any] = []
        page.route("**/beside", lambda route: late.append(route))
        page.locator("#actions button").nth(1).wait_for()
        page.keyboard.press("m")
        page.wait_for_selector("body[data-number='2']")
        page.locator("#say").fill("<b>the small disk</b>")
        page.locator("#actions button").nth(1).click()
        page.locator(".message.assistant", has_text="<b>the small disk</b>").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        for number in (4, 5):
            page.wait_for_selector(f"body[data-number='{number - 1}']")
            page.keyboard.press("o")
        page.locator("#over:not([hidden])").wait_for()
        place = page.locator("#replay").bounding_box()
        while not late:
            page.wait_for_timeout(10)
        late.pop().continue_()
        page.locator("#beside table").wait_for()
        assert page.locator("#replay").bounding_box() == place, "what comes late moves nothing from under the pointer"
        page.locator("#replay").click()
        page.wait_for_selector("body[data-ready] #player:not([hidden])")
        assert "/episode/human/episodes/" in page.url
        assert games.run_of(HANOI).folder.rows()[0]["steps"] == 1


def test_the_picture_of_a_turn_is_copied_or_saved(show, site, tmp_path):
    """A PNG as wide as the page: on the clipboard, or, where a page may not write there, as a file."""
    copied = {"permissions": ["clipboard-read", "clipboard-write"]}
    page = show(site, "#run=one&find=bandit", **copied)
    page.locator("#rows a").first.click()
    page.wait_for_selector("body[data-ready] #player:not([hidden])")
    button = page.locator("#copy-picture")
    button.click()
    sync_api.expect(button).to_have_text("copied", timeout=30_000)
    kinds = page.evaluate("navigator.clipboard.read().then(([item]) => item.types)")
    assert kinds == ["image/png"]
    page.evaluate("Object.defineProperty(navigator, 'clipboard', { value: undefined })")
    sync_api.expect(button).to_have_text("copy picture", timeout=30_000)
    with page.expect_download() as download:
        button.click()
    download.value.save_as(tmp_path / "turn.png")
    assert download.value.suggested_filename == f"{BANDIT}-turn-0.png"
    from PIL import Image

    with Image.open(tmp_path / "turn.png") as picture:
        assert picture.width > 2 * 1000
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 100, "text and colours, not an empty sheet"


def test_a_tap_without_network_says_so_and_the_focus_stays_where_it_was(browser, tmp_path):
    playing = BrowserGames([HANOI], tmp_path / "human")
    with playing as games, view.ViewServer(view.RunList(own=[games.folder]), play=games) as server:
        page = browser.new_context(viewport={"width": 390, "height": 844}).new_page()
        page.goto(f"{server.url}play/{HANOI}")
        second = page.locator("#actions button").nth(1)
        second.focus()
        page.keyboard.press("Enter")
        page.wait_for_selector("body[data-number='2']")
        sync_api.expect(second).to_be_focused()
        page.route("**/reply", lambda route: route.abort())
        page.locator("#observe").click()
        sync_api.expect(page.locator("#problem")).to_contain_text("cannot be reached")
        page.unroute("**/reply")
        page.locator("#observe").click()
        page.wait_for_selector("body[data-number='3']")
        sync_api.expect(page.locator("#problem")).to_be_empty()
        page.context.close()


def test_arrows_and_letters_play_the_actions_that_show_them(show, tmp_path):
    playing = BrowserGames(["Crafter-v0"], tmp_path / "human", budget=sp.Budget(tool_calls=2))
    with playing as games, view.ViewServer(view.RunList(own=[games.folder]), play=games) as server:
        page = show(server.url, "play")
        assert page.url.endswith("/play/Crafter-v0"), "one game has no list to choose from"
        page.locator("#actions button", has_text="Move West").wait_for()
        page.keyboard.press("ArrowLeft")
        page.wait_for_selector("body[data-number='2']")
        assert "Step 1 of" in page.locator("#step").inner_text()
        letter = page.locator("#actions button", has_text="Make Wood Pickaxe").locator("kbd").inner_text()
        page.keyboard.press(letter)
        page.locator("#beside table .you").wait_for(timeout=60_000)
        page.frame_locator("#shown").locator("#player:not([hidden])").wait_for(timeout=60_000)
        assert page.locator("#score").inner_text() == "Score 0"
        assert page.evaluate("[scrollY, document.activeElement.tagName]") == [0, "BODY"], "the replay takes no focus"
        page.close()  # it asks its server until then
        (record,) = games.run_of("Crafter-v0").folder.records()
    calls = [event["arguments"] for event in sp.read_transcript(record) if event["event"] == "call"]
    assert [json.loads(sent)["action"] for sent in calls] == ["Move West", "Make Wood Pickaxe"]
