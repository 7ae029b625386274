"""Streams: how the pieces of a field become its value.

Providers stream thoughts as lists of parts, some with an index and some without, and end a part with its signature. A
reply of which the pieces stay apart is refused when it goes back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.types.reply_fields import NEIGHBOURS, NOT_COUNTED


def merged(before: Any, piece: Any) -> Any:
    """Return a value to which a piece of a stream is added: texts are joined, parts of one kind become one."""
    if isinstance(before, str) and isinstance(piece, str):
        return before + piece
    if isinstance(before, list) and isinstance(piece, list):
        parts = before.copy()
        for part in piece:
            at = _begun(parts, part)
            parts[at:] = [merged(parts[at], part), *parts[at + 1 :]] if at < len(parts) else [part]
        return parts
    if isinstance(before, Mapping) and isinstance(piece, Mapping):
        return {**before, **{name: _merged_field(name, before.get(name), value) for name, value in piece.items()}}
    return piece if before is None or piece not in (None, "") else before


def _merged_field(name: str, before: Any, piece: Any) -> Any:
    return (piece or before) if name in NOT_COUNTED else merged(before, piece)


def _begun(parts: Sequence[Any], piece: Any) -> int:
    """The place of the part that a piece continues; the end of the parts if it begins another one.

    Pieces of one part have its index, where their server counts; otherwise they follow each other up to its signature.
    """
    end = len(parts)
    kind = piece.get("type") if isinstance(piece, Mapping) else None
    if not isinstance(kind, str):
        return end
    same = [at for at, part in enumerate(parts) if isinstance(part, Mapping) and part.get("type") == kind]
    if (index := piece.get("index")) is not None:
        return next((at for at in same if parts[at].get("index") == index), end)
    is_next = bool(same) and same[-1] == end - 1 and not parts[-1].get("signature")
    return end - 1 if is_next and kind in NEIGHBOURS else end
