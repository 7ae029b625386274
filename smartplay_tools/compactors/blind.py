"""Blind choices: which older turns stay follows from their numbers alone, and from no word of theirs.

They show what a choice wins that knows nothing of the game: `keep-random` keeps older turns at random, `keep-spread`
at even distances. A turn that has left does not come back, but where the turns that stay have become shorter.
"""

from __future__ import annotations

import random
from abc import abstractmethod

from smartplay_tools.context.strategies.choices import Choice, Past
from smartplay_tools.errors import InvalidArgumentError


class BlindChoice:
    """Keeps the newest turns in a share of the room, and of the older ones those of the lowest rank that fit."""

    reads_everything = True

    def __init__(self, *, newest: float = 0) -> None:
        """`newest` is the share, from 0 to 1."""
        if not 0 <= newest <= 1:
            raise InvalidArgumentError(f"newest is a share of the room, from 0 to 1, not {newest!r}.")
        self.newest = newest

    @abstractmethod
    def rank(self, number: int) -> float:
        """Return the rank of a turn."""

    def choose(self, past: Past, room: int | None) -> Choice:
        """Return the turns that stay."""
        turns = [turn for turn in reversed(past.turns) if not turn.is_pinned]
        if room is None:
            return Choice(turn.number for turn in turns)
        used = young = 0
        while young < len(turns) and used + turns[young].tokens <= self.newest * room:
            used += turns[young].tokens
            young += 1
        kept = [turn.number for turn in turns[:young]]
        for turn in sorted(turns[young:], key=lambda turn: self.rank(turn.number)):
            if used + turn.tokens <= room:
                used += turn.tokens
                kept.append(turn.number)
        return Choice(kept)


class RandomTurns(BlindChoice):
    """Keeps older turns at random; the same turns stay from prompt to prompt."""

    def __init__(self, *, newest: float = 0, seed: int = 0) -> None:
        super().__init__(newest=newest)
        self._seed = seed

    def rank(self, number: int) -> float:
        """Return what is drawn for the turn."""
        return random.Random(f"turn {self._seed} {number}").random()


class SpreadTurns(BlindChoice):
    """Keeps older turns at even distances, which double where too many have to fit."""

    def rank(self, number: int) -> float:
        """Return less for a number that can be halved more often."""
        return -(number & -number or 1 << 62)
