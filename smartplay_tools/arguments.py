"""Tool arguments: the JSON text that a model writes, read strictly.

Some frameworks hand over the text as the model wrote it, some the object that they parsed from it. `canonical` makes
the two equal, so that the same call counts the same tokens, compares equal and is recorded alike everywhere.
"""

from __future__ import annotations

import json
from typing import Any

LONGEST = 10_000
"""More characters than this are malformed unread: no game needs them, and parsing is not free."""


def as_text(arguments: Any) -> str:
    """Return the arguments as JSON text: text unchanged, None as no text, an object as Python's `json` prints it."""
    if arguments is None:
        return ""
    if isinstance(arguments, str):
        return arguments
    try:
        return json.dumps(arguments, ensure_ascii=False)
    except (TypeError, ValueError, RecursionError) as error:
        return f"<{type(arguments).__name__} that is not JSON: {type(error).__name__}>"


def parse(text: str) -> dict[str, Any]:
    """Return the object that the text holds; no text at all is an empty object.

    Raises ValueError, whose message completes "The arguments ...", for anything else: text that is not JSON, JSON
    that is not an object, a key that stands twice, `NaN` and its kin, nesting or length beyond all reason.
    """
    if not text:
        return {}
    if len(text) > LONGEST:
        raise ValueError(f"are longer than {LONGEST:,} characters")
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_constant)
    except _UnreadableError:
        raise
    except json.JSONDecodeError:
        raise ValueError("are not valid JSON") from None
    except RecursionError:
        raise ValueError("are nested too deep") from None
    except ValueError:
        raise ValueError("hold a number that is too long to read") from None
    if not isinstance(value, dict):
        raise ValueError("are not a JSON object")
    return value


def canonical(arguments: Any) -> str:
    """Return an object as `json.dumps(object, ensure_ascii=False)` in the order sent, anything else as sent."""
    text = as_text(arguments)
    if text in ("", "{}") or not isinstance(arguments, str):
        return text
    try:
        return json.dumps(parse(text), ensure_ascii=False, allow_nan=False)
    except (ValueError, RecursionError):
        return text


class _UnreadableError(ValueError):
    """JSON to Python's parser, but not to us."""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) < len(pairs):
        raise _UnreadableError("have a key that stands twice")
    return value


def _constant(name: str) -> Any:
    raise _UnreadableError(f"hold {name}, which is not JSON")
