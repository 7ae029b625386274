"""FittedPrompt: what a context manager sends of a conversation, and what it does not."""

from __future__ import annotations

import json
import marshal
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import compress, count, repeat
from operator import ne
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.forms import Given, MessageForm
from smartplay_tools.manager.strategy import AskedStrategy
from smartplay_tools.manager.summaries import Covered
from smartplay_tools.manager.units import Chosen, Shown

__all__ = ["Conversation", "Draft", "FittedPrompt", "PlainMessages", "check_plain", "plain"]

CONVERSATIONS = 16
"""How many conversations are known again, by how they begin."""

DEEPEST = 100
"""How many levels any message has that a program has made on purpose."""

UNORDERED = (
    frozenset({"role", "content", "tool_calls", "tool_call_id"}),
    frozenset({"id", "type", "function"}),
    frozenset({"name", "arguments"}),
)
"""Fields of messages, of calls and of functions that are read by name, whatever their order."""


@dataclass(frozen=True, slots=True)
class Conversation:
    """The messages that a manager was given."""

    given: Sequence[Any]
    """The objects."""
    data: Sequence[Given]
    """The same as plain data."""
    keys: list[object]
    """What stands for what each says."""
    form: MessageForm


@dataclass(frozen=True)
class FittedPrompt:
    """The messages of a prompt, its tokens, and what became of every message that was given.

    Numbers are positions in the list that was given, from 0. A message of which nothing was changed is the object that
    was given.
    """

    messages: list[Any]
    """What to send, in the form of what was given."""
    tokens: int
    """Budget tokens of these messages, of `system`, tools and output schema, and of priming."""
    sources: Sequence[int | None]
    """For each message its number; None for one that was made here."""
    dropped: Sequence[int] = ()
    """Messages that are not shown."""
    masked: Sequence[int] = ()
    """Messages whose results are older than `history`, and read as a line that says so."""
    trimmed: Sequence[int] = ()
    """Replies that are shown with their calls alone."""
    elided: Sequence[int] = ()
    """Results whose pictures are left out."""
    cut: Sequence[int] = ()
    """Results that were longer than their cap, and end with a notice."""
    repaired: Sequence[int] = ()
    """Messages that were moved, changed or left out so that each call has its result."""
    rewritten: Sequence[int] = ()
    """Messages that a compactor has changed, or in whose place its own stand."""
    made: int = 0
    """How many calls without a result were answered here."""
    uncertain: Sequence[int] = ()
    """Shown messages with encrypted parts, whose tokens are an estimate."""
    parts: Mapping[str, int] = field(default_factory=dict)
    """Tokens by part: `tools`, `head`, `summary` if there is one, `pinned`, `turns`; priming is in `head`.

    What a strategy has written counts as a summary.
    """
    costs: Sequence[int] = ()
    """Tokens of each message of `messages`."""
    summary: str = ""
    """The message with a summary that it shows after the head; made here, so its source is None."""
    failed: str = ""
    """Why a summary could not be asked for, where the manager goes on without one."""
    recorded_as: tuple[str, int] | None = field(default=None, compare=False)
    """The thread and the number of the prompt in the manager's records."""


@dataclass(frozen=True, slots=True)
class Draft:
    """A prompt that is not finished: a model may have to be asked."""

    head: Sequence[Shown]
    parts: Mapping[str, int]
    """Tokens by part."""
    repaired: Sequence[int]
    made: int
    lacks_user: bool
    """Whether no words of a user stand in the head."""
    turns: Sequence[Shown] = ()
    rewritten: Sequence[int] = ()
    covered: Covered | None = None
    """What a summary has to cover; None if nothing has left, or nobody asks for summaries."""
    asked: AskedStrategy | None = None
    """What a strategy is asked about; None without one."""
    summary: Shown | None = None
    failed: str = ""

    def with_choice(self, chosen: Chosen) -> Draft:
        """Return the prompt with what was chosen."""
        own = sum(each.tokens for each in chosen.shown if each.turn is None)
        texts = {"summary": own} if own else {}
        of_turns = [each for each in chosen.shown if each.turn is not None and each.turn >= 0]
        pinned = sum(each.tokens for each in of_turns if each.turn in chosen.pinned)
        parts = {**self.parts, **texts, "pinned": pinned, "turns": sum(each.tokens for each in of_turns) - pinned}
        return replace(self, turns=chosen.shown, parts=parts, rewritten=chosen.rewritten, failed=chosen.failed)

    def prompt(self, conversation: Conversation) -> FittedPrompt:
        """Return the prompt, with the objects that were given where nothing was changed."""
        summary, parts = self.summary, dict(self.parts)
        shown = [*self.head, *([] if summary is None else [summary]), *self.turns]
        if summary is not None:
            parts = {"tools": parts.pop("tools"), "head": parts.pop("head"), "summary": summary.tokens, **parts}
        out: list[Any] = []
        changed: dict[str, Any] = {"masked": [], "trimmed": [], "elided": [], "cut": []}
        for each in shown:
            source = each.part.source
            is_given = each.part.is_given and each.message is each.part.message
            out.append(conversation.given[source] if is_given and source is not None else each.message)
            if each.change not in (None, "rewritten") and source is not None:
                changed[str(each.change)].append(source)
        sources = [each.part.source for each in shown]
        kept = {*sources, *self.repaired, *self.rewritten}
        return FittedPrompt(
            out,
            sum(parts.values()),
            sources,
            dropped=sorted({*range(len(conversation.given))}.difference(kept)),
            **changed,
            repaired=self.repaired,
            rewritten=self.rewritten,
            made=self.made,
            uncertain=[e.part.source for e in shown if e.part.cost.is_uncertain and e.part.source is not None],
            parts=parts,
            costs=[each.tokens for each in shown],
            summary="" if summary is None else str(summary.message["content"]),
            failed=self.failed,
        )


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


def check_plain(messages: Sequence[Any]) -> None:
    """Raise an `InvalidArgumentError` for a message that holds what is no JSON, or is nested too deep."""
    for number, message in enumerate(messages):
        levels, values = 0, [message]
        while values := [inner for value in values for inner in _inside(value)]:
            levels += 1
        if levels > DEEPEST:
            raise InvalidArgumentError(f"Message {number} is nested {levels} levels deep, which cannot be read.")
        _plain(message, f"Message {number}")


def _inside(value: Any) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()


def plain(message: Any, what: str) -> tuple[Given, object]:
    """Return a message as plain data, and a key that stands for what it says; `what` names it in an error.

    Objects of a client's library are read by `model_dump`. Data that is plain already is not copied.
    """
    if type(message) is dict:
        try:
            return message, marshal.dumps(message, 2)  # in this version equal data have equal bytes
        except ValueError:
            pass
    data = _plain(message, what)
    if not isinstance(data, Mapping):
        raise InvalidArgumentError(
            f"{what} is {type(message).__name__}; a message is a mapping, or an object of a client."
        )
    return data, json.dumps(data, sort_keys=True)


def _plain(value: Any, what: str) -> Any:
    if value is None or isinstance(value, str | int | float | bool):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, what) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner, what) for inner in value]
    if callable(dump := getattr(value, "model_dump", None)):
        return dump(mode="json", exclude_none=True)
    raise InvalidArgumentError(
        f"{what} holds {type(value).__name__}, which is no JSON; give mappings, or the objects of a client."
    )
