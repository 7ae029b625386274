"""What a difference between two sides shows, in one word.

The words are "identical" if every prompt and reply of both sides is equal (`pairs.are_identical`); else "different" if
the 95 % interval excludes 0, or if all pairs differ by the same amount and the sign test has p < 0.05; else
"equivalent" if the 90 % interval lies within the
margin (two one-sided tests at 5 %); else "undecided". An interval that contains 0 never proves that nothing differs, so
an undecided comparison comes with the smallest difference that this number of pairs would probably have shown (MDE).
There is no default margin: which difference does not matter depends on the game.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import Literal

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.specs import GAMES
from smartplay_tools.statistics.distributions import beyond, crossing, t_power
from smartplay_tools.statistics.intervals import CONFIDENCE, MeanEstimate, Method, Sample, mean_estimate

POWERS = (0.8, 0.9)

TWO_ONE_SIDED = Method(confidence=0.90)

Word = Literal["identical", "different", "equivalent", "undecided", "different, but less"]


@dataclass(frozen=True)
class Margin:
    """A difference in points of the score, or in shares of what lies between the lowest and the human score."""

    number: float
    of_human: bool = False

    @classmethod
    def parse(cls, text: str) -> Margin:
        """Return the margin that "0.5" or "0.1h" means."""
        if (match := re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(h?)", text)) is None or not float(match[1]):
            raise InvalidArgumentError(f"{text!r} is not a difference; write points as 0.5, or human scores as 0.1h.")
        return cls(float(match[1]), of_human=bool(match[2]))

    def points(self, game: str) -> float:
        """Return the margin in points of a game."""
        if not self.of_human:
            return self.number
        spec = GAMES[game]  # never a file: the name is from rows and manifests
        if spec.human_score is None or spec.min_score is None:
            raise InvalidArgumentError(f"{game} has no human score; give the difference in points.")
        return self.number * (spec.human_score - spec.min_score)


@dataclass(frozen=True)
class Verdict:
    """What the pairs of a comparison show."""

    word: Word
    margin: float
    mde: float | None
    """The smallest difference that as many pairs show with a power of 80 %; None if they show no spread."""


def decide(differences: Sample, margin: float, estimate: MeanEstimate | None = None) -> Verdict:
    """Judge the differences of pairs; `estimate` is their usual one, if it is known already."""
    usual = estimate or mean_estimate(differences.values, differences.bounds)
    # What equal pairs exclude, they exclude with 95 % on either side.
    narrower = usual if usual.all_equal else mean_estimate(differences.values, differences.bounds, TWO_ONE_SIDED)
    excludes_0 = usual.low is not None and usual.high is not None and not usual.low <= 0 <= usual.high
    excludes_0 = excludes_0 or (usual.sign_p is not None and usual.sign_p < 1 - CONFIDENCE)
    within = narrower.low is not None and narrower.high is not None and -margin < narrower.low <= narrower.high < margin
    word: Word = "different" if excludes_0 else "equivalent" if within else "undecided"
    if excludes_0 and within:
        word = "different, but less"
    return Verdict(word, margin, mde(usual.sd, usual.episodes) if usual.sd and usual.episodes > 1 else None)


def mde(sd: float, n: int, power: float = POWERS[0], confidence: float = CONFIDENCE) -> float:
    """Return the difference that `n` pairs with this standard deviation show with this power, at a two-sided level."""
    return sd * _effect_seen(n, power, confidence)


@functools.cache
def _effect_seen(n: int, power: float, confidence: float) -> float:
    """The difference that `n` pairs show, in standard deviations: the same for all comparisons of that many pairs."""

    def missing(effect: float) -> float:
        return power - t_power(effect, n, 1 - confidence)

    return crossing(missing, 0.0, beyond(missing), 40)
