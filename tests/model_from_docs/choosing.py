"""A strategy of one's own that chooses at random, and notes what it was given: docs/add-a-strategy.md."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import smartplay_tools as sp

from .counting import Counting
from .turns import Turn

NAME = "at-random"


@dataclass(frozen=True)
class Asked:
    """A call of `choose`: what the strategy was given, in numbers, and what it returned."""

    step: int
    oldest: int
    room: int | None
    turns: tuple[tuple[int, int, tuple[int, ...], int, int, bool], ...]
    choice: sp.Choice
    is_wrong: bool


class AtRandom:
    """Takes turns at random while they fit, masks some and puts words before some; seldom chooses what it must not."""

    latest: ClassVar[dict[int, Asked]] = {}
    """The calls of the object that was made last, by the number of turns so far."""

    def __init__(self, seed: int = 0) -> None:
        """Equal seeds choose alike."""
        self._seed = seed
        self._asked: dict[int, Asked] = {}
        AtRandom.latest = self._asked

    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        """Choose."""
        rng = random.Random(self._seed * 1_000 + len(past.turns))
        left = 10**9 if room is None else room
        turns: list[int] = []
        masked: list[int] = []
        texts: dict[int, str] = {}
        for turn in rng.sample(list(past.turns), len(past.turns)):
            hides = rng.random() < 0.3
            words = rng.choice(("Then:", " ", "🂡 \ud83d")) if rng.random() < 0.3 else None
            cost = turn.masked_tokens if hides else turn.tokens
            cost += 0 if words is None else past.text_tokens(words)
            if turn.is_pinned or cost > left:
                continue
            left -= cost
            turns.append(turn.number)
            masked += [turn.number] if hides else []
            texts |= {} if words is None else {turn.number: words}
        is_wrong = rng.random() < 0.01
        choice = sp.Choice(turns, masked, texts)
        if is_wrong:
            choice = rng.choice((sp.Choice([len(past.turns)]), sp.Choice([0], [], {0: ""}), sp.Choice([0], [-1])))
        facts = tuple(
            (turn.number, turn.step, tuple(sorted({*turn.shows})), turn.tokens, turn.masked_tokens, turn.is_pinned)
            for turn in past.turns
        )
        self._asked[len(past.turns)] = Asked(past.step, past.oldest, room, facts, choice, is_wrong)
        return choice


def wrongly_given(asked: Asked, n: Counting, turns: Sequence[Turn], expected: dict[str, Any]) -> str:
    """Say what a strategy was given that is not so; `expected` has step, oldest, room, pins, `words` and `pictures`."""
    oldest, words, pictures = expected["oldest"], expected["words"], expected["pictures"]
    facts = tuple(
        (
            number,
            turn.step,
            tuple(sorted({item.shows for item in turn.items if item.shows is not None})),
            n.messages(turn.seen(oldest, words, pictures)),
            n.messages(turn.seen(None, words, pictures)),
            number in expected["pins"],
        )
        for number, turn in enumerate(turns)
    )
    given = {"step": asked.step, "oldest": asked.oldest, "room": asked.room, "turns": asked.turns}
    wanted = {"step": expected["step"], "oldest": oldest, "room": expected["room"], "turns": facts}
    return "; ".join(
        f"{name}: given {given[name]}, expected {wanted[name]}" for name in given if given[name] != wanted[name]
    )


sp.register_strategy(NAME, AtRandom)
