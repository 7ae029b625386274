"""Prompts: the texts that this library, not the benchmark, adds around the games.

They are data files in a folder for each version, and a record names its version, because a changed text changes the
benchmark. The first sentence of the system text is the original's (with its typographic apostrophe); the rest describes
tools and windows, and gives no advice on any game.

Where a prompt is marked for a provider's cache, which stores a prompt up to each mark.

Prompts for interfaces that refuse pictures in the results of tools: the pictures follow in a user message.

The lines around them are an interface's, as chat templates are: they are neither recorded nor counted.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from typing import Any, Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Prompt, ToolSpec
from smartplay_tools.types.messages import Message, pictures_of, text_of

__all__ = [
    "GAME_IS_OVER",
    "MANUAL_IS_ABOVE",
    "NO_MANUAL",
    "OBSERVATION_LEFT",
    "PICTURE_BELOW",
    "PICTURE_OF",
    "PICTURE_SHOWN",
    "VERSION",
    "CacheMarks",
    "checked_marks",
    "head",
    "last_markable",
    "received",
    "stable_end",
    "text",
    "with_pictures_below",
]


CacheMarks = bool | Literal["stable"]
"""What is marked: the ends of the prompt and of its stable part (True), the latter alone ("stable"), or nothing."""


def checked_marks(cache: CacheMarks) -> CacheMarks:
    """Return a choice of marks; anything else is an `InvalidArgumentError`."""
    if cache not in (True, False, "stable"):
        raise InvalidArgumentError(f'cache is True, "stable" or False, not {cache!r}.')
    return cache


def stable_end(prompt: Prompt, *, one_system_text: bool = False) -> int | None:
    """Return which message to mark for a provider's cache: the last stable one that can be marked; None if none can.

    Stable is what is unchanged since the previous prompt. Replies are not marked, because providers differ in which of
    their parts can be. With `one_system_text` all system messages come first in the request, so that nothing is stable
    if one of them is new.
    """
    stable, new = prompt.messages[: prompt.prefix_messages], prompt.messages[prompt.prefix_messages :]
    if one_system_text and any(message["role"] in ("system", "developer") for message in new):
        return None
    return last_markable(stable)


def last_markable(messages: Sequence[Message]) -> int | None:
    """Return the last of messages that can be marked for a provider's cache; None if none can.

    Such a message has a text, and is neither a reply nor a message of pictures (`with_pictures_below`).
    """
    return next((at for at in range(len(messages) - 1, -1, -1) if _is_markable(messages[at])), None)


def _is_markable(message: Message) -> bool:
    if message["role"] == "assistant" or (message["role"] == "user" and pictures_of(message)):
        return False
    return bool(text_of(message))


PICTURE_BELOW = "The picture is in the message below."
"""The last line of a result whose picture follows in a user message."""

PICTURE_OF = "The picture of the result of {id}:"
"""The words before a picture in that message."""


def with_pictures_below(prompt: Prompt) -> Prompt:
    """Return a prompt whose pictures are in a user message after the results of each turn, and not in the results."""
    if not prompt.pictures:
        return prompt
    shown, below, stable = list[Message](), list[dict[str, Any]](), 0
    for at, message in enumerate([*prompt.messages, _END]):
        if below and message["role"] != "tool":
            shown.append({"role": "user", "content": below})
            below = []
        if at == prompt.prefix_messages:
            stable = len(shown)
        if named := pictures_of(message):
            for part in named:
                below += [{"type": "text", "text": PICTURE_OF.format(id=message["tool_call_id"])}, dict(part)]
            message = message.copy()
            message["content"] = f"{text_of(message)}\n{PICTURE_BELOW}"
        shown.append(message)
    return replace(prompt, messages=shown[:-1], prefix_messages=stable)


_END: Message = {"role": "user", "content": None}
"""Stands after the last message, so that the pictures of the last results have a place before it."""


VERSION = "v1"
"""The version in use, which every transcript contains."""

OBSERVATION_LEFT = "[observation left the history window]"
"""The text of a result whose observation is older than the history limit."""

PICTURE_SHOWN = "The picture shows the current observation."
"""The text of a result whose observation is a picture only."""

MANUAL_IS_ABOVE = "The manual stands at the end of the system message."
"""The text of a `read_manual` result if the manual itself is in the head."""

NO_MANUAL = "There is no manual for this game."
"""The answer of `read_manual` if the manual is withheld."""

GAME_IS_OVER = "The game is over."
"""The last line of the result that ends a game."""


@functools.cache
def text(name: str) -> str:
    """Return one of the texts, by the name of its file: "system", "window", "task", "idle", "summary", "carried" ..."""
    file = resources.files(__package__).joinpath(VERSION, f"{name}.txt")
    return file.read_text(encoding="utf-8").removesuffix("\n")


def received(messages: list[Message], tools: tuple[ToolSpec, ...] = (), max_tokens: int | None = None) -> Prompt:
    """Return a prompt that came through a provider's interface; its last message tells if it asks for a summary."""
    last = messages[-1] if messages and messages[-1]["role"] == "user" else None
    is_request = last is not None and _summary_request().fullmatch(text_of(last)) is not None
    return Prompt(messages, tools, max_tokens, purpose="summary" if is_request else "play")


@functools.cache
def _summary_request() -> re.Pattern[str]:
    before, after = map(re.escape, text("summary_request").split("{tokens}"))
    return re.compile(rf"{before}\d+{after}")


def head(manual: str | None = None, *, context: Literal["window", "host"] = "window") -> list[Message]:
    """Return the first messages of every prompt: system and task; a manual ends the system message.

    The system message mentions forgetting only with `context="window"`, where this library decides what the model sees.
    """
    paragraphs = [
        text("system"),
        *([text("window")] if context == "window" else []),
        *([] if manual is None else [manual]),
    ]
    return [{"role": "system", "content": "\n\n".join(paragraphs)}, {"role": "user", "content": text("task")}]
