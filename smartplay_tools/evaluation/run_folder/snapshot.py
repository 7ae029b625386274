"""RunSnapshot: how far a run is, as terminal, log, notebook, status file and site show it.

A run costs more than its results: attempts that failed, were interrupted or wait for a higher cap were charged as well.
A call whose process died before the reply may have been charged or not. Such calls are counted separately, with the
reserved amount as an upper limit.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from smartplay_tools.evaluation.quantities import duration, short
from smartplay_tools.evaluation.run_folder.folder import STATUS, RunFolder
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.records.spent import Spent

STALE_SECONDS = 15.0
"""A status file that is older was left by a run that was killed: a run writes one every second."""


@dataclass(frozen=True)
class RunFigures:
    """The figures of a run as `status.json` holds them."""

    __pydantic_config__ = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    finished: int
    planned: int
    running: int
    """Episodes that are being played, or were when the run was killed."""
    failed: int
    """Attempts that failed, including those at episodes that were finished later."""
    calls: int
    """Replies of the player in the finished and the running episodes."""
    steps: int
    tokens: int
    """Budget tokens of all attempts, as the caps of a run count them."""
    cost: float | None
    seconds_left: float | None
    """None if the pace is not known: before the first reply, or if the run is not being played."""
    latest_error: str
    """The latest failure since the run began or was first looked at, "" if there was none."""
    stalled: int
    """Finished episodes that ended because turn after turn brought nothing (`Budget.stalled_turns`)."""

    def figures(self) -> RunFigures:
        """Return the figures alone."""
        return RunFigures(**{kept.name: getattr(self, kept.name) for kept in fields(RunFigures)})


@dataclass(frozen=True)
class CellSnapshot:
    """The progress of one planned cell, or of several together."""

    game: str
    player: str
    asked: str
    """A short description of its rules and its budget as given; empty for the default ones."""
    planned: int
    finished: int
    running: int
    paused: int
    """Episodes without a result whose latest attempt a cap of the run paused."""
    failed_attempts: int
    score: float
    """The sum over the finished episodes."""

    @property
    def name(self) -> str:
        """The cell in messages: game, player, and what it is given."""
        return ", ".join(filter(None, (self.game, self.player, self.asked)))

    def __add__(self, other: CellSnapshot) -> CellSnapshot:
        counts = ("planned", "finished", "running", "paused", "failed_attempts", "score")
        return replace(self, **{name: getattr(self, name) + getattr(other, name) for name in counts})


@dataclass(frozen=True)
class Spending:
    """The use of a run: for its results, and in total."""

    results: Spent
    total: Spent

    @property
    def other_attempts(self) -> Spent:
        """The use of attempts without a result that no later attempt has continued."""
        return self.total - self.results

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {name: asdict(getattr(self, name)) for name in ("total", "results", "other_attempts")}


@dataclass(frozen=True)
class RunSnapshot(RunFigures):
    """How far a run is, or the shard of one that the folder contains."""

    caps: Mapping[str, Any]
    """The caps of the run: tokens and cost, each None or missing if there is none."""
    cells: tuple[CellSnapshot, ...]
    spending: Spending
    failed_attempts: tuple[Row, ...] = field(repr=False)
    """A row for every attempt that failed, as `RunFolder.failures` returns them."""
    playing: tuple[Record, ...] = field(repr=False)
    """The records that are growing, those without an event for the longest time first."""
    is_live: bool
    """Whether the run is being played now, according to its status file."""

    @property
    def paused(self) -> int:
        """Episodes that a cap of the run has paused."""
        return sum(cell.paused for cell in self.cells)

    @property
    def games(self) -> list[CellSnapshot]:
        """The cells of each game together."""
        games: dict[str, CellSnapshot] = {}
        for cell in self.cells:
            games[cell.game] = games[cell.game] + cell if cell.game in games else cell
        return list(games.values())

    def describe(self) -> str:
        """Return the figures in words."""
        tokens, cost = self.caps.get("tokens"), self.caps.get("cost")
        words = [f"{self.finished}/{self.planned} episodes", f"{self.running} running", f"{short(self.calls)} calls"]
        words.append(f"{short(self.steps)} steps")
        words.append(f"{short(self.tokens)}{'' if tokens is None else f'/{short(tokens)}'} tokens")
        if self.cost is None:
            words.append("cost unknown")
        elif self.cost or cost is not None:
            words.append(f"${self.cost:.2f}{'' if cost is None else f'/{cost:.2f}'}")
        if self.seconds_left is not None and self.finished < self.planned:
            words.append(f"{duration(self.seconds_left)} left")
        troubles = {"failed": self.failed, "stalled": self.stalled}
        return ", ".join([*words, *(f"{count} {name}" for name, count in troubles.items() if count)])

    @property
    def warning(self) -> str:
        """A sentence as soon as an episode has stalled, "" until then."""
        if not self.stalled:
            return ""
        episodes = "an episode has" if self.stalled == 1 else f"{self.stalled} episodes have"
        return f"{episodes} stalled: turn after turn played no step and showed the player nothing new"


def read_status(folder: RunFolder) -> RunFigures | None:
    """Return the figures of a run's status file; None if the run is not being played.

    A file that is not a status file counts as none, because everything in it can be counted from the records, too.
    """
    path = folder.path / STATUS
    try:
        if time.time() - path.stat().st_mtime > STALE_SECONDS:
            return None
        return TypeAdapter(RunFigures).validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return None
