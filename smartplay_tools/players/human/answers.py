"""What a prompt asks a person for, and the messages that answer it: for the terminal and for the browser alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from smartplay_tools.conversation.paper import CHOICE
from smartplay_tools.types import Prompt
from smartplay_tools.types.messages import Message, text_of

Asked = Literal["call", "action", "words"]
"""A tool call; the name of an action, in the paper's protocol; or free text: thoughts, or a summary."""


def asked_for(prompt: Prompt) -> Asked:
    """Return what a prompt asks for."""
    if prompt.asks_for_summary:
        return "words"
    if prompt.tools:
        return "call"
    return "action" if text_of(prompt.messages[-1]) == CHOICE else "words"


def in_words(text: str) -> Message:
    """Return an answer in free text."""
    return {"role": "assistant", "content": text}


def named_action(typed: str, actions: Sequence[str]) -> str | None:
    """Return the action that was given as a number or a name, ignoring case and a final full stop; None for none."""
    if typed.isascii() and typed.isdigit() and 1 <= int(typed) <= len(actions):
        return actions[int(typed) - 1]
    named = {name.lower().removesuffix("."): name for name in actions}
    return named.get(typed.lower().removesuffix("."))
