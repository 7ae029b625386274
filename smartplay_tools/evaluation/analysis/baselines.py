"""Baselines: the scores with which a score is compared.

A score means little by itself: 31 of 50 for the bandit is six more than guessing and fourteen less than a human score.
The baselines of a setting are the players of the run that played it under the same conditions (such as random and
rule), the paper's eight models and its human baseline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from smartplay_tools.evaluation.analysis.grouping import Condition, PlayedCell
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.games.paper_tables import PAPER_RESULTS

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
