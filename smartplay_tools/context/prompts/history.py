"""What later prompts hold of a reply, and what is counted of its thoughts: one set of rules for each version.

Version 1 repeats the arguments of a call as the model wrote them, and counts the thoughts that stand where OpenAI and
Anthropic put them. Servers that parse earlier arguments refused such requests, and thoughts under other names went back
uncounted. From version 2 on, arguments are objects, and all that a person could read is counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import Call, Message, calls_of, reasoning_of, text_of, with_arguments

NOTHING = "..."
"""The words of a reply that has neither words nor calls: servers refuse a message that is empty."""


def sent_reply(reply: Message, calls: Sequence[Call], version: str) -> Message | None:
    """Return a reply as later prompts hold it; None if that is what the model said."""
    if version == "v1":
        return None
    if not calls:
        return None if text_of(reply).strip() else {**reply, "content": NOTHING}
    arguments = [call.arguments.sent for call in calls]
    return None if arguments == [call.arguments.text for call in calls] else with_arguments(reply, arguments)


def sent_head(messages: Sequence[Message], version: str) -> list[Message]:
    """Return the messages of a head as prompts hold them: a host may begin with an earlier chat of its model."""
    if version == "v1":
        return list(messages)
    read_again = ([read(call["function"]["arguments"]).sent for call in calls_of(each)] for each in messages)
    return [with_arguments(*pair) for pair in zip(messages, read_again, strict=True)]


def thoughts_of(version: str) -> Callable[[Mapping[str, Any]], str]:
    """Return the function that gives the text of a reply's thoughts that is counted."""
    return _first_thoughts if version == "v1" else reasoning_of


def _first_thoughts(message: Mapping[str, Any]) -> str:
    text: str = message.get("reasoning_content") or ""
    items = message.get("provider_items")
    return text + "".join(_visible(items)) if items else text


def _visible(item: Any) -> Iterator[str]:
    if isinstance(item, Mapping):
        for key, value in item.items():
            if key in ("text", "thinking") and isinstance(value, str):
                yield value
            elif key in ("summary", "content"):
                yield from _visible(value)
    elif isinstance(item, list):
        for part in item:
            yield from _visible(part)
