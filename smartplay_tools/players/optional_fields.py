"""Optional fields of requests: a server that refuses one by its name is asked again without it, from then on.

Servers of one interface accept different fields, and word their refusals differently. Whether a refusal is about a
field is decided by the table of errors (`server_errors`). Which fields are optional is in the files of providers, with
the reports: some that requests add, and all that a server has added to a reply, which goes back to it.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping
from typing import Any

from smartplay_tools.players.server_errors import server_error
from smartplay_tools.providers.caps import CAPS, other_cap
from smartplay_tools.providers.tables import names, rows
from smartplay_tools.visible import logger

log = logger("smartplay_tools.players")

OPTIONAL = frozenset(row["name"] for _, row in rows("optional") if not row.get("inside"))
"""Fields of a request that it may do without."""

OPTIONAL_INSIDE = frozenset(row["name"] for _, row in rows("optional") if row.get("inside"))
"""The same inside of its messages and tools."""

WANTED = frozenset((row["name"], row["wanted"]) for _, row in rows("field") if "wanted" in row)
"""Fields of replies that a server may want back where a strategy has left them out, and the words that say so."""

DEFINED = frozenset(names("defined"))
"""The fields of replies that an interface defines."""

SCHEMAS = ("parameters", "input_schema")
"""The fields of a tool that hold a JSON schema, in which any name may stand."""

CONVERSATION = ("messages", "input")
"""The fields of a request that hold its messages."""


class OptionalFields:
    """What the server of one player has refused; later requests are made without it.

    Arguments:
        player: the player's name, for the log.
        own: the fields that the user has set, which are never left out.
    """

    def __init__(self, player: str, own: Container[str]) -> None:
        self._player, self._own = player, own
        self._left_out: frozenset[str] = frozenset()
        self._kept_back: frozenset[str] = frozenset()
        """Fields of replies that do not go back."""
        self._wanted: frozenset[str] = frozenset()
        self._renamed: Mapping[str, str] = {}

    def fit(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return a request as the server takes it."""
        if not (self._left_out or self._kept_back or self._wanted or self._renamed):
            return request
        inside = self._left_out.intersection(OPTIONAL_INSIDE)
        fields = {self._renamed.get(name, name): value for name, value in request.items() if name not in self._left_out}
        fitted = {name: _without(value, inside) for name, value in fields.items()}
        for name in CONVERSATION:
            if isinstance(messages := fitted.get(name), list):
                fitted[name] = [self._sent_back(each) if _is_reply(each) else each for each in messages]
        return fitted

    def _sent_back(self, reply: Mapping[str, Any]) -> dict[str, Any]:
        wanted = dict.fromkeys(self._wanted, "") if "role" in reply else {}
        return {**wanted, **_without(reply, self._kept_back)}

    def mend(self, request: dict[str, Any], error: Exception) -> bool:
        """Whether a request was refused for a field that it has now no more, so that it is worth sending again."""
        said = server_error(error)
        if said.whose not in ("field", "prompt") or said.about:
            return False
        body = getattr(error, "body", None)
        told = [getattr(error, "param", None) or "", *(_texts(body) if body else [str(error)])]
        words = "\n".join(told).lower()
        present = [name for name in (*OPTIONAL, *OPTIONAL_INSIDE) if name not in self._own and _has(request, name)]
        refused = _named(present, words)
        wanted = frozenset(name for name, asked in WANTED if name in words and re.search(asked, words))
        kept_back, renamed = frozenset[str](), {}
        if said.whose == "field" and not refused:
            kept_back = _named(_added(request), words)
            if not self._renamed:
                caps = [name for name in CAPS if name in words and name in request and name not in self._own]
                renamed = {name: other_cap(name, words) for name in caps}
        changes = [*sorted((refused - self._left_out) | (kept_back - self._kept_back))]
        changes += [f"{name}, now {other}" for name, other in renamed.items()]
        changes += [f"{name} of every reply, now empty where it was left out" for name in wanted - self._wanted]
        if changes:
            log.warning("The server of %s refused a request; it is asked without %s.", self._player, ", ".join(changes))
        self._left_out, self._kept_back = self._left_out | refused, self._kept_back | kept_back
        self._wanted, self._renamed = self._wanted | wanted, {**self._renamed, **renamed}
        # A request may have been under way when another one was refused.
        if (changed := self.fit(request)) == request:
            return False
        request.clear()
        request.update(changed)
        return True


def _named(names: Iterable[str], words: str) -> frozenset[str]:
    return frozenset(name for name in names if _is_named(name, words))


def _texts(body: Any) -> Iterator[str]:
    """The values in the body of an error, as text, without the names of its fields."""
    if isinstance(body, Mapping):
        body = [*body.values()]
    if isinstance(body, list | tuple):
        for inner in body:
            yield from _texts(inner)
    else:
        yield str(body)


def _is_named(name: str, words: str) -> bool:
    """Whether a refusal names a field; one whose name is an English word has to stand as a name does."""
    if name == "include" and re.search("encrypted[ _]content", words):
        return True
    if "_" in name:
        return re.search(rf"(?<!\w){re.escape(name.lower())}(?!\w)", words) is not None
    before, after = r"""(?:^|['"`.]|: |-> |argument |parameter |field |property )""", r"""(?:['"`.,:\[]|$)"""
    return re.search(f"{before}{re.escape(name.lower())}{after}", words, re.MULTILINE) is not None


def _is_reply(message: Any) -> bool:
    """Whether a message or an item of a request is the model's."""
    if not isinstance(message, Mapping) or message.get("type") == "function_call_output":
        return False
    return bool(message.get("role", "assistant") == "assistant")


def _added(request: Mapping[str, Any]) -> set[str]:
    """The fields of a request's replies that its interface does not define."""
    messages = (each for name in CONVERSATION if isinstance(request.get(name), list) for each in request[name])
    return {name for message in messages if _is_reply(message) for name in _fields(message)} - DEFINED


def _fields(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        yield from value
        for name, inner in value.items():
            if name != "input":  # the arguments of a call at Anthropic
                yield from _fields(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _fields(inner)


def _has(value: Any, name: str) -> bool:
    if isinstance(value, Mapping):
        inside = (part for key, part in value.items() if key not in SCHEMAS)
        return name in value or (name in OPTIONAL_INSIDE and any(_has(part, name) for part in inside))
    return isinstance(value, list) and any(_has(part, name) for part in value)


def _without(value: Any, names: frozenset[str]) -> Any:
    if not names:
        return value
    if isinstance(value, Mapping):
        kept = ((key, part) for key, part in value.items() if key not in names)
        return {key: part if key in SCHEMAS else _without(part, names) for key, part in kept}
    return [_without(part, names) for part in value] if isinstance(value, list) else value
