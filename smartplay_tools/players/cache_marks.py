"""Cache marks: up to which messages a provider's cache is asked to store a prompt."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Prompt
from smartplay_tools.types.messages import Message, pictures_of, text_of

__all__ = ["CacheMarks", "checked_marks", "last_markable", "stable_end"]

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
