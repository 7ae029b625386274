"""Concentration: cards lie face down, and two that are alike have to be turned one after the other."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("A game of POPGym", "popgym"):
    from popgym.envs.concentration import Concentration as ConcentrationEnv

from smartplay_popgym.cards import KINDS
from smartplay_popgym.game import PopgymGame

TURNED = re.compile(r"[Pp]lace (\d+) is ([a-z ]+?)(?=[.,]| and )")
KEPT = re.compile(r"Face up: ([\d, ]+)\.")
SECOND = "Turn a second card."


class Concentration(PopgymGame):
    """Turn two cards that are alike, until all are face up."""

    def __init__(self, *, decks: int, kinds: str, **options: Any) -> None:
        """`kinds` are what has to be alike: "colors" or "ranks"."""
        self.decks, self.kinds = decks, kinds
        self._kinds: list[str] = []
        """Of the cards, by their places."""
        self._shown: dict[int, int] = {}
        """The step that has shown a card last, by its place; the newest are last."""
        self._before: tuple[int, ...] = ()
        """The places that were face up before the latest step."""
        manual = (
            f"{52 * decks} cards lie face down. Turn one, and then a second one: if they are alike "
            f"({', '.join(KINDS[kinds])}), both stay face up and add to your score; if not, they are turned back and "
            "take away from it. A card that is face up already must not be turned. The game ends when all cards are "
            f"face up, and after {104 * decks} turns."
        )
        places = tuple(f"Place {place}" for place in range(1, 52 * decks + 1))
        super().__init__(actions=places, manual=manual, **options)

    def make_env(self) -> ConcentrationEnv:
        """The environment of POPGym."""
        return ConcentrationEnv(num_decks=self.decks, deck_type=self.kinds)

    def describe(self, observation: Any, info: Mapping[str, Any]) -> str:
        """What was turned, and which cards are face up for good."""
        if not self.played:
            self._kinds, self._shown, self._before = [KINDS[self.kinds][kind] for kind in self.env.state], {}, ()
            return "All cards lie face down. Turn a card."
        turned, kept = self.env.last_in_play_idx, tuple(self.env.deck["face_up_idx"])
        for place in turned:
            if place not in self._before:
                self._shown.pop(place, None)
                self._shown[place] = self.played
        is_open = bool(self.env.deck["in_play_idx"])
        text = self._outcome(turned, kept)
        self._before = kept
        places = ", ".join(str(place + 1) for place in sorted(kept))
        return f"{text} {f'Face up: {places}. ' if kept else ''}{SECOND if is_open else 'Turn a card.'}"

    def _outcome(self, turned: Sequence[int], kept: Sequence[int]) -> str:
        first, second = turned[0], turned[-1]
        if second in self._before:
            back = "" if len(turned) == 1 else f", so that at place {first + 1} is turned back"
            return f"The card at place {second + 1} was face up before{back}."
        if len(turned) == 1:
            return f"Place {first + 1} is {self._kinds[first]}."
        if first == second:
            return f"Place {first + 1} is {self._kinds[first]}, and was turned twice: it is turned back."
        both = f"Place {first + 1} is {self._kinds[first]} and place {second + 1} is {self._kinds[second]}"
        return f"{both}, so they stay face up." if second in kept else f"{both}, so they are turned back."

    @property
    def needs(self) -> Mapping[int, str]:
        """The steps that have shown the cards of a pair last: one if its other card is face up; none without a pair."""
        opened, newest = self.env.deck["in_play_idx"], defaultdict[str, list[tuple[int, str]]](list)
        face_up = set(self.breaks)
        for place, step in reversed(self._shown.items()):
            if place not in face_up:
                newest[self._kinds[place]].append((step, f"{place + 1} {self._kinds[place].split()[-1]}"))
        if opened:
            return dict(newest[self._kinds[opened[0]]][:1])
        pairs = [sorted(shown[:2]) for shown in newest.values() if len(shown) > 1]
        return dict(max(pairs, key=lambda pair: [step for step, _ in pair], default=()))

    @property
    def breaks(self) -> Sequence[int]:
        """The cards that are face up."""
        return sorted([*self.env.deck["face_up_idx"], *self.env.deck["in_play_idx"]])

    @classmethod
    def right_actions(cls, seen: Mapping[int, str], actions: Sequence[str]) -> Sequence[str]:
        """The partner of the card that was turned, or the cards of a pair, if the observations show one.

        Otherwise there is nothing to remember but what the cards are not: those that have not been shown.
        """
        newest = seen[max(seen)]
        kinds = {place: kind for text in seen.values() for place, kind in TURNED.findall(text)}
        opened = [place for place, _ in TURNED.findall(newest)] if SECOND in newest else []
        done = [*opened, *(place for match in KEPT.findall(newest) for place in match.split(", "))]
        hidden = [action for action in actions if action.removeprefix("Place ") not in done]
        known = {action: kind for action in hidden if (kind := kinds.get(action.removeprefix("Place ")))}
        often = Counter(known.values())
        wanted = {kinds[place] for place in opened} or {kind for kind, number in often.items() if number > 1}
        alike = [action for action, kind in known.items() if kind in wanted]
        return alike or [action for action in hidden if action not in known] or hidden
