"""What `recall` has to find, by brute force: written from `docs/strategies.md`, with nothing of the package."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any

from tests.counting import plain_text

if TYPE_CHECKING:
    from tests.judge import Judge

WORD = re.compile(r"[^\W_]+")
STEPS = re.compile(r"\s*([0-9]{1,6})\s*(-\s*([0-9]{1,6})\s*)?")
Document = tuple[int, str]
"""A step, and the text of its document."""


def documents(judge: Judge, k: int) -> list[Document]:
    """The documents of a reply to the prompt of k turns: what these have shown and the prompt does not."""
    visible = set()
    for i, hidden in judge.shown(k):
        turn = judge.turns[i]
        for was, now, step in zip(turn["messages"], judge.seen(i, k, hidden), turn["shows"], strict=True):
            if step is not None and not judge.is_marked(i, turn["messages"].index(was), now):
                visible.add(step)
    texts: dict[int, str] = {}
    for turn in judge.turns[:k]:
        for message, step in zip(turn["messages"], turn["shows"], strict=True):
            if step is not None and step not in texts:
                texts[step] = f"Step {step}, after {_played(turn, message)}:\n{plain_text(message['content'])}"
    return [(step, text) for step, text in sorted(texts.items()) if step not in visible]


def _played(turn: dict[str, Any], result: dict[str, Any]) -> str:
    [call] = [call for call in turn["messages"][0]["tool_calls"] if call["id"] == result["tool_call_id"]]
    if call["function"]["name"] == "observe":
        return "observe()"
    return 'act("' + json.loads(call["function"]["arguments"])["action"].strip() + '")'


def words(text: str) -> list[str]:
    """The words of a document, or of a query."""
    return [word.lower() for word in WORD.findall(text)]


def listed(having: list[Document], query: str) -> list[Document]:
    """The documents that a query matches, in the order of the answer."""
    if steps := STEPS.fullmatch(query):
        first, last = int(steps[1]), int(steps[3] or steps[1])
        return [(step, text) for step, text in having if first <= step <= last]
    asked = list(dict.fromkeys(words(query)))
    matching = [(step, text) for step, text in having if set(asked) & set(words(text))]
    return sorted(matching, key=lambda document: (-score(document[1], asked, having), -document[0]))


def score(text: str, asked: list[str], having: list[Document]) -> float:
    """BM25 of a document for the words of a query, each once."""
    total, mean = 0.0, sum(len(words(other)) for _, other in having) / len(having)
    for word in asked:
        f, n = words(text).count(word), sum(word in words(other) for _, other in having)
        idf = math.log(1 + (len(having) - n + 0.5) / (n + 0.5))
        total += idf * f * 2.2 / (f + 1.2 * (0.25 + 0.75 * len(words(text)) / mean))
    return round(total, 9)
