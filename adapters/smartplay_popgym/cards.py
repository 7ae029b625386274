"""The games in which cards are shown one after another, and questions are asked about them.

Card 1 is the observation of the reset, and every step shows the next one. Every right answer adds a share of a point,
and every wrong one takes it away.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("A game of POPGym", "popgym"):
    from popgym.envs.autoencode import Autoencode as AutoencodeEnv
    from popgym.envs.count_recall import CountRecall as CountRecallEnv
    from popgym.envs.repeat_first import RepeatFirst as RepeatFirstEnv
    from popgym.envs.repeat_previous import RepeatPrevious as RepeatPreviousEnv

from smartplay_popgym.game import PopgymGame

SUITS = ("spades", "diamonds", "clubs", "hearts")
"""In POPGym's order."""
RANKS = ("an ace", "a two", "a three", "a four", "a five", "a six", "a seven", "an eight", "a nine", "a ten", "a jack",
         "a queen", "a king")  # fmt: skip
KINDS: Mapping[str, tuple[str, ...]] = {"colors": ("black", "red"), "suits": SUITS, "ranks": RANKS}
"""What POPGym tells cards apart by, and the words for it."""
ALL_RIGHT = 0.999
"""Below the score of an episode without a mistake, but for the rounding of floats, and above that with one."""
SHOWN = re.compile(r"Card (\d+) is ([a-z ]+)\.")
ASKED = re.compile(r"Name the suit of card (\d+)\.")
COUNTED = re.compile(r"Card (\d+) is [a-z ]+\. How many of the cards so far are ([a-z ]+)\?")


class CardGame(PopgymGame):
    """A game that shows a card with every step, and asks for the suit of one of them."""

    actions = tuple(suit.capitalize() for suit in SUITS)

    def __init__(self, *, decks: int, **options: Any) -> None:
        """`decks` is the number of decks of 52 cards."""
        self.decks = decks
        self._suits: dict[int, str] = {}
        """Of the cards that were shown, by their numbers."""
        super().__init__(**options)

    @abstractmethod
    def asked(self) -> int | None:
        """The number of the card whose suit the next action has to name; None if no answer counts."""

    def describe(self, observation: Any, info: Mapping[str, Any]) -> str:
        """The card, and the question."""
        self._suits[self.played + 1] = SUITS[observation]
        return f"Card {self.played + 1} is {SUITS[observation]}. {self._question()}"

    def _question(self) -> str:
        card = self.asked()
        return "Name any suit: this answer does not count." if card is None else f"Name the suit of card {card}."

    @property
    def needs(self) -> Mapping[int, str]:
        """The step that showed the card, and its suit."""
        card = self.asked()
        return {} if card is None else {card - 1: f"{card} {self._suits[card]}"}

    @classmethod
    def right_actions(cls, seen: Mapping[int, str], actions: Sequence[str]) -> Sequence[str]:
        """The suit of the card that the newest observation asks for, if one of the observations shows it."""
        question = ASKED.search(seen[max(seen)])
        suits = {card: kind for text in seen.values() for card, kind in SHOWN.findall(text)}
        return () if question is None or question[1] not in suits else (suits[question[1]].capitalize(),)

    def _is_completed(self, terminated: bool) -> bool:
        return terminated and self.score > ALL_RIGHT


class RepeatFirst(CardGame):
    """Name the suit of the first card, again and again."""

    manual = (
        "You are shown cards, one after another. Whatever card is shown, name the suit of the first one. Every right "
        "answer adds to your score, and every wrong one takes as much away."
    )

    def make_env(self) -> RepeatFirstEnv:
        """The environment of POPGym."""
        return RepeatFirstEnv(num_decks=self.decks)

    def asked(self) -> int:
        """Always the first card."""
        return 1


class RepeatPrevious(CardGame):
    """Name the suit of an earlier card, at a fixed distance."""

    def __init__(self, *, decks: int, k: int, **options: Any) -> None:
        """`k` counts as POPGym does: the newest card is 1, the one before it 2."""
        self.k = k
        manual = (
            f"You are shown cards, one after another. Name the suit of the card that was shown {k - 1} cards before "
            "the newest one. Every right answer adds to your score, and every wrong one takes as much away; while "
            "there is no such card, answers do not count."
        )
        super().__init__(decks=decks, manual=manual, **options)

    def make_env(self) -> RepeatPreviousEnv:
        """The environment of POPGym."""
        return RepeatPreviousEnv(num_decks=self.decks, k=self.k)

    def asked(self) -> int | None:
        """The card that was shown k - 1 steps before the newest one."""
        card = self.played + 2 - self.k
        return card if card > 0 else None


class Autoencode(CardGame):
    """See all cards, then name their suits from the last to the first."""

    manual = (
        "You are shown cards, one after another; your answers do not count while there are more to come. Then name the "
        "suit of every card in the opposite order, from the last to the first. Every right answer adds to your score, "
        "and every wrong one takes as much away."
    )

    def make_env(self) -> AutoencodeEnv:
        """The environment of POPGym."""
        return AutoencodeEnv(num_decks=self.decks)

    @property
    def _named(self) -> int:
        """How many suits have been named; less than 0 while there are more cards to come."""
        return self.played + 1 - 52 * self.decks

    def describe(self, observation: Any, info: Mapping[str, Any]) -> str:
        """The card and the question; after the last card, the question alone."""
        return super().describe(observation[1], info) if self._named <= 0 else self._question()

    def asked(self) -> int | None:
        """The last card that has not been named yet."""
        card = 52 * self.decks - self._named
        return card if self._named >= 0 and card > 0 else None


class CountRecall(PopgymGame):
    """Say how many cards of a kind have been shown."""

    def __init__(self, *, decks: int, kinds: str, **options: Any) -> None:
        """`kinds` are "colors", "suits" or "ranks"."""
        self.decks, self.kinds = decks, kinds
        self._words = KINDS[kinds]
        self._shown: dict[int, str] = {}
        """What the cards were, by the steps that showed them."""
        most = 52 * decks // len(self._words)
        manual = (
            f"You are shown cards, one after another, and are asked for a kind of cards ({', '.join(self._words)}). "
            "Say how many cards of that kind have been shown so far, the newest card included. Every right answer adds "
            "to your score, and every wrong one takes as much away."
        )
        super().__init__(actions=tuple(map(_cards, range(most + 1))), manual=manual, **options)

    def make_env(self) -> CountRecallEnv:
        """The environment of POPGym."""
        return CountRecallEnv(num_decks=self.decks, deck_type=self.kinds)

    def describe(self, observation: Any, info: Mapping[str, Any]) -> str:
        """The card, and the question."""
        shown, asked = (self._words[kind] for kind in observation)
        self._shown[self.played] = f"card {self.played + 1} {shown.split()[-1]}"
        return f"Card {self.played + 1} is {shown}. How many of the cards so far are {asked}?"

    @property
    def needs(self) -> Mapping[int, str]:
        """All steps: each has shown a card that counts or does not."""
        return {step: self._shown[step] for step in range(self.played + 1)}

    @classmethod
    def right_actions(cls, seen: Mapping[int, str], actions: Sequence[str]) -> Sequence[str]:
        """The number of cards of the kind, if every card is shown by one of the observations."""
        question = COUNTED.search(seen[max(seen)])
        shown = {card: kind for text in seen.values() for card, kind in SHOWN.findall(text)}
        if question is None or len(shown) < int(question[1]):
            return ()
        return (_cards(sum(kind == question[2] for kind in shown.values())),)

    def _is_completed(self, terminated: bool) -> bool:
        return terminated and self.score > ALL_RIGHT


def _cards(number: int) -> str:
    return "1 card" if number == 1 else f"{number} cards"
