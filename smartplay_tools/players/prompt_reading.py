"""The parser of prompts for the rule players.

Rule players have only the information that a model has: they parse the text of the messages and import no tables
of the games. This module extracts the parts that all of them need. It also reads the prompts of other hosts, which may
wrap results in JSON, list them out of order, or leave the manual in a result.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.context.prompts.wording import beginnings, in_any_version
from smartplay_tools.types import PAGES_TOOL, Prompt
from smartplay_tools.types.arguments import number_as_text
from smartplay_tools.types.messages import FunctionCall, Message, MessageToolCall, calls_of, text_of

STEP = re.compile(r"^Step (\d+): (.+)$", re.MULTILINE)
"""A line with the observation of a step that has left the window."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A tool call and its answer in the prompt."""

    tool: str
    action: str | None
    """The action in the arguments, for `act`."""
    text: str
    """The answer."""
    page: str | None = None
    """The page in the arguments, for `read_result`."""


@dataclass(frozen=True)
class Reading:
    """The contents of a prompt."""

    prompt: Prompt

    @cached_property
    def system(self) -> str:
        """The system text, and the manual once it was read: a window puts it there, a host leaves it in a result."""
        texts = [text_of(m) for m in self.prompt.shared if m["role"] in ("system", "developer")]
        return "\n\n".join([*texts, *self._manuals])

    @cached_property
    def _manuals(self) -> tuple[str, ...]:
        read = (s.text for s in self.seen if s.tool == "read_manual" and not is_error(s.text))
        others = in_any_version("manual_is_above") + in_any_version("no_manual")
        return tuple(text for text in read if text not in others)

    @cached_property
    def is_over(self) -> bool:
        """Whether the latest answer says that the game is over, after which a host may still ask for a reply."""
        latest = self.seen[-1].text if self.seen else ""
        refusal = next((latest.removeprefix(error) for error in beginnings("error") if latest.startswith(error)), "")
        return latest.endswith(in_any_version("game_is_over")) or refusal.startswith(beginnings("episode_is_over"))

    @property
    def actions(self) -> tuple[str, ...]:
        """The legal actions in the manual's numbering, read from the tool `act`; without tools, from the manual."""
        described = [tool.description for tool in self.prompt.tools if tool.name == "act"] or [self.system]
        return _numbered(described[0])

    @cached_property
    def seen(self) -> tuple[Seen, ...]:
        """Every visible call with its answer, oldest first."""
        seen: list[Seen] = []
        calls: Sequence[MessageToolCall] = ()
        answers: dict[int, str] = {}

        def settle() -> None:
            seen.extend(_seen(call, answers[at]) for at, call in enumerate(calls) if at in answers)
            answers.clear()

        for message in self.prompt.shared:
            if message["role"] == "assistant":
                settle()
                calls = calls_of(message)
            elif message["role"] == "tool":
                # Matched by id, or by order if the model repeats ids.
                call_id = message.get("tool_call_id")
                waiting = [at for at in range(len(calls)) if at not in answers]
                if waiting:
                    named = (at for at in waiting if calls[at].get("id") == call_id)
                    answers[next(named, waiting[0])] = _answer(message)
        settle()
        pages = {each.page: each.text for each in seen if each.tool == PAGES_TOOL}
        return tuple(_whole(each, pages) if pages and each.tool in ("act", "observe") else each for each in seen)

    @cached_property
    def next_page(self) -> str | None:
        """The page that the latest answer names as the next one, where it has an observation that was too long."""
        latest = self._latest_answer
        match = None if latest is None else _page_line(in_any_version("next_page")).search(latest)
        return None if match is None else match[match.lastindex or 0]

    @cached_property
    def _latest_answer(self) -> str | None:
        answers = [message for message in self.prompt.shared if message["role"] == "tool"]
        return _answer(answers[-1]) if answers else None

    @cached_property
    def observations(self) -> tuple[str, ...]:
        """The visible observations, oldest first: answers to `act` and `observe` that are still in the window.

        Lines `Step 3: TEXT` of the user's, as a custom strategy writes them, come before these.
        """
        users = (m for m in self.prompt.shared if m["role"] == "user" and not is_carried(m))
        told = (text for message in users for _, text in STEP.findall(text_of(message)))
        first = (text for message in self.prompt.shared for text in first_observation(message))
        answers = (s.text for s in self.seen if s.tool in ("act", "observe"))
        shown = (text for text in answers if text not in in_any_version("observation_left") and not is_error(text))
        return (*told, *first, *shown)

    @cached_property
    def is_start(self) -> bool:
        """Whether no reply of the player is visible."""
        return not any(message["role"] == "assistant" for message in self.prompt.shared)


def first_observation(message: Message) -> tuple[str, ...]:
    """Return the observation with which a task ends, as a tuple of one; an empty one for every other message."""
    tasks = (f"{task}\n\n" for task in in_any_version("task")) if message["role"] == "user" else ()
    text = text_of(message)
    return tuple(text.removeprefix(task) for task in tasks if text.startswith(task))[:1]


def is_carried(message: Message) -> bool:
    """Whether a message is about the game that was played before this one, in another world."""
    return message["role"] == "user" and text_of(message).startswith(in_any_version("carried"))


def is_error(text: str) -> bool:
    """Whether a result is a refusal."""
    return text.startswith(beginnings("error"))


@functools.cache
def _page_line(sentences: tuple[str, ...]) -> re.Pattern[str]:
    """The last line of an observation that was too long; its only group that matches is the next page."""
    missing, page = re.escape("{missing}"), re.escape("{page}")
    lines = [re.escape(text) for text in sentences]
    lines = [line.replace(missing, r"-?\d+").replace(page, r"(r\d+\.\d+)") for line in lines]
    return re.compile(rf"\n(?:{'|'.join(lines)})$")


@functools.lru_cache(64)
def _numbered(text: str) -> tuple[str, ...]:
    """The names in the last numbered list of a text: a manual may contain others before that of the actions."""
    numbered = re.findall(r"^(\d+)\. (.+)$", text, flags=re.MULTILINE)
    start = max((at for at, (number, _) in enumerate(numbered) if number == "1"), default=0)
    return tuple(name for _, name in numbered[start:])


def _seen(call: MessageToolCall, text: str) -> Seen:
    """A call with its answer."""
    function = call["function"]
    try:
        arguments = json.loads(function["arguments"])
        action, page = number_as_text(arguments.get("action")), arguments.get("page")
    except (ValueError, TypeError, AttributeError, RecursionError):
        action = page = None
    action, page = (value if isinstance(value, str) else None for value in (action, page))
    return Seen(function["name"], action, text, page)


def _whole(seen: Seen, pages: Mapping[str | None, str]) -> Seen:
    """An observation with those of its pages that are visible."""
    text = seen.text
    while (match := _page_line(in_any_version("next_page")).search(text)) and (
        page := match[match.lastindex or 0]
    ) in pages:
        text = text[: match.start()] + pages[page]
    return replace(seen, text=text)


def _answer(message: Message) -> str:
    """The text of a result: what the game's tool has answered."""
    return without_budget_line(_unwrapped(text_of(message)))


def _unwrapped(text: str) -> str:
    """The text in a result that a host wrapped: in a JSON string, in a list of parts, in an object with one text."""
    if not text.lstrip().startswith(("{", "[", '"')):
        return text
    try:
        inner = _text_in(json.loads(text))
    except (ValueError, RecursionError):
        return text
    return text if inner is None else inner


def _text_in(value: Any) -> str | None:
    if isinstance(value, str):
        return value
    if isinstance(value, list):
        texts = [text for text in map(_text_in, value) if text is not None]
        return "".join(texts) if texts else None
    if isinstance(value, Mapping):
        inner = (_text_in(value[key]) for key in ("text", "content", "value", "output", "result") if key in value)
        return next((text for text in inner if text is not None), None)
    return None


def call(tool: str, *, say: str | None = None, **arguments: str) -> Message:
    """Return an assistant message that calls one tool, with the text `say` if it is given."""
    # Texts are encoded one by one, which takes half the time of an encoder for dictionaries.
    fields = [f"{_text(name)}: {_text(value)}" for name, value in arguments.items()]
    function: FunctionCall = {"name": tool, "arguments": f"{{{', '.join(fields)}}}"}
    tool_call: MessageToolCall = {"id": "call_0", "type": "function", "function": function}
    return {"role": "assistant", "content": say, "tool_calls": [tool_call]}


_text = json.encoder.encode_basestring
"""Encodes a text as JSON."""
