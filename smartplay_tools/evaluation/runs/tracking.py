"""Tracking: the figures of a run, sent to an experiment tracker while it is played.

A tracker shows; it decides nothing. Every finished episode is sent as it ends, those of an earlier part of the run
first, and at the end every cell's mean with its interval. If the tracker's client fails, its run is given up with a
warning and the episodes are played on: results are in the run's folder, whatever a tracker has of them.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Mapping
from typing import Any, Protocol

from smartplay_tools.errors import InvalidArgumentError, SmartPlayWarning
from smartplay_tools.evaluation.run_folder.folder import Manifest
from smartplay_tools.evaluation.runs.scheduler import OnProgress, RunProgress
from smartplay_tools.records.rows import Row
from smartplay_tools.registry import Registry
from smartplay_tools.types import Budget
from smartplay_tools.types.groups import grouped


class Tracker(Protocol):
    """A run in an experiment tracker; it is made with a name and with facts about the run."""

    def log(self, figures: Mapping[str, float], step: int) -> None:
        """Log the figures of an episode, the step-th one of its cell."""
        ...

    def close(self, figures: Mapping[str, float], *, complete: bool) -> None:
        """Log the figures of the whole run, and end it."""
        ...


TRACKERS = Registry(
    "tracker",
    {"mlflow": "smartplay_trackers:MLflowTracker", "wandb": "smartplay_trackers:WandbTracker"},
    "smartplay_tools.trackers",
)
"""The trackers by name: classes of a `Tracker`."""


class Tracking:
    """Sends a run to a tracker, if one is named. `on_progress` is called after the tracker with every attempt."""

    def __init__(self, name: str | None, run: str, manifest: Manifest, on_progress: OnProgress | None = None) -> None:
        """Begin the run in the tracker; a client that is missing or refuses is an `InvalidArgumentError`."""
        self._tracker: Tracker | None = None
        self._on_progress = on_progress
        self._rows: list[Row] = []
        self._played: Counter[str] = Counter()
        if name is None:
            return
        made = TRACKERS[name]
        try:
            self._tracker = made(run, _facts(manifest))
        except ImportError as missing:
            raise InvalidArgumentError(f"--track {name} needs its client: pip install {name} ({missing}).") from None
        except Exception as error:  # whatever a client does without its server
            raise InvalidArgumentError(f"The tracker {name} cannot begin a run: {error}") from error

    def heard(self, progress: RunProgress) -> None:
        """Send the finished episodes."""
        for row in (*progress.kept, *([] if progress.row is None else [progress.row])):
            self._rows.append(row)
            cell = _name(row)
            self._played[cell] += 1
            figures = {"score": row["score"], "tokens": row["tokens"]["prompt"] + row["tokens"]["reply"]}
            figures |= {} if row["cost"] is None else {"cost": row["cost"]}
            self._send("log", {f"{cell}/{key}": float(value) for key, value in figures.items()}, self._played[cell])
        if self._on_progress is not None:
            self._on_progress(progress)

    def close(self, *, complete: bool) -> None:
        """Send every cell's mean with its interval, and end the run in the tracker."""
        if self._tracker is not None:
            self._send("close", self._means(), complete=complete)

    def _means(self) -> dict[str, float]:
        # A run is played without statistics, unless they are asked for.
        from smartplay_tools.evaluation.analysis.summary import summarize

        means: dict[str, float] = {}
        for name, rows in grouped(self._rows, _name).items():
            for cell in summarize(rows).cells:
                ends = {"mean": cell.score.mean, "low": cell.score.low, "high": cell.score.high}
                means |= {f"{name}/score_{key}": end for key, end in ends.items() if end is not None}
        return means

    def _send(self, method: str, *figures: Any, **how: Any) -> None:
        if self._tracker is None:
            return
        try:
            getattr(self._tracker, method)(*figures, **how)
        except Exception as error:  # whatever a client does without its server
            self._tracker = None
            why = f"The tracker gets nothing more of this run, which continues: {error}"
            warnings.warn(why, SmartPlayWarning, stacklevel=2)


def _name(row: Row) -> str:
    """A cell's name of characters that trackers allow: its game, player and budget."""
    budget = Budget(**row["asked"]).describe().replace("<=", "max")
    name = "/".join(filter(None, (row["game"], row["player"].replace("/", "-"), budget)))
    return re.sub(r"[^\w\-. :/]", "", name)


def _facts(manifest: Manifest) -> dict[str, str]:
    games, players = (
        ", ".join(dict.fromkeys(filter(None, (getattr(cell, name) for cell in manifest.cells))))
        for name in ("game", "player")
    )
    facts = {"games": games, "players": players, "episodes": str(len(manifest.episodes)), "seed": str(manifest.seed)}
    return {**facts, **{f"version {name}": version for name, version in manifest.versions.items()}}
