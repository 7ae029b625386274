"""Capability scores: the paper's nine capabilities, each as a weighted mean of normalised scores.

The score of capability c is sum over settings of d(c, setting) x s(setting), divided by the sum of d(c, setting): s is
the mean normalised score, d the degree (1 to 3 or 4) to which the setting requires the capability (paper, table 3;
`GameSpec.challenges`).

A setting without a normalised score (no human baseline, or an engine that is not comparable) or without ratings (games
of other packages need not have them) is left out of both sums and named. For intervals, episodes are resampled within
each setting; the settings themselves are not a sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from smartplay_tools.games.paper_tables import CAPABILITIES
from smartplay_tools.games.specs import GAMES
from smartplay_tools.statistics.intervals import MeanEstimate, weighted_estimates

__all__ = ["Capabilities", "capability_scores"]

NO_SETTING = "no setting of the run has a normalised score"


@dataclass(frozen=True)
class CapabilityScore:
    """One capability; without an estimate, `reason` says why."""

    capability: str
    estimate: MeanEstimate | None
    reason: str | None = None


@dataclass(frozen=True)
class Capabilities:
    """A player's profile under one condition."""

    scores: tuple[CapabilityScore, ...]
    """In the order of the paper's table."""
    settings: tuple[str, ...]
    """The settings that are part of the score."""
    left_out: tuple[str, ...]
    """The settings that were played but have no normalised score, or no ratings."""


def capability_scores(normalized: Mapping[str, Sequence[float | None]]) -> Capabilities:
    """Score the nine capabilities from the normalised scores of episodes, by setting; None means no score."""
    by_game = {game: [score for score in scores if score is not None] for game, scores in normalized.items()}
    rated = {game for game in by_game if (spec := GAMES.get(game)) is not None and spec.challenges}
    samples = {game: scores for game, scores in by_game.items() if scores and game in rated}
    left_out = tuple(game for game in by_game if game not in samples)
    return Capabilities(_scores(samples), tuple(samples), left_out)


def _scores(samples: Mapping[str, Sequence[float]]) -> tuple[CapabilityScore, ...]:
    if not samples:
        return tuple(CapabilityScore(capability, None, NO_SETTING) for capability in CAPABILITIES)
    degrees = [[GAMES[game].challenges[capability] for game in samples] for capability in CAPABILITIES]
    shares = [[degree / sum(row) for degree in row] for row in degrees]
    estimates = weighted_estimates(list(samples.values()), shares)
    return tuple(map(CapabilityScore, CAPABILITIES, estimates))
