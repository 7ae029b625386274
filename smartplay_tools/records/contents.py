"""Contents: finds what an action needs in a prompt, in a result of the game or in any other text.

What is needed of an observation is a few words that the game declares (`TextGame.needs`), or else its whole text, if no
other observation has the same. It stands in a text whose words are these in this order, with at most three other words
between two of them, none of which has a digit: `5 hearts` stands in "Card 5 is hearts". What a model says in a code of
its own, or counts up, is not found.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Set
from functools import lru_cache

from smartplay_tools.records.prompts import SentPrompt
from smartplay_tools.records.record import Record
from smartplay_tools.types import MEMORY_TOOL, NOTES_TOOL, RECALL_TOOL
from smartplay_tools.types.messages import Message, calls_of, reasoning_of, text_of

OBSERVATION, REPLY, WORDS, SUMMARY, MEMORY, NOWHERE = PLACES = (
    "observation",
    "newest reply",
    "own words",
    "summary",
    "memory",
    "nowhere",
)
"""Where a content stands: in a result of the game; in the model's newest reply, or in an older one; in what a strategy
or a compactor has written, which is a summary if a model was asked for it, and else a memory, as are notes and files.
A content that stands in several places is counted for the first of these."""

KEEPING = frozenset({NOTES_TOOL, RECALL_TOOL, MEMORY_TOOL})
"""The tools whose calls and results are a memory."""


@lru_cache(4096)
def _pattern(content: str) -> re.Pattern[str]:
    words = [re.escape(word) for word in re.findall(r"\w+", content)]
    between = r"(?:\W+(?!\w*\d)\w+){0,3}?\W+"
    return re.compile(rf"(?<!\w){between.join(words)}(?!\w)", re.IGNORECASE)


def stands_in(content: str, text: str) -> bool:
    """Return whether a content stands in a text."""
    return _pattern(content).search(text) is not None


class Places:
    """Finds contents in the prompts of one record."""

    def __init__(self, record: Record) -> None:
        turns = record.turns
        self._tools = {call["id"]: call["function"]["name"] for turn in turns for call in calls_of(turn.shown)}
        self._replies = [text_of(turn.shown) for turn in turns]
        self._said = {*self._replies}
        self._others = {text_of(item.message) for turn in turns for item in turn.items if item.position is None}
        asked = [event["turn"] for event in record.events if event["event"] in ("summary", "question")]
        self._asked_from = min(asked, default=len(turns) + 1)
        self._tasks = {text_of(message) for head in record.heads if "aged_task" in head for message in head["messages"]}
        self._has_notes = record.budget.get("notes_tokens") is not None
        self._found: dict[tuple[str, str], bool] = {}

    def of(self, sent: SentPrompt, shown: Set[int], contents: Mapping[int, str | None]) -> dict[int, str]:
        """Return the place in a prompt of what each step is needed for; the observations of some are `shown` whole.

        A content is None if it cannot be told from that of another step.
        """
        texts: dict[str, set[str]] = {}
        for place, text in self._texts(sent):
            texts.setdefault(place, set()).add(text)
        return {step: OBSERVATION if step in shown else self._place(contents[step], texts) for step in contents}

    def _place(self, content: str | None, texts: Mapping[str, set[str]]) -> str:
        for place in PLACES[:-1] if content else ():
            assert content
            if any(self._stands_in(content, text) for text in texts.get(place, ())):
                return place
        return NOWHERE

    def _stands_in(self, content: str, text: str) -> bool:
        key = content, text
        if key not in self._found:
            self._found[key] = stands_in(content, text)
        return self._found[key]

    def _texts(self, sent: SentPrompt) -> Iterator[tuple[str, str]]:
        """Yield the texts of a prompt, each with its place."""
        messages = sent.prompt.messages
        written = SUMMARY if sent.turn >= self._asked_from else MEMORY
        replies = [at for at, message in enumerate(messages) if message["role"] == "assistant"]
        for at, message in enumerate(messages):
            text = text_of(message)
            match message["role"]:
                case "system" | "developer":
                    if at or self._has_notes:
                        yield (MEMORY if not at else written), text
                case "tool":
                    name = self._tools.get(message["tool_call_id"])
                    yield MEMORY if name in KEEPING else written if name is None else OBSERVATION, text
                case "assistant":
                    yield from self._reply(message, REPLY if at == replies[-1] else WORDS, written)
                case _ if text in self._tasks:
                    yield OBSERVATION, text
                case _ if text not in self._others:
                    yield written, text

    def _reply(self, message: Message, place: str, written: str) -> Iterator[tuple[str, str]]:
        calls = calls_of(message)
        is_own = text_of(message) in self._said or any(call["id"] in self._tools for call in calls)
        yield place if is_own else written, f"{text_of(message)}\n{reasoning_of(message) or ''}"
        for call in calls:
            function = call["function"]
            yield MEMORY if function["name"] in KEEPING else place, function["arguments"]
