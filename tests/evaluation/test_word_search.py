"""A word over all prompts in the replay page: the page's answer is that of the prompts as the library rebuilds them."""

from __future__ import annotations

import json
from itertools import product

import pytest

import smartplay_tools as sp
from smartplay_tools.records import sent_prompts
from smartplay_tools.types.messages import text_of
from tests.adapters.conformance import calling

pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.slow

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"

BUDGETS = {
    "history": sp.Budget(history=3),
    "cap": sp.Budget(prompt_tokens=700),
    "masked": sp.Budget(history=2, beyond_history="mask"),
    "own words": sp.Budget(own_words=1),
    "first turns": sp.Budget(history=2, first_turns=1),
    "summary": sp.Budget(prompt_tokens=900, summary_tokens=100, slack=0.5),
}


class Talker:
    """Plays at random and says which turn it is."""

    name = "talker"

    def __init__(self) -> None:
        self._player, self._turn = sp.get_player("random", seed=1), 0

    def reply(self, prompt):
        reply = self._player.reply(prompt)
        self._turn += 1
        return sp.Reply({**reply.message, "content": f"Hunch {self._turn}."})


def recalling(path):
    """A record in which answers of `recall` repeat what has left, until they are masked themselves."""
    budget = sp.Budget(history=2, beyond_history="mask", recall_tokens=60)
    asked = [("act", {"action": "1"}), ("recall", {"query": "hunch 3 reward"})] * 8
    with sp.Episode(BANDIT, seed=3, budget=budget, transcript=path) as episode:
        sp.play(episode, sp.ScriptedPlayer([calling(call) for call in asked]))
    return path


def record(path, game, budget, protocol="tools"):
    with sp.Episode(game, seed=3, budget=budget, transcript=path) as episode:
        sp.play(episode, Talker(), protocol=protocol)
    return path


def test_the_prompts_with_a_word_are_those_that_the_library_rebuilds(show, tmp_path):
    (run := tmp_path / "run").mkdir()
    paths = {name: record(run / f"{name}.jsonl", BANDIT, BUDGETS[name]) for name in BUDGETS}
    paths |= {"recalled": recalling(run / "recalled.jsonl")}
    page = show(run)
    for (name, path), word in product(paths.items(), ["hunch 3", "reward -1", "after act"]):
        turns = page.evaluate("async ([key, word]) => promptsWith(await openEpisode(key), word)", [name, word])
        expected = {}
        for sent in sent_prompts(sp.read_transcript(path)):
            if sent.prompt.purpose == "play":
                calls = [json.dumps(message.get("tool_calls", [])) for message in sent.prompt.messages]
                texts = [text_of(message) for message in sent.prompt.messages]
                expected[sent.turn] = any(word in text.lower() for text in [*texts, *calls])
        assert turns == [expected[turn] for turn in range(len(turns))], (name, word)


def test_the_search_says_when_a_word_was_gone(show, tmp_path):
    page = show(record(tmp_path / "game.jsonl", HANOI, sp.Budget(history=2)), "#episode=game")
    page.keyboard.press("f")
    page.keyboard.type(["move the smallest disk", " rod a to rod b"][0][:4])
    assert "wrote it" in page.locator("#word-count").inner_text()
    assert page.locator("#word-strip rect").count() > 0
    page.locator("#word").fill("no such word")
    assert "No turn has written" in page.locator("#word-count").inner_text()


def test_a_bare_page_has_no_header_and_keeps_that_in_its_address(show, tmp_path):
    page = show(record(tmp_path / "game.jsonl", HANOI, sp.Budget()), "#episode=game&turn=2&bare")
    assert page.locator("header").is_hidden()
    page.keyboard.press("ArrowRight")
    assert page.url.endswith("turn=3&bare")
