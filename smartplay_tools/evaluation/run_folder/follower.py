"""How far a run is, as terminal, log and site show it.

A `RunFollower` counts it from the run's folder, while the run is played or later: rows of finished episodes, records of
attempts without a result, and records that are growing. What it has counted is a `RunSnapshot`.

A run costs more than its results: attempts that failed, were interrupted or wait for a higher cap were charged as well.
A call whose process died before the reply may have been charged or not. Such calls are counted separately, with the
reserved amount as an upper limit.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.files.growing_lines import GrowingLines
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.damage import DamageError, damage_named
from smartplay_tools.records.record import Outcome, Record
from smartplay_tools.records.rows import Row, Timing, mean_score, read_row
from smartplay_tools.records.spent import Spent
from smartplay_tools.types import MISTAKES
from smartplay_tools.types.quantities import duration, short

STALE_SECONDS = 600.0
"""A run of which no record has grown for so long counts as killed, and not as being played.

A record grows with every event, and between two events the longest wait is for a model's reply. After ten minutes of
silence, the clients of OpenAI and Anthropic give a request up; a model that thinks may take nearly as long.
"""


class CellSnapshot(NamedTuple):
    """The progress of one planned cell."""

    game: str
    player: str
    given: str
    """What the player is given, in a few words; "" if that is as by default."""
    planned: int
    finished: int
    score: float
    """The sum over the finished episodes."""


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
class RunSnapshot:
    """How far a run is, or the shard of one that the folder contains."""

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
    stalled: int
    """Finished episodes that ended because too many turns in a row showed nothing new (`Budget.stalled_turns`)."""
    began_again: int
    """Attempts that did not continue an earlier one, because its record does not replay or its agent has a memory."""
    caps: Mapping[str, Any]
    """The caps of the run: tokens and cost, each None or missing if there is none."""
    paused: int
    """Episodes without a result whose latest attempt a cap of the run paused."""
    cells: tuple[CellSnapshot, ...]
    spending: Spending
    playing: tuple[Record, ...] = field(repr=False)
    """The records that are growing, those without an event for the longest time first."""

    @property
    def is_live(self) -> bool:
        """Whether the run is being played now, as records that grow say."""
        return any(record.silent_seconds < STALE_SECONDS for record in self.playing)

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
        troubles = {"failed": self.failed, "stalled": self.stalled, "began again": self.began_again}
        return ", ".join([*words, *(f"{count} {name}" for name, count in troubles.items() if count)])


class Result(NamedTuple):
    """The figures of a finished episode, kept from its row."""

    score: float
    normalized_score: float | None
    steps: int
    spent: Spent
    mistakes: int
    cut_results: int
    end_reason: str
    mean_score: float
    """The score that means use."""

    @classmethod
    def of(cls, row: Row) -> Result:
        """Return the figures of a row."""
        tokens, replies = row["tokens"], row["turns"] + row.get("summaries", 0)
        spent = Spent(replies, int(tokens["prompt"]), int(tokens["reply"]), row["cost"])
        return cls(
            score=float(row["score"]),
            normalized_score=row["normalized_score"],
            steps=int(row["steps"]),
            spent=spent,
            mistakes=sum(row[name] for name in MISTAKES),
            cut_results=row["cut_results"],
            end_reason=row["end_reason"],
            mean_score=mean_score(row),
        )


class _ReadAttempt(NamedTuple):
    """What is kept of the record of an attempt that is over."""

    key: str
    outcome: Outcome
    spent: Spent


class _Plan(NamedTuple):
    """What is kept of the manifest."""

    cells: Sequence[CellConfig]
    cell_of: Mapping[str, int]
    """The place of the cell of each planned episode, by key."""
    prices: Mapping[str, Price]
    caps: Mapping[str, Any]


class RunFollower:
    """Makes snapshots of a run, and reads only what was added to its folder since the one before.

    `clock` returns seconds.
    """

    def __init__(self, folder: RunFolder, clock: Callable[[], float] = time.monotonic) -> None:
        self.folder = folder
        self.results: dict[str, Result] = {}
        """The finished episodes by key, as of the latest snapshot."""
        self.damage = ""
        """What is wrong with the folder, if anything was left out of the latest snapshot."""
        self._damage_of: dict[Path, str] = {}
        self._rows = GrowingLines(folder.path / "results.jsonl")
        self.seconds: dict[tuple[str, int], float] = {}
        """How long the attempts that are over took, by key and number."""
        self._timings, self._began_again = GrowingLines(folder.path / "timings.jsonl"), 0
        self._manifest: tuple[Any, _Plan] | None = None
        self._attempts: dict[Path, _ReadAttempt] = {}
        self._continued: dict[str, Spent] = {}
        self._playing: dict[Path, Record] = {}
        self._clock = clock
        self._first: tuple[float, int] | None = None
        """The time of the first snapshot, and the replies until then."""
        self._lock = threading.Lock()

    def snapshot(self) -> RunSnapshot:
        """Return how far the run is now, counted from its records."""
        with self._lock:
            plan = self._plan()
            self._read_rows()
            self._read_records(plan.prices)
            return self._count(plan)

    def _plan(self) -> _Plan:
        """The manifest; read again if it has changed."""
        path = self.folder.path / "manifest.json"
        stamp = (path.stat().st_mtime_ns, path.stat().st_size) if path.exists() else None
        if self._manifest is None or stamp is None or self._manifest[0] != stamp:
            manifest = self.folder.manifest()
            cell_of = {episode.key: episode.cell for episode in manifest.planned}
            self._manifest = (stamp, _Plan(manifest.cells, cell_of, manifest.prices, manifest.caps))
        return self._manifest[1]

    def _read_rows(self) -> None:
        rows, have_gone = self._added_to(self._rows, read_row)
        if have_gone:
            self.results = {}
        self.results |= {row["key"]: Result.of(row) for row in rows}
        timings, have_gone = self._added_to(self._timings, partial(read_row, kind=Timing))
        if have_gone:
            self.seconds, self._began_again = {}, 0
        self.seconds |= {(row["key"], row["attempt"]): row["seconds"] for row in timings}
        self._began_again += sum("began_again" in row for row in timings)
        self.damage = next(iter(self._damage_of.values()), "")

    def _added_to(self, file: GrowingLines, read: Callable[[bytes], Row]) -> tuple[list[Row], bool]:
        """The rows that were added to a file, and whether those before have gone.

        They have if it was rewritten, as at the end of a run, or deleted.
        """
        lines, is_replaced = file.read()
        have_gone = is_replaced or not file.path.exists()
        if have_gone:
            self._damage_of.pop(file.path, None)
        rows: list[Row] = []
        for line in lines:
            try:
                rows.append(read(line))
            except DamageError as error:
                self._damage_of[file.path] = f"A line of {file.path} is damaged: {error}."
        return rows, have_gone

    def _read_records(self, prices: Mapping[str, Price]) -> None:
        earlier, paths = self._attempts, self.folder.attempts()
        self._attempts = {path: earlier.get(path) or _attempt(path, prices) for path in paths}
        followed, self._playing = self._playing, {}
        for path in self.folder.running():
            record = followed.get(path)
            try:
                with damage_named(path):
                    self._playing[path] = Record.follow(path, prices) if record is None else record.refresh()
            except SmartPlayError as error:
                self.damage = str(error)
        # A finished episode that was attempted before may repeat an earlier attempt, which was charged there.
        for key in {path.stem.partition(".")[0] for path in paths} & self.results.keys() - self._continued.keys():
            with suppress(SmartPlayError), damage_named(key):  # its row counts
                record = Record.follow(self.folder.transcript(key), prices)
                self._continued[key] = record.own_totals - record.totals

    def _count(self, plan: _Plan) -> RunSnapshot:
        playing = sorted(self._playing.values(), key=lambda record: record.last_change)
        to_come = plan.cell_of.keys() - self.results.keys()
        running = to_come & {record.key for record in playing}
        attempts = self._attempts.values()
        latest = {attempt.key: attempt.outcome for attempt in attempts}
        spending = self._spending(playing)
        calls = spending.results.replies + sum(record.totals.replies for record in playing)
        return RunSnapshot(
            finished=len(plan.cell_of) - len(to_come),
            planned=len(plan.cell_of),
            running=len(running),
            failed=sum(attempt.outcome == "failed" and attempt.key in plan.cell_of for attempt in attempts),
            calls=calls,
            steps=sum(result.steps for result in self.results.values()) + sum(record.steps for record in playing),
            tokens=spending.total.tokens,
            cost=spending.total.cost,
            seconds_left=self._seconds_left(plan, playing, spending.total.replies),
            stalled=sum(result.end_reason == "stalled_turns" for result in self.results.values()),
            began_again=self._began_again,
            caps=plan.caps,
            paused=sum(latest.get(key) == "paused" for key in to_come - running),
            cells=self._cells(plan),
            spending=spending,
            playing=tuple(playing),
        )

    def _cells(self, plan: _Plan) -> tuple[CellSnapshot, ...]:
        planned, scores = Counter(plan.cell_of.values()), defaultdict[int, list[float]](list)
        for key in self.results.keys() & plan.cell_of.keys():
            scores[plan.cell_of[key]].append(self.results[key].mean_score)
        return tuple(
            CellSnapshot(
                cell.game, cell.player or "", cell.describe(), planned[place], len(scores[place]), sum(scores[place])
            )
            for place, cell in enumerate(plan.cells)
            if planned[place]
        )

    def _spending(self, playing: Iterable[Record]) -> Spending:
        results = sum((result.spent for result in self.results.values()), Spent())
        others = sum((attempt.spent for attempt in self._attempts.values()), Spent())
        others = sum((self._continued[key] for key in self._continued.keys() & self.results.keys()), others)
        return Spending(results, sum((record.own_totals for record in playing), results + others))

    def _seconds_left(self, plan: _Plan, playing: Sequence[Record], replies: int) -> float | None:
        """The time that the calls to come take at the rate since the first snapshot; None while that is not known.

        Near the end, when a few long episodes are played alone, a run takes longer than its rate says.
        """
        now, calls = self._clock(), self._expected_calls(plan, playing)
        began, before = self._first = self._first or (now, replies)
        return None if calls is None or replies <= before else calls * (now - began) / (replies - before)

    def _expected_calls(self, plan: _Plan, playing: Sequence[Record]) -> float | None:
        """The calls to come, if episodes last as long as the finished ones of their cell, or of any; None without."""
        lengths: dict[int, list[int]] = defaultdict(list)
        for key in self.results.keys() & plan.cell_of.keys():
            lengths[plan.cell_of[key]].append(self.results[key].spent.replies)
        if not lengths:
            return None
        every = fmean(length for own in lengths.values() for length in own)
        played = {record.key: record.totals.replies for record in playing}
        to_come = ((key, cell) for key, cell in plan.cell_of.items() if key not in self.results)
        means = {cell: fmean(own) for cell, own in lengths.items()}
        return sum(max(0.0, means.get(cell, every) - played.get(key, 0)) for key, cell in to_come)


def run_snapshot(folder: RunFolder) -> RunSnapshot:
    """Return how far the run in a folder is, in one look, which knows no time left."""
    return RunFollower(folder).snapshot()


def _attempt(path: Path, prices: Mapping[str, Price]) -> _ReadAttempt:
    key = path.name.partition(".")[0]
    try:
        with damage_named(path):
            record = Record.follow(path, prices)
            return _ReadAttempt(key, record.outcome, record.own_totals + record.open_call)
    except SmartPlayError:
        return _ReadAttempt(key, "failed", Record.readable_totals(path, prices))
