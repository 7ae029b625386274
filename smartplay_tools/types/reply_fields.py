"""The fields of a reply: which are counted, and which go back to the model.

Providers put thoughts, signatures and further data beside the words and calls of a reply, each under names of its own.
A field goes back under the name under which it came, whole. Counted is every text in it that a person could read, at
any depth, also in fields that this library does not know.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

__all__ = ["NOT_COUNTED", "NOT_SENT"]


NOT_SENT = frozenset({"annotations", "audio", "function_call"})
"""The fields of a chat completion that requests must not have: citations, speech, the older form of a call."""

NOT_COUNTED = frozenset(
    {"id", "call_id", "call_ids", "tool_call_id", "response_id", "index", "encrypted_index"}
    | {"type", "kind", "part_kind", "role", "phase", "format", "status", "cache_control"}
    | {"signature", "thought_signature", "thoughtSignature", "encrypted_content"}
    | {"model", "model_name", "model_provider", "provider_name"}
)
"""The names, at any depth, of texts that nobody reads: ids, types, signatures, encrypted data, names of models."""

ENCRYPTED = {"redacted_thinking": "data", "reasoning.encrypted": "data"}
"""The types of parts with an encrypted field, and the field."""

CALLS = frozenset({"tool_use", "tool-call", "tool_call", "function_call", "invalid_tool_call"})
"""The types of parts that are calls, which count as such."""

BESIDE = frozenset({"reasoning", "chat_thinking", "chat_call_fields", "chat_reasoning"})
"""The types of provider items that go back beside the reply's own text; those of other types hold the whole reply."""


def readable(items: Sequence[Any], own: str) -> Iterator[str]:
    """Yield the texts of provider items that a person could read.

    An item may be the whole reply in the form of its framework: what of it is in `own` too, the reply's text, thoughts
    and calls, is counted there.
    """
    for item in items:
        kind = item.get("type") if isinstance(item, Mapping) else None
        if kind is None and isinstance(item, Mapping):
            item = {name: value for name, value in item.items() if name not in NOT_SENT}
        for text in texts_in(item):
            if kind is not None and kind not in BESIDE and text in own:
                own = own.replace(text, "", 1)
            else:
                yield text


def texts_in(value: Any) -> Iterator[str]:
    """Yield the texts of plain data that a person could read, in their order; a call has none of its own."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from texts_in(item)
    elif isinstance(value, Mapping) and (kind := value.get("type", value.get("part_kind"))) not in CALLS:
        encrypted = ENCRYPTED.get(kind) if isinstance(kind, str) else None
        if value.get("redacted") is True:  # as Inspect marks it
            encrypted = "reasoning"
        for name, inner in value.items():
            if name not in NOT_COUNTED and name != encrypted:
                yield from texts_in(inner)
