"""What stands beside a score: how many episodes ended early, their steps, and the points that the game has paid.

A score that only grows is larger where an episode has more steps. So tables have a column of steps where episodes
ended before their game did, or where such a score comes from different numbers of steps; and a column of points where
the score is not what the player was told and paid.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.result import GAME_ENDS

EARLY = "\N{DOUBLE DAGGER}"
"""The mark of cells with episodes that ended before their game did."""

STEPS = "steps: of an episode, mean; a score that only grows is compared with their number in view"
POINTS = "points: what the game has paid, as its player was told; mean"
WAY = "to best: the share of the way from dropping the oldest turns to the best choice of whole turns under the cap"
LEAST = "beyond the paper's settings, each counts as the least that the missing steps allow"


@dataclass(frozen=True)
class Beside:
    """What decides whether a table shows more than the score of a cell."""

    game: str
    score: float
    points: float
    steps: float
    ends: Mapping[str, int]
    """The early ends of its episodes."""

    @classmethod
    def of(cls, game: str, means: Mapping[str, MeanEstimate], ends: Mapping[str, int]) -> Beside:
        """Return it for the means of a cell."""
        return cls(game, means["score"].mean, means["reward"].mean, means["steps"].mean, ends)


def early_ends(reasons: Iterable[str]) -> dict[str, int]:
    """Return how many episodes ended before their game did, by the reason."""
    return dict(Counter(reason for reason in reasons if reason not in GAME_ENDS).most_common())


def ends_of(rows: Iterable[Row]) -> dict[str, int]:
    """Return the early ends of rows."""
    return early_ends(row["end_reason"] for row in rows)


def shows_steps(cells: Iterable[Beside]) -> bool:
    """Return whether steps have to stand beside the scores of these cells."""
    games = grouped(cells, lambda cell: cell.game)
    return any(
        any(cell.ends for cell in members) or (grows(game) and len({cell.steps for cell in members}) > 1)
        for game, members in games.items()
    )


def shows_points(cells: Iterable[Beside]) -> bool:
    """Return whether the points of a cell differ from its score."""
    return any(not math.isclose(cell.score, cell.points, abs_tol=1e-9) for cell in cells)


def column_notes(cells: Sequence[Beside], *, points: bool = True) -> list[str]:
    """Return the notes of the columns that these cells need; `points` says whether the table has points."""
    return [*([STEPS] if shows_steps(cells) else []), *([POINTS] if points and shows_points(cells) else [])]


def early_notes(cells: Iterable[Beside]) -> list[str]:
    """Return what the mark of early ends means in a table of these cells, if one has it."""
    ends = sum((Counter(cell.ends) for cell in cells), Counter[str]())
    told = ", ".join(f"{reason} {count}" for reason, count in ends.most_common())
    return [f"{EARLY}: episodes that ended before their game did ({told}); {LEAST}"] if told else []


def grows(game: str) -> bool:
    """Return whether the score of a game only grows, so that it counts steps as well."""
    spec = GAMES.get(game)
    return spec is not None and spec.worst_step is not None and spec.worst_step >= 0
