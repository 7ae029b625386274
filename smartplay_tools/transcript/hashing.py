"""Hashes that verify a record: one for each prompt, and a chain over the events.

Each event contains the digest of everything up to and including it (`chain`), so a changed, missing, doubled or moved
event is detected. Somebody who changes a record can also recompute the chain. A replay then still verifies the game
and the prompts, but nothing verifies who wrote the replies.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from smartplay_tools.types import ToolSpec
from smartplay_tools.types.arguments import canonical, canonical_text, encoder
from smartplay_tools.types.messages import Message, calls_of, text_and_pictures


def event_line(event: Mapping[str, Any]) -> bytes:
    """Return an event as JSON in ASCII, so that any text, lone surrogates included, is read back unchanged."""
    return _event_text(event).encode("ascii")


def chained_lines(events: Iterable[Mapping[str, Any]], before: str) -> tuple[bytes, str]:
    """Return the lines of events, each with the chain up to it as its last field, and the chain after the last one.

    The chain after an event is a digest of the chain before it and of the event's line without its chain.
    """
    lines, chain = b"", before
    for event in events:
        line = event_line(event)
        chain = hashlib.sha256(chain.encode("ascii") + line).hexdigest()[:32]
        lines += b'%b, "chain": "%b"}\n' % (line[:-1], chain.encode("ascii"))
    return lines, chain


def message_bytes(message: Message, call_ids: Sequence[str], arguments: Sequence[str] = ()) -> bytes:
    """Return the canonical JSON of a message, its call ids replaced by `call_ids` and without provider items.

    `arguments` are those of its calls in canonical form.
    """
    # Put together by hand, key by key in their order: that takes half the time of an encoder for dictionaries.
    role = message["role"]
    text, pictures = text_and_pictures(message)
    fields = f'"content":{_text(text)}'
    if name := message.get("name"):
        fields += f',"name":{_text(name)}'
    if pictures:
        fields += f',"pictures":[{",".join(_text(part["sha256"]) for part in pictures)}]'
    fields += f',"role":{_text(role)}'
    if role == "tool":
        fields += f',"tool_call_id":{_text(call_ids[0])}'
    elif calls := calls_of(message):
        called = [
            f'{{"arguments":{_text(text)},"id":{_text(call_id)},"name":{_text(call["function"]["name"])}}}'
            for call, call_id, text in zip(calls, call_ids, arguments, strict=True)
        ]
        fields += f',"tool_calls":[{",".join(called)}]'
    return f"{{{fields}}}".encode("ascii")


def head_bytes(message: Message) -> bytes:
    """Return the canonical JSON of a message of the head, whose calls keep their own ids."""
    calls = calls_of(message)
    ids = [message["tool_call_id"]] if message["role"] == "tool" else [call["id"] for call in calls]
    return message_bytes(message, ids, [canonical(call["function"]["arguments"]) for call in calls])


def tools_bytes(tools: Iterable[ToolSpec]) -> bytes:
    """Return the canonical JSON of tool schemas."""
    return canonical_json([tool.to_json() for tool in tools])


def prompt_sha256(messages: Iterable[bytes], tools: bytes) -> str:
    """Return the sha256 of a prompt: `{"messages":[...],"tools":[...]}` in canonical JSON, as hex."""
    digest = hashlib.sha256(b'{"messages":[')
    digest.update(b",".join(messages))
    digest.update(b'],"tools":' + tools + b"}")
    return digest.hexdigest()


def canonical_json(value: Any) -> bytes:
    """Return JSON with sorted keys and no spaces, in ASCII: one byte string for one value."""
    return canonical_text(value).encode("ascii")


_event_text = encoder()

_text: Callable[[str], str] = json.encoder.encode_basestring_ascii
"""Encodes a text, which needs no encoder for containers."""
