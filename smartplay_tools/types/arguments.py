"""Tool arguments: the JSON text that a model writes, parsed strictly and once.

Some frameworks pass the text as the model wrote it, others the object that they parsed from it. `read` treats the two
alike, so that the same call counts the same tokens, compares equal and is recorded in the same form everywhere.

JSON is written as Python's `json` writes it.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from smartplay_tools.providers.request_limits import most, shortened

__all__ = ["Arguments", "meaning", "object_in", "read", "value_in"]


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


def number_as_text(value: Any) -> Any:
    """Return a whole number as text; any other value unchanged, booleans and fractions included."""
    return str(value) if type(value) is int else value


def encoder(
    *, sort_keys: bool = False, separators: tuple[str, str] = (", ", ": "), ensure_ascii: bool = True, nan: bool = True
) -> Callable[[Any], str]:
    """Return an encoder equal to `json.dumps` with these arguments; without `nan`, NaN and infinity are ValueErrors.

    An object that contains itself is a RecursionError.
    """
    return json.JSONEncoder(
        check_circular=False, sort_keys=sort_keys, separators=separators, ensure_ascii=ensure_ascii, allow_nan=nan
    ).encode


canonical_text = encoder(sort_keys=True, separators=(",", ":"))
"""Encodes with sorted keys and no spaces, in ASCII: equal values have equal texts, so they can be hashed."""


LONGEST = 10_000
"""Longer text is malformed and is not parsed: no game needs it, and parsing takes time."""

_LARGEST = 309
"""The number of digits of the largest double."""

REMEMBERED = 200
"""Longer text is read again whenever it comes again, and so is text with objects or lists inside."""

DEEPEST = 100
"""Arguments nested deeper are malformed. The limit is fixed, because Python's own depends on the caller's stack."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What is wrong with arguments: the name of a sentence that completes "The arguments ...", and its values."""

    name: str
    values: Mapping[str, str]


@dataclass(slots=True)
class Arguments:
    """The arguments of one call, read. Exactly one of `values` and `problem` is None."""

    text: str
    """As the model sent them; an object as Python's `json` prints it."""
    canonical: str
    """The object as `json.dumps(object, ensure_ascii=False)` prints it in the order sent; anything else as sent."""
    values: Mapping[str, Any] | None
    """The object that the text holds; empty for no text at all."""
    problem: Problem | None
    """What is wrong with the text."""
    sent: str
    """What a prompt holds of them: the text if it is an object, `{}` for nothing, any other text wrapped in an object.
    Half a character is U+FFFD in it.

    Servers parse the arguments of earlier calls, and refuse a request in which they are anything but an object.
    """

    @property
    def sent_canonical(self) -> str:
        """`sent` in canonical form."""
        return self.canonical if self.sent == self.text else self.sent


def read(arguments: Any) -> Arguments:
    """Read arguments: JSON text, an object that a framework parsed, or None. Never raises: errors are in `problem`."""
    text = as_text(arguments)
    if len(text) > REMEMBERED or text.count("{") + text.count("[") > 1:
        return _read(text)
    cached = _read_again(text)
    # The caller may change the values, and the cache is shared by all episodes.
    return Arguments(cached.text, cached.canonical, dict(cached.values), None, cached.sent) if cached.values else cached


def _read(text: str) -> Arguments:
    if text in ("", "{}"):
        return Arguments(text, text, {}, None, "{}")
    try:
        values = parse(text)
        canonical = _encode(values)
    except _UnreadableError as error:
        return Arguments(text, text, None, error.problem, "{}" if text.strip() in ("", "null") else _wrapped(text))
    except (ValueError, RecursionError):  # Python reads 1e999 as infinity, which is not JSON
        return Arguments(text, text, values, None, _wrapped(text))
    return Arguments(text, canonical, values, None, _portable(text, canonical))


def _wrapped(text: str) -> str:
    wrapped = _encode({"arguments": well_formed(text)})
    if len(wrapped) <= (longest := most("arguments")):
        return wrapped
    return _encode({"arguments": shortened(well_formed(text), longest // 6 - 8)})  # a character has up to six in JSON


def _portable(text: str, canonical: str) -> str:
    """An object that every server reads: without halves of characters, and with no number beyond a double."""
    if canonical.isascii() and len(canonical) < _LARGEST:
        return text
    whole = well_formed(canonical)
    try:
        parse(whole)  # two keys may have become one
        _encode(json.loads(whole, parse_int=float))
    except ValueError:
        return _wrapped(text)
    return text if whole == canonical else whole


def well_formed(text: str, *, lone: Literal["replace", "surrogatepass"] = "replace") -> str:
    """Return the text with pairs of surrogates joined to their character, and each lone one replaced by U+FFFD.

    With "surrogatepass" lone ones stay.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", lone)
    return text


_read_again = functools.lru_cache(1_024)(_read)
"""`_read` with a cache: the arguments of a call are often those of an earlier one."""


def meaning(arguments: Arguments) -> str:
    """Return a text that two calls share if their arguments are equal, however their JSON is written.

    A whole number is equal to its text, as it is as an action: clients turn one into the other.
    """
    if arguments.values is None:
        return arguments.text
    return canonical_text({name: number_as_text(value) for name, value in arguments.values.items()})


def as_text(arguments: Any) -> str:
    """Return the arguments as JSON text: text unchanged, None as empty text, an object as Python's `json` prints it."""
    if arguments is None:
        return ""
    if isinstance(arguments, str):
        return arguments
    if _is_deeper(arguments, DEEPEST):
        return f"<{type(arguments).__name__} that is not JSON: nested deeper than {DEEPEST}>"
    try:
        return json.dumps(arguments, ensure_ascii=False)
    except (TypeError, ValueError, RecursionError) as error:
        return f"<{type(arguments).__name__} that is not JSON: {type(error).__name__}>"


def parse(text: str) -> dict[str, Any]:
    """Return the object that the text holds; empty text is an empty object.

    Raises ValueError for anything else: text that is not JSON, JSON that is not an object, a repeated key, `NaN` or
    infinity, nesting or length beyond the limits.
    """
    if not text:
        return {}
    if len(text) > LONGEST:
        raise _UnreadableError("too_long", most=f"{LONGEST:,}")
    if text.count("[") + text.count("{") > DEEPEST and _text_is_deeper(text, DEEPEST):
        raise _UnreadableError("too_deep")
    try:
        value = _DECODER.decode(text)
    except _UnreadableError:
        raise
    except json.JSONDecodeError:
        raise _UnreadableError("not_json") from None
    except RecursionError:
        raise _UnreadableError("too_deep") from None
    except ValueError:
        raise _UnreadableError("long_number") from None
    if not isinstance(value, dict):
        raise _UnreadableError("no_object")
    return value


def canonical(arguments: Any) -> str:
    """Return an object as `json.dumps(object, ensure_ascii=False)` in the order sent, anything else as sent."""
    return read(arguments).canonical


class _UnreadableError(ValueError):
    """The arguments are refused for a problem."""

    def __init__(self, name: str, **values: str) -> None:
        super().__init__(name)
        self.problem = Problem(name, values)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) < len(pairs):
        raise _UnreadableError("repeated_key")
    return value


def _constant(name: str) -> Any:
    raise _UnreadableError("no_json_number", number=name)


def _is_deeper(value: Any, limit: int) -> bool:
    """Whether a value is nested deeper than a limit, found level by level and so without recursion."""
    level = [value]
    for _ in range(limit + 1):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner.extend(item.values())
            elif isinstance(item, list | tuple):
                inner.extend(item)
        if not inner:
            return False
        level = inner
    return True


def _text_is_deeper(text: str, limit: int) -> bool:
    """Whether brackets outside of strings are nested deeper than a limit."""
    depth, in_string, escaped = 0, False, False
    for character in text:
        if in_string:
            in_string = escaped or character != '"'
            escaped = character == "\\" and not escaped
        elif character == '"':
            in_string = True
        elif character in "[{":
            depth += 1
            if depth > limit:
                return True
        elif character in "]}":
            depth -= 1
    return False


_DECODER = json.JSONDecoder(object_pairs_hook=_object, parse_constant=_constant)
"""Created once, because `json.loads` would create one for every call."""
_encode = encoder(ensure_ascii=False, nan=False)


def text_parameters(**descriptions: str) -> Mapping[str, Any]:
    """Return JSON Schema of an object with these texts, all required, as strict modes want it."""
    return {
        "type": "object",
        "properties": {name: {"type": "string", "description": text} for name, text in descriptions.items()},
        "required": list(descriptions),
        "additionalProperties": False,
    }
