"""Messages as plain data: mappings as they are, and the objects of clients read by `model_dump`."""

from __future__ import annotations

import json
import marshal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import repeat
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.forms import Given

DEEPEST = 100
"""How many levels any message has that a program has made on purpose."""


def plain_messages(messages: Sequence[Any]) -> tuple[Sequence[Given], list[object]]:
    """Return messages as plain data, each with a key that stands for what it says."""
    if {*map(type, messages)} == {dict}:
        with suppress(ValueError):
            return [*messages], [*map(marshal.dumps, messages, repeat(2))]
    given = [plain(message, f"Message {number}") for number, message in enumerate(messages)]
    return [data for data, _ in given], [key for _, key in given]


def plain(message: Any, what: str) -> tuple[Given, object]:
    """Return a message as plain data, and a key that stands for what it says; `what` names it in an error.

    Data that is plain already is not copied.
    """
    if type(message) is dict:
        with suppress(ValueError):
            return message, marshal.dumps(message, 2)  # in this version equal data have equal bytes
    with named(what):
        data = as_json(message)
        if not isinstance(data, Mapping):
            raise InvalidArgumentError(f"is {type(message).__name__}; give a mapping, or an object of a client")
    return data, json.dumps(data, sort_keys=True)


@contextmanager
def named(what: str) -> Iterator[None]:
    """Have an `InvalidArgumentError` say what it is about."""
    try:
        yield
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{what} {error}.") from None


def as_json(value: Any, levels: int = 0) -> Any:
    """Return a value as plain data; an `InvalidArgumentError` if it holds what is no JSON, or is nested too deep."""
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if levels > DEEPEST:
        raise InvalidArgumentError(f"is nested more than {DEEPEST} levels deep, which cannot be read")
    if isinstance(value, Mapping):
        return {str(key): as_json(inner, levels + 1) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(inner, levels + 1) for inner in value]
    if callable(dump := getattr(value, "model_dump", None)):
        return dump(mode="json", exclude_none=True)
    raise InvalidArgumentError(
        f"holds {type(value).__name__}, which is no JSON; give mappings, or the objects of a client"
    )
