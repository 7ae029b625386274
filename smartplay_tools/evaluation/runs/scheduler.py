"""The scheduler, which decides which episode is played next, and handles the end of every attempt.

Only the scheduler writes into the run's folder while the run is played. An outcome says only that an attempt is over;
its record is then moved to its final place, and its row is added.

An episode may have to wait for four reasons. Its chain: a trial that takes something over (`Rules.carry`) begins when
the trial before it has a result. Caps of the run: it begins only if its expected use fits under the caps
together with the running episodes. Its player: at most `concurrency` episodes of it run at a time. A model, or
a function that is an agent, that has not played an action yet in this run: one episode begins, and the others wait for
its first step, so that a wrong key, a mistake in the function, or a server that does not pass tool calls on, costs one
episode instead of a hundred.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from smartplay_tools.errors import SmartPlayError, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import Manifest, reason_of
from smartplay_tools.evaluation.run_folder.follower import run_snapshot
from smartplay_tools.evaluation.runs.attempt import Task
from smartplay_tools.evaluation.runs.estimate import Expectations
from smartplay_tools.evaluation.runs.executors import EndedAttempt, Executor
from smartplay_tools.evaluation.runs.plan import PlannedEpisode, game_file, player_key, player_of, strategy_file
from smartplay_tools.evaluation.runs.roster import Roster
from smartplay_tools.evaluation.runs.run_options import RunOptions, RunProgress
from smartplay_tools.evaluation.runs.run_progress import StopFlag
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.players.attempts import ModelCallError, ModelPromptError, ModelRefusedError
from smartplay_tools.players.player_registry import second_name
from smartplay_tools.providers.prices import check_known
from smartplay_tools.records.damage import damage_named
from smartplay_tools.records.record import Record
from smartplay_tools.records.resumption import left_by
from smartplay_tools.records.rows import Row, row_of
from smartplay_tools.records.spent import Spent
from smartplay_tools.visible import logger

log = logger("smartplay_tools.evaluation")

RETRIES = 3
"""How often a failed episode is retried in one run."""

SAME_FAILURES = 3
"""A player that fails so often in one place, with no finished episode in between, plays no more in this run.

Attempts that fail side by side count once, since they may have one cause that passes. After a failure the player's next
attempts begin one at a time, until one finishes its episode. A player that a server refuses so often without a reply in
between ends the run.
"""

FRAME = re.compile(r'^  File "(.+)", line (\d+)', re.MULTILINE)
"""A place in a traceback."""


class Scheduler:
    """The episodes of a plan (or a shard of one) that are still to be played, for a folder whose lock is held."""

    def __init__(
        self,
        folder: RunWriter,
        roster: Roster,
        manifest: Manifest,
        how: RunOptions,
        repriced: Collection[str],
        stop: StopFlag,
    ) -> None:
        """`repriced` are the names of players whose price has changed since the run was played before."""
        self._folder, self._roster, self._prices, self._caps = folder, roster, manifest.prices, how.caps
        self._predecessors, self._stop = manifest.predecessors, stop
        self._plan = plan = roster.part
        self._on_progress = how.on_progress or (lambda progress: None)
        self._failed = 0
        self._who = [player_key(cell) for cell in plan.cells]
        self._queue: deque[PlannedEpisode] = deque()
        self._running: dict[str, Task] = {}
        self._awaited: dict[Path, Record] = {}
        self._answered: Counter[str] = Counter()
        self._acted: set[str] = set()
        self._silent: set[str] = set()
        self._failures: Counter[tuple[str, str]] = Counter()
        self._failures_before: dict[str, Counter[tuple[str, str]]] = {}
        self._unpriced: set[str] = set()
        self._reasons: set[tuple[str, str, str]] = set()
        self._capped = False
        self.cap_reached = False
        """Whether a cap of the run has prevented episodes from beginning or ending."""
        self.refused: str | None = None
        """Why the run was ended early, if a model's server refuses every request."""
        folder.mend()
        # The cost of a finished episode changes if its player has a new price.
        kept = {row["key"]: row for row in folder.rows() if row["player"] not in repriced}
        # A record has no row if the run ended before the row was written.
        self._rows = {
            episode.key: kept.get(episode.key) or self._row(episode)
            for episode in plan.episodes
            if folder.transcript(episode.key).exists()
        }
        folder.write_rows(self._rows.values())
        self._spent = self._spent_before() if self._caps else Spent()
        self._expected = Expectations(plan, self._rows.values(), self._prices)
        self._on_progress(RunProgress(len(self._rows), len(plan.episodes), 0))

    def _spent_before(self) -> Spent:
        for path in self._folder.attempts():
            try:
                with damage_named(path):
                    _ = Record.follow(path, self._prices).own_totals
            except SmartPlayError as error:
                log.warning("What an attempt has used counts as far as it can be read. %s", error)
        return run_snapshot(self._folder).spending.total

    @property
    def spent(self) -> tuple[int, float]:
        """Budget tokens and US dollars of all finished attempts, including calls whose charge is unknown."""
        return self._spent.tokens + self._spent.unknown_tokens, (self._spent.cost or 0.0) + self._spent.unknown_cost

    def play(self, executor: Executor, episodes: Sequence[PlannedEpisode]) -> None:
        """Play those of the episodes that are not finished; failed ones are retried up to `RETRIES` times each.

        When an episode has reached a cap of the run, no further one begins. If a provider has counted tokens
        without a known price under a cap on cost, an `InvalidArgumentError` is raised.
        """
        self._capped = False
        attempts: Counter[str] = Counter()
        while True:
            left = [episode for episode in episodes if episode.key not in self._rows]
            left = [episode for episode in left if attempts[episode.key] <= RETRIES]
            self._queue = deque(self._tryouts_first(left))
            if not self._queue or self._is_over():
                break
            before = attempts.total()
            for outcome in executor.run(self.take, self.again):
                attempts[outcome.task.planned.key] += 1
                self._settle(outcome)
            if attempts.total() == before:  # the remaining ones wait for an episode that has no result
                break
        self.cap_reached = self.cap_reached or self._capped
        if self._unpriced:
            self.finish()
            check_known(self._unpriced)

    def take(self) -> Task | None:
        """Return the next task, or None if none can begin now (`executors.Take`)."""
        if self._is_over():
            return None
        busy = Counter(self._who[task.planned.place] for task in self._running.values())
        for place, episode in enumerate(self._queue):
            player = self._who[episode.place]
            if player in self._silent or self._waits(episode):
                continue
            room = self._roster.players[player].concurrency
            if room is not None and busy[player] >= room:
                continue
            if busy[player] and (self._is_failing(player) or not self._has_acted(player)):
                continue
            if not self._fits(episode):
                self._capped = not self._running
                return None
            del self._queue[place]
            return self._begin(episode)
        return None

    @property
    def waiting(self) -> int:
        """How many episodes wait for the trial before them in their chain, which has no result."""
        return sum(e.key not in self._rows and self._waits(e) for e in self._plan.episodes)

    def _waits(self, episode: PlannedEpisode) -> bool:
        before = self._predecessors.get(episode.key)
        return before is not None and before not in self._rows

    def again(self, task: Task) -> Task:
        """Keep the record of a lost worker, and return the task that continues it (`executors.Again`)."""
        self._archive(task)
        return self._begin(task.planned)

    def finish(self) -> list[Row]:
        """Sort the rows as planned and return them."""
        rows = [self._rows[episode.key] for episode in self._plan.episodes if episode.key in self._rows]
        self._folder.write_rows(rows)
        return rows

    def _is_over(self) -> bool:
        return self._capped or bool(self._unpriced) or self._stop.is_set()

    def _tryouts_first(self, episodes: Sequence[PlannedEpisode]) -> list[PlannedEpisode]:
        """Move one episode of every player that is tried first, and has not played an action yet, to the front."""
        first: dict[str, PlannedEpisode] = {}
        for episode in episodes:
            player = self._who[episode.place]
            if player in self._roster.tried and player not in self._acted:
                first.setdefault(player, episode)
        keys = {episode.key for episode in first.values()}
        return [*first.values(), *(episode for episode in episodes if episode.key not in keys)]

    def _has_acted(self, player: str) -> bool:
        """Whether a player has played an action in this run, according to the records that are being written."""
        if player not in self._roster.tried or player in self._acted:
            return True
        if any(record.steps for record in self._records_of(player)):
            self._acted.add(player)
        return player in self._acted

    def _records_of(self, player: str) -> Iterator[Record]:
        """The records of a player that are being written, as far as they are."""
        for path in (task.record for task in self._running.values() if self._who[task.planned.place] == player):
            followed = self._awaited.get(path)
            self._awaited[path] = Record.follow(path) if followed is None else followed.refresh()
            yield self._awaited[path]

    def _is_failing(self, player: str) -> bool:
        """Whether a player has failed in this run and finished no episode since."""
        return any(player == failed for failed, _ in self._failures)

    def _fits(self, episode: PlannedEpisode) -> bool:
        """Whether the expected use of an episode fits under the caps together with the running episodes."""
        caps = self._caps
        if not caps:
            return True
        planned = [*(task.planned for task in self._running.values()), episode]
        tokens: float
        tokens, cost = self.spent
        for waiting in planned:
            expected = self._expected.of(waiting)
            tokens, cost = tokens + expected[0], cost + expected[1]
        return (caps.tokens is None or tokens <= caps.tokens) and (caps.cost is None or cost <= caps.cost)

    def _begin(self, episode: PlannedEpisode) -> Task:
        cell = episode.cell
        config = self._roster.players[self._who[episode.place]]
        record, previous = self._folder.new_record(episode.key), self._folder.latest_attempt(episode.key)
        before = self._predecessors.get(episode.key)
        carried = None if before is None else left_by(self._folder.transcript(before))
        task = Task(
            episode,
            config,
            record,
            previous,
            price=self._prices.get(player_of(cell)),
            question_price=self._prices.get(second_name(cell.player_options) or player_of(cell)),
            carried=carried,
            game_file=game_file(cell),
            strategy_file=strategy_file(cell),
        )
        self._running[episode.key] = task
        self._failures_before[episode.key] = self._failures.copy()
        return task

    def _archive(self, task: Task) -> Record:
        """Read the record of an attempt that is over, move it to its final place, and count what it has spent."""
        self._running.pop(task.planned.key, None)
        self._awaited.pop(task.record, None)
        try:
            with damage_named(task.record):
                record = Record.follow(task.record, self._prices)
                spent = record.own_totals + record.open_call
                if record.exists:
                    self._folder.archive_record(record, keep=bool(spent.replies or spent.unknown_calls))
        except SmartPlayError as error:
            self._spent += Record.readable_totals(task.record, self._prices)
            self._folder.set_aside(task.record)
            why = {"event": "exception", "error": f"{type(error).__name__}: {error}", "traceback": None}
            return Record([why], path=task.record)
        if record.exists:
            self._answered[self._who[task.planned.place]] += spent.replies
            if record.steps:
                self._acted.add(self._who[task.planned.place])
            self._spent += spent
            if task.player.agent is None or task.player.agent.goes_on:  # otherwise the next attempt starts over
                self._expected.attempted(task.planned, spent)
        return record

    def _settle(self, outcome: EndedAttempt) -> None:
        task, episode = outcome.task, outcome.task.planned
        record = self._archive(task)
        if outcome.times is not None:
            timing = {name: value for name, value in asdict(outcome.times).items() if value is not None}
            self._folder.append_timing({"key": episode.key, "attempt": record.attempt, **timing})
            self._tell(
                episode,
                "%s began again from its start: %s What its record says it had spent counts.",
                outcome.times.began_again,
            )
            self._tell(episode, "%s keeps its result; after its end came %s.", outcome.times.after_the_end)
        row, error = None, record.error or record.end_reason
        if not record.exists and record.ending is None:
            error = "There is no record of the attempt."
        if record.outcome == "finished":
            record.path = self._folder.transcript(episode.key)  # it was moved
            row = self._rows[episode.key] = row_of(record, episode.trial)
            if row["end_reason"] == "game_error":
                self._tell(episode, "%s ended early: %s", row["error"])
            self._folder.append_row(row)
            player = self._who[episode.place]
            self._failures = Counter({key: n for key, n in self._failures.items() if key[0] != player})
            self._expected.finished(row)
            if row["end_reason"] == "host" and task.player.agent is None:
                self._tell(episode, "%s ended early: %s", row["detail"] or "")
            if row["cost"] is None and self._caps.cost is not None:
                self._unpriced.add(row["player"])
        elif record.outcome == "paused":
            self._capped = True
        elif record.outcome == "failed" or (not record.exists and not self._stop.is_set()):
            self._failed += 1
            self._tell(episode, "%s failed: %s", error)
            self._judge(episode, error, record)
        why = None if row is not None else error
        self._on_progress(RunProgress(len(self._rows), len(self._plan.episodes), self._failed, episode, row, why))

    def _tell(self, episode: PlannedEpisode, sentence: str, why: str | None) -> None:
        """Log what is to be known of an attempt, once for each player and reason."""
        told = self._who[episode.place], sentence, reason_of(why or "")
        if why is not None and told not in self._reasons:
            self._reasons.add(told)
            log.warning(sentence, f"{player_of(episode.cell)} at {episode.cell.game} ({episode.key})", why)

    def _judge(self, episode: PlannedEpisode, error: str, record: Record) -> None:
        """End the run if a server refuses a player; give up a player that never answers, or always fails."""
        player = self._who[episode.place]
        kind, _, message = error.partition(": ")
        if kind == ModelRefusedError.__name__:
            # A server may also refuse one request of a player's, with the same status.
            replies = self._answered[player] + sum(record.own_totals.replies for record in self._records_of(player))
            if not replies or self._count_failure(episode, f"{kind} after {replies} replies") >= SAME_FAILURES:
                self.refused = f"{player_of(episode.cell)} is refused by its server. {message}"
                self._stop.set()
        elif kind in (ModelCallError.__name__, ModelPromptError.__name__) and not self._answered[player]:
            self._silent.add(player)
        elif player not in self._acted or record.end_reason != "game_error":  # others of its games may not break
            frames = FRAME.findall(record.traceback or "")
            count = self._count_failure(episode, f"{kind} {frames[-1:]}")
            if count >= SAME_FAILURES and player not in self._silent:
                self._silent.add(player)
                why = f"it failed {SAME_FAILURES} times in one place, and finished no episode in between"
                log.warning("%s plays no more: %s. %s", player_of(episode.cell), why, error)

    def _count_failure(self, episode: PlannedEpisode, place: str) -> int:
        """Return how often the player has failed in a place: failures that attempts made side by side count once."""
        where = self._who[episode.place], place
        if self._failures_before[episode.key][where] >= self._failures[where]:
            self._failures[where] += 1
        return self._failures[where]

    def _row(self, episode: PlannedEpisode) -> Row:
        try:
            return row_of(Record.follow(self._folder.transcript(episode.key), self._prices), episode.trial)
        except TranscriptError as error:
            raise TranscriptError(f"{error} Move the file away, and its episode is played again.") from error
