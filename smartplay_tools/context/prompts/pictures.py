"""Prompts for interfaces that refuse pictures in the results of tools: the pictures follow in a user message.

The lines around them are an interface's, as chat templates are: they are neither recorded nor counted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from smartplay_tools.types import Prompt
from smartplay_tools.types.messages import Message, pictures_of, text_of

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
