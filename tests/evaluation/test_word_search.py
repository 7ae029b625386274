"""A word over all prompts in the replay page: the page's answer is that of the prompts as the library rebuilds them."""

from __future__ import annotations

import json
from itertools import product

import pytest

import smartplay_tools as sp
from smartplay_tools.records import sent_prompts
from smartplay_tools.types.messages import text_of
from tests.evaluation.report_runs import BANDIT, HANOI, act, converse, record, reply

pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.slow

BUDGETS = {
    "history": sp.Budget(history=3),
    "cap": sp.Budget(prompt_tokens=700),
    "masked": sp.Budget(history=2, beyond_history="mask"),
    "own words": sp.Budget(own_words=1),
    "first turns": sp.Budget(history=2, first_turns=1),
    "summary": sp.Budget(prompt_tokens=900, summary_tokens=100, slack=0.5),
    "recalled": sp.Budget(history=2, beyond_history="mask", recall_tokens=60),
}
RECALL = ("recall", json.dumps({"query": "hunch 3 reward"}))
"""What answers repeat of what has left, until they are masked themselves."""


def test_the_prompts_with_a_word_are_those_that_the_library_rebuilds(show, tmp_path):
    paths = {}
    for name, budget in BUDGETS.items():
        calls = [act("1"), RECALL if budget.recall_tokens else act("2")] * 25
        replies = [reply(call, content=f"Hunch {turn}.") for turn, call in enumerate(calls)]
        paths[name] = converse(tmp_path / "run" / f"{name}.jsonl", BANDIT, replies, budget=budget)
    page = show(tmp_path / "run")
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
    page = show(record(tmp_path / "game.jsonl", HANOI, "random", history=2), "#episode=game&turn=2&bare")
    assert page.locator("header").is_hidden()
    page.keyboard.press("ArrowRight")
    assert page.url.endswith("turn=3&bare"), "a page without its header stays so"
    page.keyboard.press("f")
    page.keyboard.type("move")
    assert "wrote it" in page.locator("#word-count").inner_text()
    assert page.locator("#word-strip rect").count() > 0
    page.locator("#word").fill("no such word")
    assert "No turn has written" in page.locator("#word-count").inner_text()
