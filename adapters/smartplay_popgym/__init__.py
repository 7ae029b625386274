"""POPGym's games of memory in words: five families in three sizes.

A game shows its cards one by one, and what was shown has to be remembered. Every observation is one sentence with the
number of its card and the question that the next action answers, so that the numbers of steps and of cards cannot be
confused. Rules, rewards and worlds are POPGym's; the words are ours. This module does not import POPGym; a game does
when it is made.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from smartplay_tools.games import GameSpec
from smartplay_tools.games.game_registry import Pack

__all__ = ["CARDS"]

SIZES = ("Easy", "Medium", "Hard")
TRIALS = 20


def _setting(family: str, size: str, module: str, rollout: int, worst_step: float, **facts: Any) -> GameSpec:
    """A setting that shows the whole past by default, and whose scores lie between -1 and 1."""
    return GameSpec(
        id=f"popgym-{family}{size}-v0",
        family="popgym",
        entry_point=f"smartplay_popgym.{module}:{family}",
        history=rollout,
        rollout=rollout,
        trials=TRIALS,
        score_bounds=(-1, 1),
        worst_step=worst_step,
        **facts,
    )


def _cards() -> Iterator[GameSpec]:
    """Yield the settings with cards, with POPGym's numbers of decks, of 52 cards each."""
    for size, decks in zip(SIZES, (1, 8, 16), strict=True):
        steps = 52 * decks - 1
        facts = {"kwargs": {"decks": decks}, "memory": "all", "action_count": 4}
        yield _setting("RepeatFirst", size, "cards", steps, -1 / steps, **facts)
    for size, decks, k in zip(SIZES, (1, 2, 3), (4, 32, 64), strict=True):
        facts = {"kwargs": {"decks": decks, "k": k}, "memory": k - 1, "action_count": 4}
        yield _setting("RepeatPrevious", size, "cards", 52 * decks - 1, -1 / (52 * decks - k), **facts)
    for size, decks in zip(SIZES, (1, 2, 3), strict=True):
        facts = {"kwargs": {"decks": decks}, "memory": "all", "action_count": 4}
        yield _setting("Autoencode", size, "cards", 104 * decks - 1, -1 / (52 * decks), **facts)
    for size, decks, kinds, most in zip(SIZES, (1, 2, 4), ("colors", "suits", "ranks"), (26, 26, 16), strict=True):
        facts = {"kwargs": {"decks": decks, "kinds": kinds}, "memory": "all", "action_count": most + 1}
        yield _setting("CountRecall", size, "cards", 52 * decks - 1, -1 / (52 * decks - 1), **facts)
    for size, decks, kinds in zip(SIZES, (1, 2, 1), ("colors", "colors", "ranks"), strict=True):
        facts = {"kwargs": {"decks": decks, "kinds": kinds}, "memory": "all", "action_count": 52 * decks}
        yield _setting("Concentration", size, "concentration", 104 * decks, -2 / (104 * decks), **facts)


CARDS = Pack("popgym", ("popgym",), tuple(_cards()))
"""RepeatFirst, RepeatPrevious, Autoencode, CountRecall and Concentration."""
