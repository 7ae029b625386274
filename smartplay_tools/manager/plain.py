"""Messages as plain data: mappings as they are, and the objects of clients read by `model_dump`."""

from __future__ import annotations

import json
import marshal
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import compress, count, repeat
from operator import ne
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.forms import Given

CONVERSATIONS = 16
"""How many conversations are known again, by how they begin."""

UNORDERED = (
    frozenset({"role", "content", "tool_calls", "tool_call_id"}),
    frozenset({"id", "type", "function"}),
    frozenset({"name", "arguments"}),
)
"""Fields of messages, of calls and of functions that are read by name, whatever their order."""

DEEPEST = 100
"""How many levels any message has that a program has made on purpose."""


class PlainMessages:
    """Messages as plain data, each with a key that stands for what it says.

    A conversation is compared with what it was at the prompt before, and only what is new is encoded, since that takes
    most of the time of a prompt. Equal messages have one key where they are words alone: 1 and True are equal, too.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, tuple[list[Any], list[object]]] = {}
        """Copies of messages, None for one that is more than words, and their keys, by the first two."""

    def read(self, messages: Sequence[Any]) -> tuple[Sequence[Given], list[object]]:
        """Return messages as plain data, and their keys."""
        if {*map(type, messages)} == {dict}:
            with suppress(ValueError):
                return [*messages], self._keys([*messages])
        given = [plain(message, f"Message {number}") for number, message in enumerate(messages)]
        return [data for data, _ in given], [key for _, key in given]

    def _keys(self, messages: list[Any]) -> list[object]:
        begin = marshal.dumps(messages[:2], 2)
        before, keys = self._known.get(begin, ([], []))
        same = next(compress(count(), map(ne, messages, before)), min(len(messages), len(before)))
        if same == len(messages):
            return keys[:same]
        new = [*map(marshal.dumps, messages[same:], repeat(2))]
        self._known.pop(begin, None)
        self._known[begin] = [*before[:same], *map(_copied, messages[same:])], [*keys[:same], *new]
        if len(self._known) > CONVERSATIONS:
            del self._known[next(iter(self._known))]
        return self._known[begin][1]


def _copied(value: Any) -> Any:
    """Return a copy of a message with the same texts; None if it is more than texts in fields whose order says nothing.

    Texts that are one object are compared at once, whatever their length.
    """
    with suppress(ValueError):
        return _copy_of_words(value)
    return None


def _copy_of_words(value: Any) -> Any:
    if value is None or type(value) is str:
        return value
    if type(value) is dict and any(value.keys() <= names for names in UNORDERED):
        return {name: _copy_of_words(inner) for name, inner in value.items()}
    if type(value) is list and {*map(type, value)} <= {dict}:
        return [*map(_copy_of_words, value)]
    raise ValueError


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


def check_plain(messages: Sequence[Any]) -> None:
    """Raise an `InvalidArgumentError` for a message that holds what is no JSON, or is nested too deep."""
    for number, message in enumerate(messages):
        levels, values = 0, [message]
        while values := [inner for value in values for inner in _inside(value)]:
            levels += 1
        with named(f"Message {number}"):
            if levels > DEEPEST:
                raise InvalidArgumentError(f"is nested {levels} levels deep, which cannot be read")
            as_json(message)


def _inside(value: Any) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def as_json(value: Any) -> Any:
    """Return a value as plain data; an `InvalidArgumentError` if it holds what is no JSON."""
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if isinstance(value, Mapping):
        return {str(key): as_json(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(inner) for inner in value]
    if callable(dump := getattr(value, "model_dump", None)):
        return dump(mode="json", exclude_none=True)
    raise InvalidArgumentError(
        f"holds {type(value).__name__}, which is no JSON; give mappings, or the objects of a client"
    )
