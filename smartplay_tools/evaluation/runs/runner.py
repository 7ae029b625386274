"""The runner: plays the planned episodes that are not finished yet, and keeps the run's folder up to date.

A run that is started again continues where it stopped. Finished episodes are kept; failed ones are retried, a few times
in a run; those that were running when the run was stopped, killed or paused by a cap continue from their records. A run
with more trials, games or players than before is the same run, extended.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from smartplay_tools.conversation.loop import check_player
from smartplay_tools.episode.stats import versions
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs.attempt import PlayerFactory, Task, make_player
from smartplay_tools.evaluation.runs.event_loop import apart_from_event_loop
from smartplay_tools.evaluation.runs.executors import Executor, default_workers, get_executor
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.notebooks import InNotebook, is_notebook
from smartplay_tools.evaluation.runs.plan import (
    Plan,
    PlannedEpisode,
    make_cells,
    plan_episodes,
    plan_suite,
    player_key,
    player_of,
)
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.progress import Display, following, not_shown
from smartplay_tools.evaluation.runs.run_writer import RunWriter
from smartplay_tools.evaluation.runs.scheduler import OnProgress, Scheduler, Setup
from smartplay_tools.evaluation.runs.sending import ELSEWHERE, is_known_only_here, why_only_here
from smartplay_tools.evaluation.runs.signals import stopping
from smartplay_tools.evaluation.suites import get_suite, suite_games
from smartplay_tools.players import ModelPlayer, is_model
from smartplay_tools.records.prices import Price, check_known, find_price
from smartplay_tools.records.rows import Row
from smartplay_tools.records.run_folder import RunFolder
from smartplay_tools.records.snapshot import RunSnapshot, Spending, run_snapshot
from smartplay_tools.types import AsyncPlayer, Budget, Player


@dataclass(frozen=True)
class Run(InNotebook):
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


def evaluate(
    games: Sequence[str] = (),
    players: Sequence[str | PlayerConfig] | Mapping[str, PlayerFactory] = ("rule",),
    *,
    out: str | Path,
    suite: str | None = None,
    budgets: Budget | Sequence[Budget] | None = None,
    trials: int | None = None,
    seed: int = 0,
    executor: str | None = None,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    run_tokens: int | None = None,
    run_cost: float | None = None,
    prices: Mapping[str, Price] | None = None,
    on_progress: OnProgress | None = None,
    **rules: Any,
) -> Run:
    """Play every game with every player under every budget, and keep the records in the folder `out`.

    Arguments:
        games: ids of settings.
        suite: "paper" for the seven settings of the paper's result tables, before those of `games`; "tools-v1" for
            the suite that fixes games, trials, budgets and rules (`evaluation.suites`).
        players: names that `get_player` knows, `PlayerConfig` objects with their own options, or names with
            functions that make the players.
        out: the run's folder. If it holds this run already, it is resumed; if it holds another one, that is an error.
        budgets: what may be seen and spent in an episode; the default budget if not given.
        trials: episodes of every cell; the paper's number for the game if not given.
        seed: the seed of the run; the seed of a trial follows from it, the game and the trial.
        executor: "inline", "processes", "async" or "ray"; if not given, the one that suits each player.
        workers: episodes at a time.
        shard: (i, n), to play the i-th of n parts only; `merge` puts them together.
        run_tokens: cap on the whole run in budget tokens.
        run_cost: cap on the whole run in US dollars.
        prices: the price of a player's tokens, if `genai-prices` does not have it.
        on_progress: called when the run has begun and after every attempt; without it, a notebook shows a progress bar.
        rules: the rest of a cell: engine, tokenizer, options, player_options, and the fields of `Rules`, such as
            manual="pinned".

    A mistake in the arguments raises `InvalidArgumentError` before the first episode. Errors in an episode are only
    recorded, in the folder and in `Run.failures`.
    """
    asked = [budgets] if isinstance(budgets, Budget) else list(budgets or [Budget()])
    if not players:
        raise InvalidArgumentError("Name at least one player.")
    if suite is not None and (fixed := get_suite(suite)).is_fixed:
        options = {"games": games, "budgets": budgets, "trials": trials, **rules}
        given = [name for name, value in options.items() if value]
        plan = plan_suite(fixed, list(players), seed=seed, player_options=rules.get("player_options"), given=given)
    else:
        ids = suite_games(suite, games)
        plan = plan_episodes(make_cells(ids, list(players), asked, **rules), trials=trials, seed=seed)
    configs = [player for player in players if isinstance(player, PlayerConfig)]
    caps = Caps(run_tokens, run_cost)
    factories = players if isinstance(players, Mapping) else {}
    return run_plan(
        plan,
        out,
        factories=factories,
        configs=configs,
        executor=executor,
        workers=workers,
        shard=shard,
        caps=caps,
        prices=prices or {},
        on_progress=on_progress,
    )


def run_plan(
    plan: Plan,
    out: str | Path,
    *,
    factories: Mapping[str, PlayerFactory] | None = None,
    configs: Sequence[PlayerConfig] = (),
    executor: str | None = None,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    caps: Caps | None = None,
    prices: Mapping[str, Price] | None = None,
    run_file: str | None = None,
    on_progress: OnProgress | None = None,
    display: Display | None = None,
) -> Run:
    """Play a plan; the arguments are those of `evaluate`.

    `run_file` is the text of the run file, if there is one. `display` shows the state of the run while it is played;
    without it and without `on_progress`, a notebook shows it below the cell.
    """
    if workers is not None and workers < 1:
        raise InvalidArgumentError(f"workers must be at least 1, not {workers}.")
    part = plan if shard is None else plan.shard(*shard)
    factories, folder, caps = factories or {}, RunWriter(out), caps or Caps()
    players = _players(plan, configs)
    given = {**_given_prices(players.values()), **(prices or {})}
    by_executor, remote = _by_executor(part, factories, players, executor)
    executors = {name: get_executor(name) for name in by_executor}
    with (
        folder.writing(),
        stopping() as signals,
        (display or _display(part, on_progress))() as show,
    ):
        before = folder.manifest() if (folder.path / "manifest.json").exists() else None
        manifest = _manifest(folder, before, plan, shard, caps, given)
        if run_file is not None:
            manifest["run_file"] = run_file
        folder.write_manifest(manifest)
        known = {player: Price.from_json(price) for player, price in manifest["prices"].items()}
        repriced = () if before is None or before["prices"] == manifest["prices"] else known.keys()
        setup = Setup(players, factories, known, caps, remote, repriced)
        scheduler = Scheduler(folder, part, setup, on_progress)
        with following(folder, show):
            try:
                for name, episodes in by_executor.items():
                    chosen: Executor = executors[name](workers or default_workers(name), caps, scheduler.spent)
                    with closing(chosen):
                        signals.tell(chosen.stop)
                        apart_from_event_loop(scheduler.play, chosen, episodes)
            finally:
                rows = scheduler.finish()
                folder.write_manifest({**manifest, "spending": run_snapshot(folder).spending.to_json()})
    return Run(RunFolder(out), len(part.episodes), rows, signals.received, scheduler.cap_reached, scheduler.refused)


def _display(plan: Plan, on_progress: OnProgress | None) -> Display:
    """Return what shows a run below the cell of a notebook, and nothing elsewhere."""
    if on_progress is not None or not plan.episodes or not is_notebook():
        return not_shown
    from smartplay_tools.evaluation.pages.notebook import shown_below_the_cell

    return shown_below_the_cell


def _players(plan: Plan, configs: Sequence[PlayerConfig]) -> dict[str, PlayerConfig]:
    """The players of a plan by `player_key`, each as it was configured."""
    found = {}
    for cell in plan.cells:
        own = [
            one for one in configs if one.name == player_of(cell) and one.options.items() <= cell.player_options.items()
        ]
        # If several players have the same name, the one with the most options in common is chosen.
        config = max(own, key=lambda one: len(one.options), default=PlayerConfig(name=player_of(cell)))
        found[player_key(cell)] = config
    return found


def _given_prices(configs: Iterable[PlayerConfig]) -> dict[str, Price]:
    found: dict[str, Price] = {}
    for config in configs:
        if config.price is not None:
            price = Price.per_million(*config.price)
            if found.setdefault(config.name, price) != price:
                raise InvalidArgumentError(f"{config.name} has two prices; a player's name has one in a run.")
    return found


def _by_executor(
    plan: Plan, factories: Mapping[str, PlayerFactory], players: Mapping[str, PlayerConfig], asked: str | None
) -> tuple[dict[str, list[PlannedEpisode]], set[str]]:
    """Return the episodes by the executor that suits their player, and the players behind a network.

    Every player is created once, so that mistakes are found before the run. Models come first.
    """
    suits: dict[str, str] = {}
    remote: set[str] = set()
    found: dict[str, list[PlannedEpisode]] = {"async": []}
    for episode in plan.episodes:
        cell = episode.cell
        if player_key(cell) not in suits:
            task = Task(
                episode, Path(), factory=factories.get(player_of(cell)), secrets=players[player_key(cell)].secrets
            )
            made = make_player(task)
            check_player(made)
            suits[player_key(cell)] = asked or _suitable(made)
            if isinstance(made, ModelPlayer):
                remote.add(player_key(cell))
                made.check_ready()
            if suits[player_key(cell)] in ELSEWHERE and (why := why_only_here(task)) is not None:
                if asked is not None:
                    raise InvalidArgumentError(why)
                suits[player_key(cell)] = "inline"
        found.setdefault(_for_game(cell.game, suits[player_key(cell)], asked), []).append(episode)
    return {name: episodes for name, episodes in found.items() if episodes}, remote


def _for_game(game: str, suits: str, asked: str | None) -> str:
    """Return the executor for a game, which other processes may not know."""
    if suits not in ELSEWHERE or not is_known_only_here(game):
        return suits
    if asked is not None:
        raise InvalidArgumentError(
            f"{game} was registered in this notebook, which worker processes cannot import; declare it in a package, "
            'or ask for executor="inline".'
        )
    return "inline"


def _suitable(player: Player | AsyncPlayer) -> str:
    if getattr(player, "interactive", False):
        return "inline"
    return "async" if isinstance(player, AsyncPlayer) else "processes"


def _manifest(
    folder: RunFolder,
    before: dict[str, Any] | None,
    plan: Plan,
    shard: tuple[int, int] | None,
    caps: Caps,
    prices: Mapping[str, Price],
) -> dict[str, Any]:
    """The manifest of the run. Its earlier prices are kept, unless the user gives others."""
    if before is not None:
        _check_same_run(folder, before, plan, shard)
    found = dict((before or {}).get("prices", {}))
    for cell in plan.cells:
        price = prices.get(player_of(cell)) or (
            None if player_of(cell) in found else find_price(player_of(cell), cell.player_options)
        )
        if price is not None:
            found[player_of(cell)] = price.to_json()
    if caps.cost is not None:
        check_known({player_of(cell) for cell in plan.cells if is_model(player_of(cell))} - found.keys())
    return {
        **plan.to_json(),
        "shard": None if shard is None else list(shard),
        "caps": asdict(caps),
        "prices": found,
        "versions": versions(),
        **{name: before[name] for name in ("run_file", "spending") if before is not None and name in before},
    }


def _check_same_run(folder: RunFolder, before: Mapping[str, Any], plan: Plan, shard: tuple[int, int] | None) -> None:
    gone = {episode["key"] for episode in before["episodes"]} - {episode.key for episode in plan.episodes}
    if gone:
        raise InvalidArgumentError(
            f"{folder.path} holds another run: {len(gone)} of its {len(before['episodes'])} episodes are not in this "
            "one. Name another folder, or ask for everything that was asked for there."
        )
    if (None if shard is None else list(shard)) != before["shard"]:
        held = "no shard" if before["shard"] is None else "shard {}/{}".format(*before["shard"])
        raise InvalidArgumentError(f"{folder.path} holds {held} of this run; name a folder of its own for every shard.")
