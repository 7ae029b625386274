"""The fields of a reply: which are counted, and which go back to the model.

Providers put thoughts, signatures and further data beside the words and calls of a reply, each under different names.
A field goes back under the name under which it came, whole. Counted is every text in it that a person could read, at
any depth, also in fields that this library does not know. docs/openai.md prints the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.providers.tables import merged, names, rows

__all__ = ["NEIGHBOURS", "NOT_COUNTED", "NOT_SENT", "OTHER_PART", "THOUGHTS", "THOUGHT_FIELDS"]

NOT_SENT = frozenset(row["name"] for _, row in rows("field") if not row.get("sent", True))
"""The fields of a chat completion that requests must not have: citations, speech, the older form of a call."""

NOT_COUNTED = frozenset(names("not_counted"))
"""The names, at any depth, of texts that nobody reads: ids, types, signatures, encrypted data, names of models."""

NEIGHBOURS = frozenset(names("parts", "neighbours"))
"""The types of parts that a piece of a stream without an index continues, up to their signature."""

THOUGHTS = names("parts", "thoughts")
"""The types of parts of a content that are thoughts, even where they have a text as words have."""

THOUGHT_FIELDS = tuple(dict.fromkeys(row["name"] for _, row in rows("field") if row["empty"] == "a value beside calls"))
"""The fields of a chat completion that are thoughts as text, of which an empty one goes back beside calls."""

BESIDE_WORDS = frozenset(row["name"] for _, row in rows("field") if row["interface"] == "chat" and "holds" not in row)
"""The fields of a chat completion that hold thoughts, in whatever form."""

OTHER_PART = "chat_part"
"""The type of the provider item that is one part of a content, neither words nor known thoughts."""

ENCRYPTED: Mapping[str, str] = merged("parts", "encrypted")
"""The encrypted field of parts of some types; elsewhere it is `encrypted_content`."""

_CALLS = frozenset(names("parts", "calls"))
_BESIDE = frozenset([*names("parts", "beside"), "chat_thinking", OTHER_PART, "chat_call_fields", "chat_reasoning"])
"""The types of provider items that go back beside a reply's own text; an item of another type holds the whole reply."""


def readable(items: Sequence[Any], own: str) -> Iterator[str]:
    """Yield the texts of provider items that a person could read.

    An item may be the whole reply in the form of its framework: what of it is in `own` too, the reply's text, thoughts
    and calls, is counted there.
    """
    for item in items:
        kind = _type(item, "type") if isinstance(item, Mapping) else None
        if kind is None and isinstance(item, Mapping):
            item = {name: value for name, value in item.items() if name not in NOT_SENT}
        for text in texts_in(item):
            if kind is not None and kind not in _BESIDE and text in own:
                own = own.replace(text, "", 1)
            else:
                yield text


def texts_in(value: Any) -> Iterator[str]:
    """Yield the texts of plain data that a person could read, in their order, without those of calls."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from texts_in(item)
    elif isinstance(value, Mapping) and (kind := _type(value, "type", "part_kind")) not in _CALLS:
        kind = _type(value, "part_kind") if kind == OTHER_PART else kind
        encrypted = ENCRYPTED.get(kind) if kind else None
        if value.get("redacted") is True:  # as Inspect marks it
            encrypted = "reasoning"
        for name, inner in value.items():
            if name not in NOT_COUNTED and name != encrypted:
                yield from texts_in(inner)


def _type(part: Mapping[str, Any], *fields: str) -> str | None:
    """The type of a part in the first of these fields that it has; "" if that is no text, as a server may say."""
    value = next((part[field] for field in fields if field in part), None)
    return value if value is None or isinstance(value, str) else ""
