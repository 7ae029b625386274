"""The replay page in a browser: its prompts, its navigation, its display, and that nothing else runs or loads.

Every test fails on an error in the browser's console and on any request that leaves the file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.context.strategies import custom
from smartplay_tools.context.strategies.notes import Notes
from smartplay_tools.records import Record
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.types.messages import pictures_of
from tests import fuzz
from tests.evaluation.players import Broken
from tests.evaluation.report_runs import (
    BANDIT,
    HANOI,
    HOSTILE,
    RPS,
    act,
    converse,
    hostile,
    record,
    reply,
)

pytestmark = pytest.mark.slow


# Prompts, word for word.

ALL_PROMPTS = """async (key) => {
  const episode = await openEpisode(key);
  const messages = (way, at) => way(episode, page.words[episode.prompts], at)?.map(({ message }) => message) ?? null;
  return episode.turns.flatMap((_, at) => [requestParts, promptParts].map((way) => messages(way, at)));
}"""


def assert_the_same_prompts(page: Any, path: Path) -> int:
    """Compare every prompt that the page puts together with what the library rebuilds; return how many there were."""
    shown = page.evaluate(ALL_PROMPTS, path.stem)
    sent = list(sent_prompts(sp.read_transcript(path)))
    expected: list[Any] = [None] * len(shown)
    for one in sent:
        assert one.sha256 == one.recorded_sha256
        expected[2 * one.turn + (one.prompt.purpose == "play")] = json.loads(json.dumps(one.prompt.messages))
    assert shown == expected
    return len(sent)


@pytest.mark.parametrize("observation", ["picture", "both"])
def test_the_page_shows_the_pictures_that_the_model_saw(show, tmp_path, observation):
    masking = {"history": 3, "beyond_history": "mask"}
    path = record(tmp_path / "seen.jsonl", "Crafter-v0", "random", observation=observation, tool_calls=8, **masking)
    page = show(path, "#episode=seen&turn=7")
    assert_the_same_prompts(page, path)
    assert page.locator("#answers img.seen-picture").evaluate_all("all => all.map((one) => one.naturalWidth)") == [252]
    *_, last = sent_prompts(sp.read_transcript(path))
    assert sum(len(pictures_of(message)) for message in last.prompt.messages) == 4
    assert "4 pictures in all" in page.locator("#sentence").inner_text()
    page.evaluate("document.getElementById('prompt').open = true")
    page.wait_for_function("document.querySelectorAll('#messages img.seen-picture').length === 4")


@pytest.mark.parametrize(("observation", "marker"), [("both", 0), ("picture", 4)])
def test_the_page_leaves_out_the_pictures_that_the_prompt_left_out(show, tmp_path, observation, marker):
    path = record(
        tmp_path / "new.jsonl", "Crafter-v0", "random", observation=observation, tool_calls=8, newest_pictures=2
    )
    page = show(path, "#episode=new&turn=7")
    assert_the_same_prompts(page, path)
    sentence = page.locator("#sentence").inner_text()
    assert "2 pictures in all; 5 older pictures left out" in sentence
    assert page.evaluate("markedResults(shown.episode, shown.episode.turns[7].view).length") == marker
    page.evaluate("askAbout(1)")
    assert "only the newest 2 pictures of the conversation were shown" in page.locator("#why-reason").inner_text()


class Clearing:
    """A compactor that has a message in place of all but the newest nine, and clears the first result among these."""

    def compact(self, history, room):
        if len(history) < 12 or history[-9]["role"] == "tool":
            return history
        result = next(message for message in history[-9:] if message["role"] == "tool")
        result["content"] = "cleared"
        return [history[0], {"role": "user", "content": "So far so good."}, *history[-9:]]


def test_every_prompt_is_put_together_word_for_word(show, tmp_path, monkeypatch):
    monkeypatch.setitem(custom._NAMED, "clearing", custom.Loaded(Clearing))
    run = tmp_path / "run"
    several = [reply(act("1"), act("2"), act("1")), reply(("read_manual", "")), reply(("observe", ""), act("1"))]
    paths = [
        record(run / "fills.jsonl", BANDIT, prompt_tokens=700),
        record(run / "slack.jsonl", BANDIT, "random", prompt_tokens=800, slack=0.5),
        record(run / "history.jsonl", RPS, history=3),
        record(run / "bare.jsonl", RPS, "rule-notes", prompt_tokens=900, own_words=2, notes_tokens=60),
        record(
            run / "anchors.jsonl", RPS, "rule-notes", prompt_tokens=1_000, first_turns=2, summary_tokens=60, slack=0.5
        ),
        record(run / "custom.jsonl", RPS, prompt_tokens=900, strategy=f"{fuzz.ODD}:seed=3"),
        record(run / "compacted.jsonl", BANDIT, "rule-notes", history=3, notes_tokens=60, strategy="clearing"),
        record(run / "pinned.jsonl", RPS, manual="pinned", prompt_tokens=900, history=10),
        record(run / "paper.jsonl", HANOI, protocol="paper", manual="pinned", prompt_tokens=600),
        record(run / "paper-history.jsonl", BANDIT, "random", protocol="paper", manual="none", history=2),
        record(run / "messenger.jsonl", "MessengerL2-v0", prompt_tokens=700),
        converse(run / "marks.jsonl", BANDIT, several * 5, budget=sp.Budget(history=1)),
        hostile(run / "hostile.jsonl"),
        handed_over(run / "handed-over.jsonl"),
        record(run / "masked.jsonl", BANDIT, "rule-notes", history=3, beyond_history="mask", prompt_tokens=600),
        record(run / "notes.jsonl", RPS, "rule-notes", notes_tokens=60, prompt_tokens=800),
        record(run / "summaries.jsonl", BANDIT, "rule-notes", summary_tokens=60, slack=0.5, prompt_tokens=600),
        record(
            run / "everything.jsonl",
            BANDIT,
            "rule-notes",
            history=9,
            beyond_history="mask",
            notes_tokens=60,
            summary_tokens=60,
            slack=0.3,
            prompt_tokens=700,
        ),
    ]
    views = [event for path in paths for event in sp.read_transcript(path) if event["event"] == "view"]
    assert any(view.get("masked") for view in views), "some results are marked"
    assert any(view["dropped_turns"] for view in views), "some turns are dropped"
    page = show(run)
    assert sum(assert_the_same_prompts(page, path) for path in paths) == len(views)


def handed_over(path: Path) -> Path:
    """A host that changes its instructions between prompts, the last time after the manual was read."""
    with sp.Episode(BANDIT, seed=1, transcript=path) as episode:
        session = sp.AgentSession(episode, head=[{"role": "system", "content": "Begin."}])
        for words, answer in (("Begin.", reply(act("1"))), ("Go on.", reply(("read_manual", ""))), ("Stop.", reply())):
            session.change_head([{"role": "system", "content": words}], [])
            session.prompt()
            for call in session.receive(answer):
                session.answer(call.id)
    return path


def test_the_prompt_can_be_read_on_the_page(show, tmp_path):
    items = [{"type": "thinking", "thinking": "Then that."}]
    thoughts = {"content": "Hm.", "name": "player", "reasoning_content": "First this.", "provider_items": items}
    replies = [reply(act("1"), act("2"), **thoughts)] * 6
    path = converse(tmp_path / "marks.jsonl", BANDIT, replies, budget=sp.Budget(history=0))
    page = show(path, "#episode=marks&turn=4")
    assert page.locator("#messages .message").count() == 0, "made when it is opened"
    page.get_by_text("The prompt, word for word", exact=True).click()
    [last] = [sent for sent in sent_prompts(sp.read_transcript(path)) if sent.turn == 4]
    cards = page.locator("#messages .message:not(.schema)")
    cards.first.wait_for()
    assert cards.count() == len(last.prompt.messages)
    for at, message in enumerate(last.prompt.messages):
        if message["content"]:
            assert message["content"] in cards.nth(at).locator("pre").all_text_contents()
    assert "[observation left the history window]" in page.locator(".message.is-marked pre").first.text_content()
    card = page.locator("#messages .message.assistant").first
    assert card.locator("h3").text_content().startswith("assistant (player) of turn")
    assert all(thought in card.locator("details pre").text_content() for thought in ("First this.", "Then that."))


# The context band.


def test_the_band_says_which_turns_were_seen_marked_or_dropped_and_how_full_the_budget_was(show, tmp_path):
    several = [reply(act("1"), act("2"))] * 12
    budget = sp.Budget(history=4, prompt_tokens=900)
    path = converse(tmp_path / "band.jsonl", BANDIT, several, budget=budget)
    view = next(event for event in sp.read_transcript(path) if event["event"] == "view" and event["turn"] == 9)
    page = show(path, "#episode=band&turn=9")
    seen = {turn for first, last in view["turns"] for turn in range(first, last + 1)}
    marked = {turn for turn, _ in view["masked"]}
    assert marked
    assert len(seen) < 9
    cells = page.locator("#band .cell")
    states = [cells.nth(at).get_attribute("class") for at in range(9)]
    expected = ["marked" if at in marked else "seen" if at in seen else "dropped" for at in range(9)]
    assert states == [f"cell {state}" for state in expected]
    assert f"{view['tokens']:,} of 900 tokens" in page.locator("#gauge").text_content()
    assert "nothing of turns 0 to" in page.locator("#sentence").text_content()


def test_a_click_on_a_turn_that_is_gone_says_why_and_what_it_said(show, tmp_path):
    page = show(record(tmp_path / "gone.jsonl", BANDIT, history=None, prompt_tokens=700), "#episode=gone&turn=20")
    page.locator("#band .cell.dropped").last.click()
    reason = page.locator("#why-reason").text_content()
    assert "left before prompt" in reason
    assert "of 700 were free" in reason
    assert "it would have stayed" in reason
    assert "You pulled slot machine" in page.locator("#why-said").text_content()
    page.get_by_role("spinbutton", name="Turn").fill("19")
    assert "was in this prompt in full" in page.locator("#why-reason").text_content()
    page.get_by_role("button", name="go to this turn").click()
    assert page.locator("#turn-title").text_content() == "Turn 19"


def test_a_turn_is_copied_as_markdown(show, tmp_path):
    replies = [reply(act("1"), content="I say ```this```.")]
    page = show(converse(tmp_path / "copied.jsonl", BANDIT, replies), "#episode=copied&turn=0")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.get_by_role("button", name="copy as Markdown").click()
    page.get_by_role("button", name="copied").wait_for()
    lines = page.evaluate("navigator.clipboard.readText()").splitlines()
    assert lines[0] == f"### {BANDIT}, script, seed 7, turn 0"
    assert "> I say ```this```." in lines
    assert 'act {"action": "1"}' in lines


def test_a_prompt_is_read_beside_any_other(show, tmp_path):
    page = show(record(tmp_path / "beside.jsonl", BANDIT, history=3), "#episode=beside&turn=20")
    page.wait_for_function("() => shown.episode?.key === 'beside' && document.getElementById('slider').value === '20'")
    page.keyboard.press("p")
    page.wait_for_function("() => document.getElementById('beside').value === '19'")  # `toggle` comes later
    assert page.text_content("#difference") == "2 messages only here, 2 messages only there."
    assert "of turn 19" in page.locator("#messages .message.new").first.text_content()
    assert page.locator("#messages .gone").count() == 0, "it is the prompt, until another one is asked for"
    page.get_by_role("spinbutton", name="compared with the prompt of turn").fill("19")
    assert "of turn 15" in page.locator("#messages .message.gone").first.text_content()
    page.get_by_role("spinbutton", name="compared with the prompt of turn").fill("20")
    assert page.locator("#messages .new, #messages .gone").count() == 0
    page.get_by_role("spinbutton", name="compared with the prompt of turn").fill("30")
    page.locator("#episode-title").click()
    page.keyboard.press("ArrowRight")
    assert page.get_by_role("spinbutton", name="compared with the prompt of turn").input_value() == "31", (
        "it stays as far away"
    )


def test_a_turn_that_another_strategy_than_notes_pins_is_called_pinned(show, tmp_path, monkeypatch):
    monkeypatch.setattr(Notes, "records_pin_as", "pinned")
    replies = [reply(("take_notes", json.dumps({"text": "He likes Rock."}))), *[reply(act("1"))] * 50]
    budget = sp.Budget(notes_tokens=60, prompt_tokens=700)
    path = converse(tmp_path / "pins.jsonl", RPS, replies, budget=budget)
    views = Record.read(path).views
    turn, pinned = next((view["turn"], view["pinned"]) for view in views if view["pinned"] is not None)
    page = show(path, f"#episode=pins&turn={turn}")
    assert_the_same_prompts(page, path)
    assert f"turn {pinned}, pinned by a strategy" in page.locator("#sentence").inner_text()
    assert page.locator("#band .cell.pinned title").text_content() == f"turn {pinned}: pinned"
    page.evaluate("document.getElementById('why').open = true")
    page.get_by_role("spinbutton", name="Turn", exact=True).fill(str(pinned))
    assert f"A strategy had pinned turn {pinned}" in page.locator("#why-reason").inner_text()


def test_the_tokens_of_prompts_are_stacked_by_part(show, tmp_path):
    path = record(tmp_path / "parts.jsonl", BANDIT, "rule-notes", history=3, notes_tokens=200)
    views = Record.read(path).views
    page = show(path, "#episode=parts&turn=30")
    table = [row.split("\t") for row in page.locator("#parts table").inner_text().splitlines()]
    assert table[0] == ["part", "this prompt", "all prompts", "share"]
    assert {"task and tools", "notes", "observations"} <= {row[0] for row in table}
    now, everything = (sum(int(row[column].replace(",", "")) for row in table[1:]) for column in (1, 2))
    assert (now, everything) == (views[30]["tokens"], sum(view["tokens"] for view in views))
    assert page.locator("#tokens path").count() == len(table) - 1


# Moving about.


def test_keys_slider_and_buttons_move_and_the_address_follows(show, tmp_path):
    page = show(record(tmp_path / "bandit.jsonl", BANDIT, prompt_tokens=700), "#episode=bandit&turn=3")
    place = page.locator("#place")

    def turn() -> int:
        assert page.evaluate("location.hash") == f"#episode=bandit&turn={page.locator('#slider').input_value()}"
        return int(page.locator("#slider").input_value())

    assert turn() == 3
    for keys, expected in [
        (["ArrowRight"], 4),
        (["Shift+ArrowRight"], 14),
        (["ArrowLeft"], 13),
        (["End"], 49),
        (["ArrowRight"], 49),
        (["Home"], 0),
    ]:
        for key in keys:
            page.keyboard.press(key)
        assert turn() == expected
    page.get_by_role("slider", name="Turn").focus()
    page.keyboard.press("ArrowRight")
    assert turn() == 1
    page.get_by_role("slider", name="Turn").fill("20")
    assert turn() == 20
    page.get_by_role("button", name="Next turn").click()
    assert place.text_content() == "turn 21 of 49, step 22"
    assert page.locator("#announce").text_content() == "Turn 21. act answered"
    page.get_by_role("button", name="Last turn").click()
    assert turn() == 49


def test_from_the_run_to_an_episode_and_back_by_keyboard_alone(show, tmp_path):
    record(tmp_path / "run" / "a.jsonl", HANOI)
    record(tmp_path / "run" / "b.jsonl", BANDIT)
    page = show(tmp_path / "run")
    page.get_by_role("link", name=BANDIT).focus()
    page.keyboard.press("Enter")
    page.locator("#player:visible").wait_for()
    assert page.evaluate("document.activeElement.id") == "episode-title"
    page.keyboard.press("b")
    page.wait_for_function("() => document.title.startsWith('Hanoi')")
    assert page.locator("#episode-before").is_disabled(), "it leads nowhere"
    page.keyboard.press("Escape")
    page.locator("#run:visible").wait_for()
    assert page.evaluate("document.activeElement.textContent") == HANOI
    page.keyboard.press("?")
    assert page.get_by_role("dialog", name="Keys").is_visible()
    page.keyboard.press("Escape")
    assert not page.get_by_role("dialog", name="Keys").is_visible()


def test_episodes_can_be_found_and_sorted(show, tmp_path, monkeypatch):
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.page.LISTED_AT_ONCE", 1)
    for name, game in (("a", HANOI), ("b", BANDIT), ("c", RPS)):
        record(tmp_path / "run" / f"{name}.jsonl", game)
    page = show(tmp_path / "run")
    rows = page.locator("#episodes tbody tr:visible")
    assert page.locator("#count").text_content() == "3 episodes, the first 1 listed"
    page.get_by_role("searchbox", name="Find").fill("bandit roll")
    assert rows.count() == 1
    assert page.locator("#count").text_content() == "1 episode"
    page.get_by_role("searchbox", name="Find").fill("")
    page.evaluate("location.hash = '#episode=c&turn=0'")
    page.wait_for_function("() => !document.getElementById('player').hidden")
    page.keyboard.press("Escape")
    page.wait_for_function("() => document.activeElement.textContent.startsWith('RockPaper')")
    page.get_by_role("button", name="list all").click()
    page.get_by_role("button", name="steps").click()
    assert rows.locator("th").all_text_contents()[-1] == HANOI
    page.get_by_role("button", name="steps").click()
    assert rows.locator("th").all_text_contents()[0] == HANOI


def test_mistakes_are_marked_and_found(show, tmp_path):
    replies = [reply(act("1")), reply(act("fly")), reply(act("2")), reply(content="Hm."), reply(act("1"))]
    page = show(converse(tmp_path / "wrong.jsonl", BANDIT, replies), "#episode=wrong&turn=0")
    assert page.get_by_role("img", name="Mistakes in 2 turns").count() == 1
    page.keyboard.press("m")
    assert page.locator("#turn-title").text_content() == "Turn 1"
    assert "error: illegal" in page.locator(".answer.error h4").text_content()
    page.get_by_role("button", name="next mistake").click()
    assert "called no tool" in page.locator("#answers").text_content()
    page.keyboard.press("M")
    assert page.locator("#turn-title").text_content() == "Turn 1"


def test_of_several_calls_in_a_message_each_can_be_looked_at(show, tmp_path):
    replies = [reply(act("1"), act("2"), act("4"))]
    page = show(converse(tmp_path / "hanoi.jsonl", HANOI, replies), "#episode=hanoi&turn=0")
    assert page.locator("#game-step").text_content() == "after step 3, score 2"
    page.get_by_role("button", name="show the game here").first.click()
    assert page.locator("#game-step").text_content() == "after step 1, score 0"
    assert page.get_by_role("img", name="A: 2, 1; B: 0; C: empty").count() == 1


# What a person sees.


def test_every_game_is_drawn(show, tmp_path):
    run = tmp_path / "run"
    record(run / "bandit.jsonl", BANDIT)
    record(run / "rps.jsonl", RPS)
    record(run / "hanoi.jsonl", HANOI)
    record(run / "messenger.jsonl", "MessengerL2-v0")
    record(run / "crafter.jsonl", "Crafter-v0", "random", tool_calls=20)
    page = show(run)
    expected = {
        "bandit": "2 of 3 pulls went to the better machine.|1 of 3 pulls|3 of 3 pulls|0 of 3 pulls",
        "rps": "rounds were played with it",
        "hanoi": "Move the top disk of rod",
        "messenger": "The message is",
        "crafter": "daylight",
    }
    for key, words in expected.items():
        page.evaluate("(key) => (location.hash = `#episode=${key}&turn=2`)", key)
        page.wait_for_function("(key) => location.hash.includes(key) && shown.episode?.key === key", arg=key)
        assert any(word in page.locator("#game").text_content() for word in words.split("|"))
        assert page.locator("#game [role=img]").count() >= 1
        assert "played again" in page.locator("#source").text_content()
        drawn = page.locator("#game").screenshot()
        page.keyboard.press("ArrowLeft")
        assert page.locator("#game").screenshot() != drawn, "another step, another picture"


def test_failed_and_unfinished_episodes_can_be_opened(show, tmp_path):
    whole = record(tmp_path / "run" / "whole.jsonl", BANDIT).read_text().splitlines(keepends=True)
    (tmp_path / "run" / "start.jsonl").write_text(whole[0])
    (tmp_path / "run" / "prompt.jsonl").write_text("".join(whole[:3]))
    with sp.Episode(HANOI, seed=1, transcript=tmp_path / "run" / "failed.jsonl") as episode:
        sp.play(episode, Broken(seed=1))
    page = show(tmp_path / "run", "#episode=start&turn=0")
    assert "unfinished" in page.locator("#chips").text_content()
    for key, words in (("prompt", "No reply came to this prompt."), ("failed", "No reply came to this prompt.")):
        page.evaluate("(key) => (location.hash = `#episode=${key}&turn=0`)", key)
        page.wait_for_function("(key) => shown.episode?.key === key", arg=key)
        assert words in page.locator("#said").text_content()
    page.get_by_text("Rules, budget and versions").click()
    assert "RuntimeError: no more ideas" in page.locator("#rules").text_content()
    assert "Traceback" in page.locator("#rules pre").text_content()


def test_light_and_dark_follow_the_reader_and_the_button(show, tmp_path):
    record(tmp_path / "hanoi.jsonl", HANOI)

    def ground(page: Any) -> str:
        return page.evaluate("getComputedStyle(document.body).backgroundColor")

    light = show(tmp_path / "hanoi.jsonl", color_scheme="light")
    dark = show(None, color_scheme="dark")
    was_light, was_dark = ground(light), ground(dark)
    assert was_light != was_dark
    light.get_by_role("button", name="Light or dark").click()
    dark.keyboard.press("t")
    assert (ground(light), ground(dark)) == (was_dark, was_light)


# Nothing runs, nothing loads.


def test_what_a_model_wrote_is_read_and_never_run(show, tmp_path):
    path = hostile(tmp_path / "hostile.jsonl")
    page = show(path)
    assert HOSTILE in page.locator("#episodes").text_content()
    for turn in range(5):
        page.evaluate("(turn) => (location.hash = `#episode=hostile&turn=${turn}`)", turn)
        page.wait_for_function("(turn) => shown.turn === turn && !$('player').hidden", arg=turn)
        page.evaluate("() => document.querySelectorAll('details').forEach((one) => (one.open = true))")
        page.wait_for_timeout(30)
        assert HOSTILE in page.locator("#player").text_content()
        assert page.evaluate("document.querySelectorAll('main img').length") == 0
        assert page.evaluate("document.scripts.length") == page.evaluate(
            "document.querySelectorAll('body > script').length"
        )
    assert page.title() != "taken"
