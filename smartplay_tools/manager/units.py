"""Units: what a conversation of an agent consists of, and how a message of one is shown."""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from smartplay_tools.manager.counting import Cost, MessageCounter
from smartplay_tools.manager.forms import Content, Given, Kind, MessageForm
from smartplay_tools.transcript.hashing import canonical_json


@dataclass(slots=True)
class Part:
    """A message of a unit."""

    source: int | None
    """Its number in the list; None for one that was made here."""
    message: Given
    cost: Cost = field(default_factory=lambda: Cost(0))
    is_given: bool = False
    """Whether it is the message of the list as it is there, whichever object says it."""


@dataclass(slots=True)
class Unit:
    """A reply with its results, or one other message: shown or dropped as a whole."""

    kind: Kind
    parts: list[Part]
    open: list[str] = field(default_factory=list)
    """The ids of its calls that have no result yet."""
    is_late: bool = False
    """Whether the last message of the list is its, though other units follow it."""
    _digest: bytes = field(default=b"", init=False, repr=False, compare=False)

    @property
    def digest(self) -> bytes:
        """The sha256 of its messages."""
        if not self._digest:
            self._digest = hashlib.sha256(canonical_json([part.message for part in self.parts])).digest()
        return self._digest

    @property
    def replies(self) -> list[Part]:
        """Its messages without results."""
        return [part for part in self.parts if not part.cost.is_result]


@dataclass(slots=True)
class Shown:
    """A message of a prompt."""

    part: Part
    message: Given
    tokens: int
    change: str | None = None
    """What was changed of it: masked, trimmed, elided, cut or rewritten."""
    turn: int | None = None
    """The number of its turn, -1 before the first turn; None for a message that a strategy has made."""

    @classmethod
    def whole(cls, part: Part, turn: int = -1) -> Shown:
        """Return a message as it was first shown."""
        return cls(part, part.message, part.cost.whole, turn=turn)


@dataclass(frozen=True, slots=True)
class Chosen:
    """The messages of a prompt after its head, selected by the built-in rule, a strategy or a compactor."""

    shown: Sequence[Shown] = ()
    pinned: Collection[int] = ()
    """The turns that stay for another reason than being among the newest."""
    rewritten: Sequence[int] = ()
    """The messages that were changed, or in whose place others stand."""
    failed: str = ""
    """Why a compactor was not asked."""


def digests_of(seed: bytes, parts: Iterable[bytes]) -> list[bytes]:
    """Return for each part the sha256 of a seed and all parts up to it."""
    digest, found = hashlib.sha256(seed), []
    for part in parts:
        digest.update(part)
        found.append(digest.digest())
    return found


def as_first_shown(part: Part, form: MessageForm) -> Given:
    """Return a message with its results cut to their cap."""
    return part.message if part.cost.cut is None else form.cut(part.message, part.cost.cut)


def squeezed(unit: Unit, room: float, form: MessageForm, counter: MessageCounter) -> Unit | None:
    """Return a unit whose results are cut to one length, the longest with which it fits into a room.

    None without results, or if they are not enough.
    """
    texts = {
        at: [Content.of(content).text if cut is None else cut for content, cut in _cuts(part, form)]
        for at, part in enumerate(unit.parts)
        if part.cost.is_result
    }
    sizes = [counter.text(text) for each in texts.values() for text in each]
    rest = sum(part.cost.whole for part in unit.parts) - sum(sizes)
    if not sizes or rest > room:
        return None
    lengths = range(max(sizes) + 1)
    share = bisect_right(lengths, room - rest, key=lambda length: sum(min(size, length) for size in sizes)) - 1
    parts = [*unit.parts]
    for at, each in texts.items():
        part = parts[at]
        cut = [
            text if counter.text(text) <= share else counter.cut(Content.of(content).text, share)
            for content, text in zip(form.results(part.message), each, strict=True)
        ]
        tokens = part.cost.whole + sum(map(counter.text, cut)) - sum(map(counter.text, each))
        parts[at] = replace(part, cost=replace(part.cost, whole=tokens, cut=cut, pictures=0))
    return replace(unit, parts=parts)


def _cuts(part: Part, form: MessageForm) -> Iterator[tuple[Any, str | None]]:
    """The contents of a message's results, each with its text if that was cut."""
    contents: Sequence[Any] = form.results(part.message)
    return zip(contents, part.cost.cut or [None] * len(contents), strict=True)
