"""Whose error it is: what a server says in place of a reply, sorted by one table for all interfaces.

The table has the rows of all providers. It knows an error by its status, its codes and its words, wherever they
stand: in an HTTP error, in an answer with status 200, in a chunk of a stream, in a failed response. A gateway passes on
what the provider behind it has said, so every error is compared with the rows of all providers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from functools import cache
from typing import Any, Literal, get_args

from smartplay_tools.providers.tables import ANY, rows as rows_of
from smartplay_tools.types import Reply, Usage

Whose = Literal["model", "prompt", "player", "field", "moment"]
"""Whose error it is.

- "model": the model's mistake. The server could not read its call, so the error is a reply (`ServerError.as_reply`).
- "prompt": this prompt's. It is refused again if it is asked again; other prompts need not be.
- "player": every request of this player is refused: the key, the account or the model's name is wrong.
- "field": a field of the request's, which the words name.
- "moment": the same request may succeed later.
"""

CODES = frozenset(["__type", "code", "error_code", "reason", "status", "status_code", "statuscode", "type"])
"""The names, in small letters, under which servers give codes, or a status that is not that of the answer."""

ECHOES = frozenset(["failed_generation", "flagged_input", "input"])
"""Names of what is not the server's own: words of the model and of the prompt, which may say anything."""

HELD: Mapping[Whose, str] = {"model": "reply", "prompt": "tokens", "moment": "wait"}
"""What the field of a row holds."""

DEPTH = 10
"""How deep an error is read."""


@dataclass(frozen=True)
class ServerError:
    """What a server said in place of a reply."""

    whose: Whose
    about: str = ""
    """What it is about, if the table says so: "call", "context", "moderation", "key", "quota", "model"."""
    words: tuple[str, ...] = ()
    """The sentences of the server, and of a provider behind it."""
    reply: str = ""
    """The model's own words, in its mistake."""
    tokens: int | None = None
    """The tokens of the context that is full."""
    wait: float | None = None
    """The seconds after which the server wants to be asked again, if its words or its fields say so."""

    def as_reply(self, usage: Usage | None = None) -> Reply:
        """Return a mistake of the model as the reply that it was, with its words; it is counted in `broken_calls`."""
        counted = (usage or Usage()).model_copy(update={"broken_calls": 1})
        return Reply({"role": "assistant", "content": self.reply or None}, counted)


@dataclass(frozen=True)
class Row:
    """A row of the table. An error is of a row if it has one of its codes or its words, and one of its statuses."""

    provider: str
    whose: Whose
    says: str
    """An error as the source has it: the status, and the body in JSON."""
    source: str
    read: date
    """The day on which the source was read."""
    about: str = ""
    status: Sequence[int] = ()
    code: Sequence[str] = ()
    words: str = ""
    """A regular expression of words; its groups are `reply`, `tokens` and `wait`."""
    field: str = ""
    """The name of a field that holds the same as the group."""
    interface: str = "chat"
    """The interface at which the error was seen."""


@cache
def rows() -> tuple[Row, ...]:
    """Return the table in the order in which its rows are tried."""
    order = get_args(Whose)
    made = [Row(provider, **row) for provider, row in rows_of("error")]
    return tuple(sorted(made, key=lambda row: len(order) if row.provider == ANY else order.index(row.whose)))


def server_error(error: Exception | Mapping[str, Any]) -> ServerError:
    """Sort an exception of a client, or the body of an answer. Without words of a server it is this moment's."""
    said = _Said(error)
    while isinstance(error, Exception) and not (said.status or said.codes) and error.__cause__ is not None:
        error = error.__cause__  # type: ignore[assignment]  # frameworks wrap the errors of their clients
        said = _Said(error)
    found = [(row, groups) for row in rows() if (groups := said.matches(row)) is not None]
    if not found:
        return ServerError("moment" if said.status is None or said.status >= 500 else "prompt", words=said.words)
    whose, about = found[0][0].whose, found[0][0].about
    details = [said.details(*match) for match in found if (match[0].whose, match[0].about) == (whose, about)]
    known = {name: text for each in reversed(details) for name, text in each.items() if text}
    tokens = "".join(filter(str.isdigit, known.get("tokens", "")))
    return ServerError(
        whose,
        about,
        reply=known.get("reply", ""),
        tokens=int(tokens) if tokens else None,
        wait=_seconds(known.get("wait", "")),
        words=said.words,
    )


class _Said:
    """The parts of an error."""

    def __init__(self, error: Any) -> None:
        response = getattr(error, "response", None)
        body = error if isinstance(error, Mapping) else getattr(error, "body", None)
        if body is None and isinstance(error, Exception):  # of botocore, and of clients that raise what they were sent
            body = response if isinstance(response, Mapping) else [*error.args] or None
        attributes = {name: getattr(error, name, None) for name in ("code", "type", "param")}
        leaves = [*_leaves(body, DEPTH), *_leaves(attributes, 1)]
        self.fields: dict[str, Any] = {}
        for name, value in leaves:
            self.fields.setdefault(name, value)
        codes = [str(value).lower() for name, value in leaves if name in CODES]
        self.codes = frozenset(codes)
        own = [value for name, value in leaves if name not in ECHOES | CODES and isinstance(value, str)]
        own += [name for name, _ in leaves]  # Ollama has had its words as a name
        self.words = tuple(dict.fromkeys(text for text in own if " " in text.strip()))
        self.text = "\n".join([*self.words, *self.codes])
        status = getattr(error, "status_code", None) or getattr(response, "status_code", None)
        numbers = [status, *(int(code) for code in codes if code.isascii() and code.isdigit())]
        self.status = next((n for n in numbers if isinstance(n, int) and 400 <= n < 600), None)

    def matches(self, row: Row) -> Mapping[str, str] | None:
        """The groups of a row that matches; None if it does not."""
        has_status = self.status in row.status
        found = re.search(row.words, self.text, re.IGNORECASE) if row.words else None
        # A gateway may put the whole error of a provider into its words.
        is_coded = any(code in self.codes or ("_" in code and code in self.text) for code in row.code)
        if row.provider == ANY:
            is_row = has_status or (is_coded and self.status is None)
        else:
            is_row = (is_coded or found is not None) and (has_status or not row.status)
        groups = {} if found is None else found.groupdict(default="")
        return groups if is_row else None

    def details(self, row: Row, groups: Mapping[str, str]) -> Mapping[str, str]:
        """What a row that matches finds in the error."""
        named = str(self.fields.get(row.field.lower(), "")) if row.field else ""
        return {HELD[row.whose]: named, **groups} if named else groups


def _leaves(value: Any, depth: int, name: str = "") -> Iterator[tuple[str, Any]]:
    """The texts and numbers of an error with their names in small letters, also those of JSON inside a text."""
    if isinstance(value, Mapping) and depth:
        for key, inner in value.items():
            yield from _leaves(inner, depth - 1, str(key).lower())
    elif isinstance(value, list | tuple) and depth:
        for inner in value:
            yield from _leaves(inner, depth - 1, name)
    elif isinstance(value, str | int | float) and not isinstance(value, bool):
        yield name, value
        if isinstance(value, str) and "{" in value and name not in ECHOES:
            with suppress(ValueError, RecursionError):
                yield from _leaves(json.JSONDecoder().raw_decode(value, value.index("{"))[0], depth - 1, name)


def _seconds(text: str) -> float | None:
    """A duration such as "38s", "6m0s", "120ms" or "22 seconds"."""
    parts = re.findall(r"(\d+(?:\.\d+)?)\s*(ms|milli|h|m|s|$)", text.lower())
    units = {"ms": 0.001, "milli": 0.001, "h": 3600.0, "m": 60.0}
    return sum(float(number) * units.get(unit, 1.0) for number, unit in parts) if parts else None
