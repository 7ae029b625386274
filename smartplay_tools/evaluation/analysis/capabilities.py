"""Capability scores: the paper's nine capabilities, each as a weighted mean of normalised scores.

The score of capability c is sum over settings of d(c, setting) x s(setting), divided by the sum of d(c, setting): s is
the mean normalised score, d the degree (1 to 3 or 4) to which the setting requires the capability (paper, table
`table:challenges`; `GameSpec.challenges`). The original's code weighs by d - 1, so that a setting that hardly requires
a capability has no influence on its score; that is `weights="zero-based"`. For some sets of games all these weights
are 0.

A setting without a normalised score (no human baseline, or an engine that is not comparable) or without ratings (games
of other packages need not have them) is left out of both sums and named. For intervals, episodes are resampled within
each setting; the settings themselves are not a sample.

Baselines: the scores with which a score is compared.

A score means little by itself: 31 of 50 for the bandit is six more than guessing and fourteen less than a human score.
The baselines of a setting are the players of the run that played it under the same conditions (such as random and
rule), the paper's eight models and its human baseline.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.grouping import Condition, PlayedCell
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate, weighted_estimates
from smartplay_tools.games.paper_tables import CAPABILITIES, PAPER_RESULTS
from smartplay_tools.games.specs import get_spec

Weights = Literal["paper", "zero-based"]

NO_SETTING = "no setting of the run has a normalised score"
WEIGHTS_VANISH = "every setting of the run is rated 1 here, so the zero-based weights vanish"


@dataclass(frozen=True)
class CapabilityScore:
    """One capability; without an estimate, `reason` says why."""

    capability: str
    estimate: MeanEstimate | None
    reason: str | None = None


@dataclass(frozen=True)
class Capabilities:
    """A player's profile under one condition."""

    weights: Weights
    scores: tuple[CapabilityScore, ...]
    """In the order of the paper's table."""
    settings: tuple[str, ...]
    """The settings that are part of the score."""
    left_out: tuple[str, ...]
    """The settings that were played but have no normalised score, or no ratings."""


def capability_scores(normalized: Mapping[str, Sequence[float | None]], *, weights: Weights = "paper") -> Capabilities:
    """Score the nine capabilities from the normalised scores of episodes, by setting; None means no score."""
    if weights not in get_args(Weights):
        raise InvalidArgumentError(f"weights must be one of {', '.join(get_args(Weights))}, not {weights!r}.")
    by_game = {game: [score for score in scores if score is not None] for game, scores in normalized.items()}
    samples = {game: scores for game, scores in by_game.items() if scores and get_spec(game).challenges}
    scores = _scores(samples, weights)
    left_out = tuple(game for game in by_game if game not in samples)
    return Capabilities(weights, scores, tuple(samples), left_out)


def _scores(samples: Mapping[str, Sequence[float]], weights: Weights) -> tuple[CapabilityScore, ...]:
    if not samples:
        return tuple(CapabilityScore(capability, None, NO_SETTING) for capability in CAPABILITIES)
    degrees = {
        capability: [get_spec(game).challenges[capability] - (weights == "zero-based") for game in samples]
        for capability in CAPABILITIES
    }
    shares = {
        capability: [degree / sum(row) for degree in row] for capability, row in degrees.items() if sum(row)
    }  # those without a weight have no score
    estimates = dict(zip(shares, weighted_estimates(list(samples.values()), list(shares.values())), strict=True))
    return tuple(
        CapabilityScore(capability, estimates.get(capability), None if capability in estimates else WEIGHTS_VANISH)
        for capability in CAPABILITIES
    )


Source = Literal["run", "paper"]


@dataclass(frozen=True)
class Baseline:
    """One player's mean score at a setting."""

    name: str
    source: Source
    score: float
    normalized_score: float | None
    episodes: int | None
    """None for the paper's baselines, because the paper gives only means."""


@dataclass(frozen=True)
class Baselines:
    """All baselines of one setting for players with the same label."""

    game: str
    label: str
    """A short description of the conditions of the run's players."""
    engine: str | None
    comparable: bool
    """Whether the paper's scores are of the same game; False for another engine, or without a human score."""
    baselines: tuple[Baseline, ...]
    """The run's players in its order, then the paper's."""

    def get(self, name: str, source: Source = "run") -> Baseline | None:
        """Return the baseline of that name, if there is one."""
        return next((each for each in self.baselines if (each.name, each.source) == (name, source)), None)

    @property
    def models(self) -> tuple[Baseline, ...]:
        """The paper's models, without the human baseline."""
        return tuple(each for each in self.baselines if each.source == "paper" and each.name != "human")


Played = tuple[PlayedCell, MeanEstimate, MeanEstimate | None]
"""A cell with its score and its normalised score."""


def find_baselines(played: Sequence[tuple[Condition, Sequence[Played]]]) -> list[Baselines]:
    """Return the baselines of a run, from the cells of its conditions: one set for each setting and label."""
    groups: dict[tuple[str, str], list[Played]] = {}
    for condition, cells in played:
        for entry in cells:
            groups.setdefault((condition.label, entry[0].game), []).append(entry)
    return [_baselines(label, cells) for (label, _), cells in groups.items()]


def _baselines(label: str, played: Sequence[Played]) -> Baselines:
    cell = played[0][0]
    ours = [
        Baseline(cell.player, "run", score.mean, None if normalized is None else normalized.mean, score.episodes)
        for cell, score, normalized in played
    ]
    papers = [
        Baseline(row.player, "paper", row.raw[cell.game], row.normalized[cell.game], None)
        for row in PAPER_RESULTS
        if cell.game in row.raw
    ]
    comparable = any(normalized is not None for _, _, normalized in played)
    return Baselines(cell.game, label, cell.engine, comparable, (*ours, *papers))
