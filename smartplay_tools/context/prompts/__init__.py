"""Prompts: every text around the games, and the messages with which each prompt begins.

The sentences are in `wording`: every text around the games that comes from this library and not from the benchmark.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.types.messages import Message

__all__ = ["head"]


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
