"""The values that games hand out, converted to Python's and checked where they enter.

Environments give the numbers of NumPy and of other libraries, and now and then what is no number at all. Records,
rows and prompts hold Python's numbers and texts, so a value of a game goes through one of these functions before it is
used. What cannot be converted without a guess is a `GameValueError`, which names the value and the step, 0 being the
reset.
"""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, SupportsFloat

from smartplay_tools.errors import GameValueError, in_one_line
from smartplay_tools.games.seeds import whole
from smartplay_tools.types.arguments import canonical_text, encoder
from smartplay_tools.types.sums import MOST

WORD = re.compile(r"\w+")


def number(name: str, value: Any, step: int) -> int | float:
    """Return a finite number; a whole one stays whole."""
    plain = value if type(value) in (int, float) else _plain(value)
    if isinstance(plain, int | float) and -MOST <= plain <= MOST:
        return plain
    raise _refused(name, value, step, f"a finite number of at most {MOST:.0e}")


def flag(name: str, value: Any, step: int) -> bool:
    """Return a truth value; 0 and 1 are truth values, too."""
    plain = value if type(value) is bool else _plain(value)
    if isinstance(plain, int | float) and plain in (0, 1):
        return bool(plain)
    raise _refused(name, value, step, "a truth value")


def text(name: str, value: Any, step: int) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise _refused(name, value, step, "a text")
    plain = value if type(value) is str else str.__str__(value)
    try:
        plain.encode()
    except UnicodeEncodeError as error:
        half = plain[error.start : error.start + 1]
        raise _refused(name, half, step, "a character: half of one is no text", "has {}, which is not") from None
    return plain


def whole_numbers(name: str, values: Iterable[Any], step: int) -> list[int]:
    """Return a list of whole numbers, such as those of steps."""
    try:
        plain = [whole(value) for value in values]
    except TypeError:
        plain = [None]
    if any(number is None or not -MOST <= number <= MOST for number in plain):
        raise _refused(name, values, step, "a list of whole numbers")
    return [number for number in plain if number is not None]


def contents(name: str, values: Mapping[Any, Any], step: int) -> dict[str, str]:
    """Return texts by the steps that they belong to, as a record has them; each has a word."""
    if not all(isinstance(text, str) and WORD.search(text) for text in values.values()):
        raise _refused(name, values, step, "a mapping from steps to texts")
    return {str(number): text for number, text in values.items()}


def json_text(name: str, value: Any, step: int, encode: Callable[[Any], str] = canonical_text) -> str:
    """Return a value as JSON."""
    try:
        return encode(value)
    except (TypeError, ValueError, RecursionError) as error:
        raise GameValueError(f"{name} {_place(step)} is not JSON: {in_one_line(error)}.") from error


def facts(name: str, value: Any, step: int) -> dict[str, dict[str, Any]]:
    """Return facts about a game by name, each a dictionary that is JSON."""
    plain = json.loads(json_text(name, value, step, _STRICT))
    if not isinstance(plain, dict) or not all(isinstance(each, dict) for each in plain.values()):
        raise _refused(name, value, step, "a dictionary of dictionaries")
    return plain


def plain_name(name: str) -> str:
    """Return an action's name as calls are compared with it: without case, outer white space and a final full stop."""
    return name.strip().removesuffix(".").lower()


_STRICT = encoder(nan=False)


def _plain(value: Any) -> Any:
    """Return a number of another type, such as NumPy's, as Python's; anything else as it is."""
    if getattr(value, "shape", None) == ():  # also an array or a tensor that is one number
        value = value.item()
    if isinstance(value, int):
        return int(value)
    try:
        return float(value) if isinstance(value, SupportsFloat) and not hasattr(value, "__len__") else value
    except (TypeError, ValueError, OverflowError):
        return value


def _refused(name: str, value: Any, step: int, what: str, verb: str = "is {}, and not") -> GameValueError:
    try:
        shown = " ".join(reprlib.repr(value).split())
    except Exception:  # it is a value of foreign code
        shown = f"a value of the type {type(value).__name__}"
    return GameValueError(f"{name} {_place(step)} {verb.format(shown)} {what}.")


def _place(step: int) -> str:
    return f"of step {step}" if step else "of the reset"
