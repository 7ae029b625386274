"""The runner: plays the planned episodes that are not finished yet, and keeps the run's folder up to date.

A run that is started again continues where it stopped. Finished episodes are kept; failed ones are retried, a few times
in a run; those that were running when the run was stopped, killed or paused by a cap continue from their records. A run
with more trials, games or players than before is the same run, extended.

A notebook shows a run as data frames, replays and tables. `pages.notebook` makes all of them and is imported at first
use, so playing a run loads neither pages nor statistics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from smartplay_tools.episode.stats import versions
from smartplay_tools.errors import EngineError, InvalidArgumentError, warned_if_not_closed
from smartplay_tools.evaluation.run_folder.folder import Manifest, RunFolder
from smartplay_tools.evaluation.run_folder.follower import RunSnapshot, Spending, run_snapshot
from smartplay_tools.evaluation.runs.executors import EXECUTORS, default_workers
from smartplay_tools.evaluation.runs.plan import Plan, make_cells, plan_episodes, plan_suite, priced_names
from smartplay_tools.evaluation.runs.players import Players, read_players
from smartplay_tools.evaluation.runs.roster import roster_of
from smartplay_tools.evaluation.runs.run_options import RunKeywords, RunOptions
from smartplay_tools.evaluation.runs.run_progress import Display, Signals, StopFlag, following, not_shown
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.evaluation.runs.scheduler import Scheduler, log
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.files.full_disk import DiskFullError, is_disk_full
from smartplay_tools.players import is_model
from smartplay_tools.providers.prices import Price, check_known
from smartplay_tools.records.rows import Row
from smartplay_tools.threads import apart_from_event_loop
from smartplay_tools.types import Budget

if TYPE_CHECKING:
    import pandas

    from smartplay_tools.evaluation.pages.notebook import ReplayWidget


@dataclass(frozen=True, repr=False)
class Run:
    """A run, as returned by `evaluate`."""

    folder: RunFolder
    planned: int
    rows: list[Row]
    """The rows of the planned episodes that are finished, in the plan's order."""
    stopped: str | None = None
    """The signal that stopped it; None if it was not stopped."""
    cap_reached: bool = False
    """Whether a cap of the run ended it; the same run with a higher cap continues."""
    refused: str | None = None
    """Why the run was ended early: a model's server refuses every request."""
    waiting: int = 0
    """Planned episodes that wait for the trial before them in their chain, which has no result."""

    @property
    def complete(self) -> bool:
        """Whether every planned episode is finished."""
        return len(self.rows) == self.planned

    @property
    def failures(self) -> list[Row]:
        """Every attempt without a result, as rows like those of `RunFolder.failures`."""
        return self.folder.failures()

    @property
    def status(self) -> RunSnapshot:
        """How far the run is, cell by cell, and what it has used."""
        return run_snapshot(self.folder)

    @property
    def spending(self) -> Spending:
        """Everything that the run has used, including attempts without a result."""
        return self.status.spending

    def transcript(self, key: str) -> Path:
        """Return the path of a finished episode's transcript, from its row's key."""
        return self.folder.transcript(key)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the finished episodes as a data frame, one per row; needs pandas."""
        from smartplay_tools.evaluation.pages.notebook import rows_to_pandas

        return rows_to_pandas(self.rows)

    def show(self, episode: int | str | Row = 0, *, height: int = 760) -> ReplayWidget:
        """Return the replay of an episode, which a notebook shows below the cell.

        `episode` is its index in `rows`, its key or its row; `height` is that of the frame in pixels.
        """
        from smartplay_tools.evaluation.pages.notebook import replay_widget

        return replay_widget(self.rows, self.transcript, episode, height)

    def __repr__(self) -> str:
        failed = self.failures
        latest = failed[-1]["error"] or failed[-1]["end_reason"] if failed else ""
        attempts = f", {len(failed)} failed attempts, the last: {' '.join(latest.split())[:200]}" if failed else ""
        return f"<{type(self).__name__}: {len(self.rows)} of {self.planned} episodes finished{attempts}>"

    def _repr_html_(self) -> str:
        from smartplay_tools.evaluation.pages.notebook import run_as_html

        return run_as_html(self.rows, self.failures, self.planned)


def evaluate(
    games: Sequence[str] = (),
    players: Players = ("rule",),
    *,
    out: str | Path,
    suite: str | None = None,
    budgets: Budget | Sequence[Budget] | None = None,
    trials: int | None = None,
    repeats: int = 1,
    seed: int = 0,
    **options: Unpack[RunKeywords],
) -> Run:
    """Play every game with every player under every budget, and keep the records in the folder `out`.

    Arguments:
        games: ids of settings.
        players: names that `get_player` knows, `PlayerConfig` objects with their own options, or names with
            functions that make the players, or with agents: functions of `session`, an `AgentSession`, or of `episode`.
        out: the run's folder. If it holds this run already, it is resumed; if it holds another one, that is an error.
        suite: "paper" for the seven settings of the paper's result tables, before those of `games`; "tools-v1" for
            the suite that fixes games, trials, budgets and rules (`evaluation.suites`).
        budgets: what may be seen and spent in an episode; the default budget if not given.
        trials: episodes of every cell; the paper's number for the game if not given.
        repeats: how often each of these worlds is played, with other random numbers of the player.
        seed: the seed of the run; the seed of a trial follows from it, the game and the trial.
        options: how the run is played, which are the fields of `RunOptions` (executor, workers, shard, run_tokens,
            run_cost, prices, on_progress), and the rest of a cell: engine, tokenizer, options,
            player_options, and the fields of `Rules`, such as manual="pinned".

    A mistake in the arguments raises `InvalidArgumentError` before the first episode. Errors in an episode are only
    recorded, in the folder and in `Run.failures`.
    """
    asked = [budgets] if isinstance(budgets, Budget) else list(budgets or [Budget()])
    if not players:
        raise InvalidArgumentError("Name at least one player.")
    configs = read_players(players)
    run_options, rules = RunOptions.split(options)
    if suite is not None and (fixed := get_suite(suite)).is_fixed:
        others = {"games": games, "budgets": budgets, "trials": trials, "repeats": repeats - 1, **rules}
        given = [name for name, value in others.items() if value]
        plan = plan_suite(fixed, configs, seed=seed, player_options=rules.get("player_options"), given=given)
    else:
        ids = suite_games(suite, games)
        plan = plan_episodes(make_cells(ids, configs, asked, **rules), trials=trials, seed=seed, repeats=repeats)
    return run_plan(plan, out, configs, run_options)


def run_plan(
    plan: Plan,
    out: str | Path,
    players: Players = (),
    options: RunOptions = RunOptions(),  # noqa: B008 (it is frozen)
    *,
    display: Display | None = None,
) -> Run:
    """Play a plan. `players` are those of `evaluate`; one that is not listed is made by its name.

    `display` shows the state of the run while it is played.
    """
    folder, caps = RunWriter(out), options.caps
    plan = plan.as_recorded(folder)
    roster = roster_of(plan, read_players(players), options)
    executors = {name: EXECUTORS[name] for name in roster.episodes}
    part = roster.part
    with (
        _what_is_kept(folder, part),
        folder.writing(),
        Signals(stop := StopFlag()) as signals,
        (display or not_shown)() as show,
    ):
        before = folder.manifest() if (folder.path / "manifest.json").exists() else None
        manifest = _manifest(folder, before, plan, options)
        folder.write_manifest(manifest)
        repriced = () if before is None or before.prices == manifest.prices else manifest.prices.keys()
        scheduler = Scheduler(folder, roster, manifest, options, repriced, stop)
        with following(folder, show):
            try:
                for name, episodes in roster.episodes.items():
                    chosen = executors[name](options.workers or default_workers(name), caps, scheduler.spent, stop)
                    try:
                        apart_from_event_loop(scheduler.play, chosen, episodes)
                        if scheduler.refused is None:
                            stop.clear()  # a person who has left ends their own executor's episodes alone
                            if signals.received is not None:
                                stop.set()
                    finally:
                        with warned_if_not_closed(f"The executor {name}"):
                            chosen.close()
            finally:
                rows = scheduler.finish()
    return Run(
        RunFolder(out),
        len(part.episodes),
        rows,
        signals.received,
        scheduler.cap_reached,
        scheduler.refused,
        scheduler.waiting,
    )


@contextmanager
def _what_is_kept(folder: RunFolder, plan: Plan) -> Iterator[None]:
    """If the machine gives up, for lack of space or as a cluster does, say what is kept and what to do."""
    try:
        yield
    except Exception as error:
        is_full = is_disk_full(error)
        if not is_full and not isinstance(error, EngineError):
            raise
        kept = len(folder.finished() & {episode.key for episode in plan.episodes})
        finished = f"The {kept} of {len(plan.episodes)} episodes that are finished are kept;"
        if is_full:
            raise DiskFullError(
                f"There is no space left for {folder.path}. {finished} make room, and the same command continues the "
                "run."
            ) from error
        raise EngineError(f"{error} {finished} the same command continues the run.") from error


def _manifest(folder: RunFolder, before: Manifest | None, plan: Plan, options: RunOptions) -> Manifest:
    """The manifest of the run. Its earlier prices are kept, unless the user gives others."""
    prices: dict[str, Price] = {}
    if before is not None:
        _check_same_run(folder, before, plan, options.shard)
        if before.until is not None:
            log.warning(
                "%s holds a run that was to end early, once its comparisons were decided (--until, of an earlier "
                "version); from now on it has all episodes that are asked for.",
                folder.path,
            )
        prices = dict(before.prices)
    manifest = plan.manifest(
        shard=options.shard,
        caps=asdict(options.caps),
        prices={**prices, **(options.prices or {})},
        versions=versions(),
        run_file=None if before is None else before.run_file,
    )
    if options.run_cost is not None:
        check_known({name for name in priced_names(plan.cells) if is_model(name)} - manifest.prices.keys())
    return manifest


def _check_same_run(folder: RunFolder, before: Manifest, plan: Plan, shard: tuple[int, int] | None) -> None:
    if (before.repeats or 1) != plan.repeats:
        raise InvalidArgumentError(f"{folder.path} plays each world {before.repeats or 1} times; name another folder.")
    gone = {episode.key for episode in before.episodes} - {episode.key for episode in plan.episodes}
    if gone:
        limits = [{cell.budget.stalled_turns for cell in cells} for cells in (before.cells, plan.cells)]
        asked = "everything that was asked for there"
        if None in limits[0] - limits[1]:
            asked += ", with stalled_turns=None (--stalled-turns none), which runs of earlier versions have"
        if before.run_file is not None:
            asked += " (it was begun by a run file, whose text is in manifest.json)"
        raise InvalidArgumentError(
            f"{folder.path} holds another run: {len(gone)} of its {len(before.episodes)} episodes are not in this "
            f"one. Name another folder, or ask for {asked}."
        )
    if shard != before.shard:
        held = "no shard" if before.shard is None else "shard {}/{}".format(*before.shard)
        raise InvalidArgumentError(f"{folder.path} holds {held} of this run; name a separate folder for each shard.")
