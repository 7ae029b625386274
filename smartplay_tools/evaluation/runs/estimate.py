"""The estimate of a run's calls, tokens, cost and time from its first episodes, and what caps expect of those to come.

What an episode takes depends on how well it is played, so nothing is estimated before one has been played. A range is
from what all episodes of a cell would take if they were as the smallest of those that were played to the same for the
largest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.evaluation.runs.plan import Plan, PlannedEpisode
from smartplay_tools.records.rows import Row
from smartplay_tools.records.spent import Spent


@dataclass(frozen=True)
class Range:
    """The range in which a value is expected."""

    low: float
    expected: float
    high: float

    def __add__(self, other: Range) -> Range:
        return Range(self.low + other.low, self.expected + other.expected, self.high + other.high)


@dataclass(frozen=True)
class Estimate:
    """The expected use of a cell's episodes."""

    cell: CellConfig
    episodes: int
    calls: Range
    """Calls to the player."""
    tokens: Range
    """Of prompts and replies."""
    cost: Range | None
    """US dollars; None if the price of the player's model is not known."""
    call_seconds: Range
    """Seconds that the player's replies take, one after another."""


def estimate_from(cell: CellConfig, episodes: int, played: Sequence[Row], seconds: Mapping[str, float]) -> Estimate:
    """Return the estimate for a cell's episodes from the rows of some of them, and the `seconds` of each by key."""

    def all_episodes(figure: Callable[[Row], float]) -> Range:
        figures = list(map(figure, played))
        return Range(episodes * min(figures), episodes * fmean(figures), episodes * max(figures))

    return Estimate(
        cell,
        episodes,
        calls=all_episodes(lambda row: row["turns"] + row.get("summaries", 0)),
        tokens=all_episodes(lambda row: row["tokens"]["prompt"] + row["tokens"]["reply"]),
        cost=None if any(row["cost"] is None for row in played) else all_episodes(lambda row: row["cost"]),
        call_seconds=all_episodes(lambda row: seconds.get(row["key"], 0.0)),
    )


class Expectations:
    """The expected use of episodes, so that an episode of a run begins only if it fits under the caps.

    It is the mean of the cell's finished episodes. Until there is one, nothing is known.
    """

    def __init__(self, plan: Plan, rows: Iterable[Row]) -> None:
        self._places = {episode.key: episode.place for episode in plan.episodes}
        self._finished: dict[int, list[tuple[float, float]]] = {}
        self._begun: dict[str, tuple[float, float]] = {}
        for row in rows:
            self.finished(row)

    def knows(self, episode: PlannedEpisode) -> bool:
        """Return whether an episode of its cell is finished."""
        return episode.place in self._finished

    def of(self, episode: PlannedEpisode) -> tuple[float, float]:
        """Return the budget tokens and US dollars that the rest of an episode is expected to take; 0 if unknown."""
        finished = self._finished.get(episode.place, [(0.0, 0.0)])
        begun = self._begun.get(episode.key, (0.0, 0.0))
        tokens, cost = fmean(tokens for tokens, _ in finished), fmean(cost for _, cost in finished)
        return max(0.0, tokens - begun[0]), max(0.0, cost - begun[1])

    def finished(self, row: Row) -> None:
        """Take account of a finished episode."""
        tokens = row["tokens"]["prompt"] + row["tokens"]["reply"]
        self._finished.setdefault(self._places[row["key"]], []).append((tokens, row["cost"] or 0.0))

    def attempted(self, episode: PlannedEpisode, spent: Spent) -> None:
        """Take account of the part of an episode that an attempt has played and the next one continues."""
        tokens, cost = self._begun.get(episode.key, (0.0, 0.0))
        self._begun[episode.key] = tokens + spent.tokens, cost + (spent.cost or 0.0)
