"""Prompts: the texts that this library, not the benchmark, adds around the games.

They are data files in a folder for each version, and a record names its version, because a changed text changes the
benchmark. The first sentence of the system text is the original's (with its typographic apostrophe); the rest describes
tools and windows, and gives no advice on any game.
"""

from __future__ import annotations

import functools
import re
from importlib import resources
from typing import Literal

from smartplay_tools.context.prompts.marks import CacheMarks, checked_marks, last_markable, stable_end
from smartplay_tools.context.prompts.pictures import PICTURE_BELOW, PICTURE_OF, with_pictures_below
from smartplay_tools.types import Prompt, ToolSpec
from smartplay_tools.types.messages import Message, text_of

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
