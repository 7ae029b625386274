"""Reading: a list of messages as units, in which calls and results belong together.

Agents keep lists that providers refuse: results without calls, calls without results, a result far from its call. Here
each such list becomes one that is whole, and what was repaired is named.

A reading remembers nothing that its messages do not say. When the list has grown, what it has in common with the list
before is not read again; read from nothing, it is the same.
"""

from __future__ import annotations

import copy
import operator
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence

from smartplay_tools.manager.counting import NO_RESULT
from smartplay_tools.manager.forms import Given, Kind, MessageForm
from smartplay_tools.manager.plain import named
from smartplay_tools.manager.units import Part, Unit
from smartplay_tools.manager.window import AgentWindow


def kind_of(form: MessageForm, number: int, message: Given) -> Kind:
    """Return what a message is; one that the form does not have is an `InvalidArgumentError` with its number."""
    with named(f"Message {number}"):
        return form.kind(message)


class Reading:
    """A conversation after its head, as units."""

    def __init__(self, window: AgentWindow, begin: int, most: int | None, pin: Callable[[Given], bool]) -> None:
        """`begin` is the number of the first message after the head, `most` the cap on a result."""
        self.window, self.form, self.turns = window, window.form, window.turns
        """The units are the turns of the window."""
        self._begin, self._most, self._pin = begin, most, pin
        self._objects: list[Given] = []
        """The messages of the list that was read last."""
        self._keys: list[object] = []
        self._clean: list[int] = []
        """Units at which reading can begin: no earlier call waits there, and none is answered later."""
        self.pinned: list[int] = []
        """Units that `pin` has marked."""
        self.compactions: list[int] = []
        """Units with a provider's own summary of what was before them."""
        self.users: list[int] = []
        self.instructions: list[int] = []
        """Units that are words of the user, and those that are the operator's."""
        self.repaired: list[int] = []
        """Messages that were moved, changed or left out so that calls and results belong together."""
        self.made: list[int] = []
        """Units in which a call was answered here, once for each call."""
        self.late: list[int] = []
        """The unit of the last message, where others follow it."""

    def read(self, messages: Sequence[Given], keys: list[object]) -> None:
        """Read a list; `keys` stand for what its messages say."""
        known, same = self._keys, len(self._keys)
        if keys[:same] != known:
            pairs = enumerate(zip(keys, known, strict=False))
            same = next((number for number, (one, other) in pairs if one != other), min(len(keys), len(known)))
        unit = next((u for u in reversed(self._clean) if u < len(self.turns) and self._first(u) < same), None)
        start = self._begin if unit is None else self._first(unit)
        self._back_to(unit or 0, start)
        if any(map(operator.is_not, messages, self._objects)):
            for part in (part for turn in self.turns for part in turn.unit.parts if part.is_given):
                if part.source is not None:
                    part.message = messages[part.source]  # an equal one of an earlier list may have been changed since
        self._objects = [*messages]
        self._keys = keys
        self._append(self._grouped(messages, start), messages, keys, start)

    def copy(self) -> Reading:
        """Return it as it is now: another list may be read while a model is asked about this one."""
        copied = copy.copy(self)
        vars(copied).update({name: [*value] for name, value in vars(self).items() if isinstance(value, list)})
        return copied

    def kept(self, stop: int) -> set[int]:
        """Return the units before one that every prompt shows, beside the newest."""
        newest = (self.users, self.instructions, self.compactions)
        kept = {numbers[at - 1] for numbers in newest if (at := bisect_left(numbers, stop))}
        late = self.late if stop == len(self.turns) else ()
        return kept.union(self.pinned[: bisect_left(self.pinned, stop)], late)

    def _first(self, unit: int) -> int:
        """The number of a unit's first message."""
        return self.turns[unit].unit.parts[0].source or 0

    def _back_to(self, unit: int, start: int) -> None:
        self.repaired = [number for number in self.repaired if number < start]
        marked = (self.pinned, self.compactions, self.users, self.instructions)
        for numbers in (self._clean, *marked, self.made, self.late):
            del numbers[bisect_left(numbers, unit) :]
        self.window.back_to(unit)

    def _grouped(self, messages: Sequence[Given], start: int) -> list[Unit]:
        """Return the units from a message on: every result with its call, whatever stands between them."""
        form, units, waiting = self.form, list[Unit](), dict[str, list[Unit]]()
        for number in range(start, len(messages)):
            message = messages[number]
            kind = kind_of(form, number, message)
            if kind == "result":
                self._place(number, message, units, waiting)
                continue
            last = units[-1] if units else None
            goes_on = (
                kind == "reply"
                and last is not None
                and last.kind == "reply"
                and form.kind(last.parts[-1].message) == "reply"
                and form.continues(last.parts[-1].message, message)
            )
            if last is None or not goes_on:
                units.append(last := Unit(kind, []))
            last.parts.append(Part(number, message))
            for call in form.calls(message) if kind == "reply" else ():
                last.open.append(call)
                waiting.setdefault(call, []).append(last)
        for unit in units[:-1]:
            unit.is_late = unit.parts[-1].source == len(messages) - 1
        return units

    def _place(self, number: int, message: Given, units: list[Unit], waiting: dict[str, list[Unit]]) -> None:
        """Put the results of a message into the units of their calls; results without a call are left out."""
        form, answered = self.form, self.form.answers(message)
        owners = [waiting[call].pop() if waiting.get(call) else None for call in answered]
        for call, owner in zip(answered, owners, strict=True):
            if owner is not None:
                owner.open.remove(call)
        last = next((unit for unit in reversed(units) if any(unit is owner for owner in owners)), None)
        shares = {id(owner): owner for owner in owners if owner is not None}
        kept: Given | None = message
        for owner in shares.values() or [None]:
            if owner is None or any(each is not owner for each in owners):
                pairs = zip(form.results(message), owners, strict=True)
                contents = [content if owner is not None and each is owner else None for content, each in pairs]
                kept = form.with_results(message, contents, with_words=owner is last)
            if kept is not None:
                parts = [Part(number, kept)]
                units.append(Unit("word", parts)) if owner is None else owner.parts.extend(parts)
        if kept is not message or last is not units[-1]:
            self.repaired.append(number)

    def _append(self, units: Sequence[Unit], messages: Sequence[Given], keys: list[object], start: int) -> None:
        newest, is_whole = start - 1, True
        for unit in units:
            number = len(self.turns)
            if is_whole and newest < (unit.parts[0].source or 0):
                self._clean.append(number)
            newest = max([newest, *(part.source for part in unit.parts if part.source is not None)])
            is_whole = is_whole and not unit.open
            self._complete(unit, number)
            for part, (opens, opens_calls) in zip(unit.parts, self._openings(unit), strict=True):
                part.is_given = part.source is not None and part.message is messages[part.source]
                key = keys[part.source] if part.is_given and part.source is not None else repr(part.message)
                with named(f"Message {part.source}"):
                    part.cost = self.window.messages.cost(
                        part.message, self.form, self._most, key, opens=opens, opens_calls=opens_calls
                    )
            if unit.kind == "word":
                is_operator = unit.parts[0].message.get("role") in ("system", "developer")
                (self.instructions if is_operator else self.users).append(number)
            if any(self._pin(part.message) for part in unit.parts):
                self.pinned.append(number)
            if unit.is_late:
                self.late.append(number)
            if any(_is_compaction(part.message) for part in unit.parts):
                self.compactions.append(number)
            has_results = any(part.cost.is_result for part in unit.parts)
            self.window.add_unit(unit, (self.turns[-1].step if self.turns else 0) + has_results)

    def _complete(self, unit: Unit, number: int) -> None:
        """Answer the calls that have no result, and give results the form that providers want."""
        form = self.form
        self.made += [number] * len(unit.open)
        made = form.made(unit.open, NO_RESULT)
        replies = (
            [part for part in unit.parts if form.kind(part.message) != "result"] if unit.kind == "reply" else unit.parts
        )
        results = unit.parts[len(replies) :]
        messages = [part.message for part in results] + [*made]
        joined = form.joined(messages)
        if joined is messages:
            unit.parts += [Part(None, message) for message in made]
        else:
            self.repaired += [part.source for part in results if part.source is not None]
            source = results[0].source if results else None
            unit.parts[len(replies) :] = [Part(source, message) for message in joined]

    def _openings(self, unit: Unit) -> list[tuple[bool, bool]]:
        """Whether each message of a unit begins a chat message, and whether it does where replies are calls alone.

        Items that continue a reply do not.
        """
        kinds = [self.form.kind(part.message) for part in unit.parts]
        calls = (at for at, kind in enumerate(kinds) if kind == "reply" and self.form.calls(unit.parts[at].message))
        first = next(calls, None)
        return [(at == 0 or kind != "reply", at == first) for at, kind in enumerate(kinds)]


def _is_compaction(message: Given) -> bool:
    """Whether a message holds what is left of the messages before it: OpenAI's item, or a block of Anthropic's."""
    content = message.get("content")
    blocks = content if isinstance(content, list) else ()
    return any(isinstance(each, Mapping) and each.get("type") == "compaction" for each in (message, *blocks))
