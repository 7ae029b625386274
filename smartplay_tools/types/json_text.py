"""JSON text: written as Python's `json` writes it, but faster, and read where it may hold any value.

`json` creates an encoder in C for every call, which takes longer than encoding a small value, and a turn encodes a
dozen of these. Here an encoder is created once.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

__all__ = ["canonical_text", "encoder", "object_in", "value_in"]


def object_in(text: str | bytes | bytearray) -> dict[str, Any] | None:
    """Return the object that a JSON text holds; None if it is not JSON or holds another value."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def value_in(text: str) -> Any:
    """Return the value that a JSON text holds; the text itself if it is not JSON."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def encoder(
    *, sort_keys: bool = False, separators: tuple[str, str] = (", ", ": "), ensure_ascii: bool = True, nan: bool = True
) -> Callable[[Any], str]:
    """Return an encoder equal to `json.dumps` with these arguments; without `nan`, NaN and infinity are ValueErrors.

    An object that contains itself is a RecursionError.
    """
    slow = json.JSONEncoder(
        check_circular=False, sort_keys=sort_keys, separators=separators, ensure_ascii=ensure_ascii, allow_nan=nan
    )
    make = getattr(json.encoder, "c_make_encoder", None)
    if make is None:  # not CPython
        return slow.encode
    text = json.encoder.encode_basestring_ascii if ensure_ascii else json.encoder.encode_basestring
    item, key = separators
    parts = make(None, slow.default, text, None, key, item, sort_keys, False, nan)
    return lambda value: "".join(parts(value, 0))


canonical_text = encoder(sort_keys=True, separators=(",", ":"))
"""Encodes with sorted keys and no spaces, in ASCII: equal values have equal texts, so they can be hashed."""
