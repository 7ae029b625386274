"""Prompts: the head, where a provider's cache is marked, and where pictures stand.

The sentences are in `wording`: every text around the games that comes from this library and not from the benchmark. A
provider's cache stores a prompt up to each mark (`stable_end`). Some interfaces refuse pictures in the results of
tools; `with_pictures_below` moves the pictures into a user message after the results. The lines that it adds around the
pictures belong to the interface, like those of a chat template, and are neither recorded nor counted.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

from smartplay_tools.context.prompts.wording import VERSION, Wording, in_any_version
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Prompt, ToolSpec
from smartplay_tools.types.messages import Message, pictures_of, text_of

__all__ = [
    "CacheMarks",
    "checked_marks",
    "head",
    "last_markable",
    "received",
    "stable_end",
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


def with_pictures_below(prompt: Prompt) -> Prompt:
    """Return a prompt whose pictures are in a user message after the results of each turn, and not in the results."""
    if not prompt.pictures:
        return prompt
    words = Wording.of(prompt.version or VERSION)
    shown, below, stable = list[Message](), list[dict[str, Any]](), 0
    for at, message in enumerate([*prompt.messages, _END]):
        if below and message["role"] != "tool":
            shown.append({"role": "user", "content": below})
            below = []
        if at == prompt.prefix_messages:
            stable = len(shown)
        if named := pictures_of(message):
            for part in named:
                below += [{"type": "text", "text": words("picture_of", id=message["tool_call_id"])}, dict(part)]
            message = message.copy()
            message["content"] = f"{text_of(message)}\n{words('picture_below')}"
        shown.append(message)
    return replace(prompt, shared=shown[:-1], prefix_messages=stable)


_END: Message = {"role": "user", "content": None}
"""Stands after the last message, so that the pictures of the last results have a place before it."""


def received(messages: list[Message], tools: tuple[ToolSpec, ...] = (), max_tokens: int | None = None) -> Prompt:
    """Return a prompt that came through a provider's interface; its last message tells if it asks for a summary."""
    last = messages[-1] if messages and messages[-1]["role"] == "user" else None
    is_request = (
        last is not None and _summary_request(in_any_version("summary_request")).fullmatch(text_of(last)) is not None
    )
    return Prompt(messages, tools, max_tokens, purpose="summary" if is_request else "play")


@functools.cache
def _summary_request(sentences: Sequence[str]) -> re.Pattern[str]:
    requests = (map(re.escape, text.split("{tokens}")) for text in sentences)
    return re.compile("|".join(r"\d+".join(parts) for parts in requests))


def head(
    words: Wording,
    manual: str | None = None,
    *,
    context: Literal["window", "host"] = "window",
    observation: str | None = None,
    withheld: Iterable[str] = (),
) -> list[Message]:
    """Return the first messages of every prompt: system and task; a manual ends the system message.

    The first observation ends the task, where the rules put it there. The system message does not tell of tools that
    are withheld.

    The system message mentions forgetting only with `context="window"`, where this library decides what the model sees.
    """
    paragraphs = [
        _without(withheld, words("system")),
        *([words("window")] if context == "window" else []),
        *([] if manual is None else [manual]),
    ]
    task = [words("task"), *([] if observation is None else [observation])]
    return [{"role": "system", "content": "\n\n".join(paragraphs)}, {"role": "user", "content": "\n\n".join(task)}]


def _without(tools: Iterable[str], sentence: str) -> str:
    """Return a sentence without the clauses that tell of some tools, each between two marks of punctuation."""
    for name in sorted(tools):
        sentence = re.sub(rf"[,;]\s[^,;.`]*`{name}`[^,;.]*", "", sentence)
    return sentence
