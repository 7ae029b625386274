"""The plan of a run: its episodes, each with a key that identifies it before it is played.

A run plays a number of trials of each cell. A cell is an `EpisodeConfig` without its seed: the game, the player, the
budget and the rules of the conversation. The seed of trial i depends only on the run's seed, the game and i, so that
all cells and players have the same worlds and can be compared in pairs. The key of an episode is the digest of its
config, so the same episode has the same key in every plan, and a run that is resumed, extended, sharded or merged
recognises it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.episode.cells import cell_config, with_recorded_name
from smartplay_tools.episode.config import RULES, CellConfig
from smartplay_tools.episode.game_session import GameSession
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.run_folder.folder import Manifest, ManifestEpisode, RunFolder, shard_of
from smartplay_tools.evaluation.runs.players import PlayerConfig, check_no_credentials, read_players
from smartplay_tools.evaluation.suites import Suite
from smartplay_tools.games.game_registry import GameSpec, close_game
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.games.specs import IN_FILES, get_spec
from smartplay_tools.players.player_registry import second_name
from smartplay_tools.providers.prices import Price, find_price
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Budget

FIXED = ("games", "trials", "repeats", "budgets", "engine", "tokenizer", "options", *RULES)
"""What a fixed suite does not leave to the user."""


@dataclass(frozen=True)
class PlannedEpisode:
    """An episode of a run: its cell and the cell's number in the plan, its trial, its seed, and its key."""

    key: str
    cell: CellConfig
    place: int
    trial: int
    seed: int
    repeat: int = 0
    """Which time its world is played."""


@dataclass(frozen=True)
class Plan:
    """The episodes of a run in their order: cell by cell, trial by trial."""

    seed: int
    cells: tuple[CellConfig, ...]
    episodes: tuple[PlannedEpisode, ...]
    repeats: int = 1
    """How often each world is played, one trial after the other."""

    def manifest(self, prices: Mapping[str, Price], **facts: Any) -> Manifest:
        """Return the manifest of a run of this plan.

        `prices` are those that are given, before those in the tables; `facts` are the manifest's other fields.
        """
        episodes = (
            ManifestEpisode(episode.key, episode.place, episode.trial, episode.seed) for episode in self.episodes
        )
        repeats = None if self.repeats == 1 else self.repeats
        games = {cell.game_sha256: str(game_file(cell)) for cell in self.cells}
        strategies = {cell.strategy_sha256: str(strategy_file(cell)) for cell in self.cells}
        return Manifest(
            seed=self.seed,
            cells=self.cells,
            episodes=tuple(episodes),
            repeats=repeats,
            prices={**prices_in_tables(self.cells), **prices},
            game_files=_in_files(games),
            strategy_files=_in_files(strategies),
            **facts,
        )

    def as_recorded(self, folder: RunFolder) -> Plan:
        """Return the plan with the keys that a run's folder has.

        They follow from the version of the prompts, with which a run that has begun goes on, and from the names of
        strategies in files: earlier versions recorded the path of such a file as it was written.
        """
        if not (folder.path / "manifest.json").exists():
            return self
        before, plan = folder.manifest().cells, self
        if len(begun := {cell.prompts for cell in before}) == 1:
            plan = plan.with_prompts(*begun)
        if not any(cell.strategy_sha256 for cell in plan.cells):
            return plan
        recorded = {with_recorded_name(cell).digest: cell for cell in before}
        return plan._with_cells(recorded.get(cell.digest, cell) for cell in plan.cells)

    def with_prompts(self, version: str) -> Plan:
        """Return the plan with a version of the prompts."""
        return self._with_cells(cell.model_copy(update={"prompts": version}) for cell in self.cells)

    def _with_cells(self, changed: Iterable[CellConfig]) -> Plan:
        """Return the plan with other cells, from which other keys follow."""
        cells = tuple(changed)
        keys = {e.key: cells[e.place].with_seed(e.seed, e.repeat).key for e in self.episodes}
        episodes = tuple(replace(e, key=keys[e.key], cell=cells[e.place]) for e in self.episodes)
        return replace(self, cells=cells, episodes=episodes)

    def shard(self, number: int, count: int) -> Plan:
        """Return the part that shard `number` of `count` plays, counting from 1: every count-th trial of each cell.

        Every shard therefore gets its share of long and short episodes. The shard of an episode depends only on its
        cell and trial, so it does not change when trials, games or players are added. A chain of trials (`Rules.carry`)
        is not divided.
        """
        if not 1 <= number <= count:
            raise InvalidArgumentError(
                f"There is no shard {number} of {count}; the shards are 1/{count} to {count}/{count}."
            )
        digests = [cell.digest for cell in self.cells]
        mine = (e for e in self.episodes if shard_of(digests[e.place], e.cell.chain_of(e.trial), count) == number)
        return replace(self, episodes=tuple(mine))


def cell_name(cell: CellConfig) -> str:
    """Return the name of a cell in messages: game, player, and what it is given."""
    return ", ".join(filter(None, (cell.game, player_of(cell), cell.describe())))


def player_of(cell: CellConfig) -> str:
    """Return the player's name, which every cell of a run has."""
    assert cell.player is not None
    return cell.player


def priced_names(cells: Iterable[CellConfig]) -> Iterator[str]:
    """Yield the names of players that can have a price: those of cells, and those that answer a compactor."""
    for cell in cells:
        yield from filter(None, (player_of(cell), second_name(cell.player_options)))


def player_key(cell: CellConfig) -> str:
    """Return a player and its options as one text, which is equal for cells with the same player."""
    return f"{cell.player} {canonical_json(cell.player_options).decode('ascii')}"


def _in_files(paths: Mapping[str | None, str]) -> dict[str, str] | None:
    """Return the paths that have a digest; None without any."""
    return {sha256: path for sha256, path in paths.items() if sha256 is not None} or None


def game_file(cell: CellConfig) -> Path | None:
    """Return the file of a cell's game, as the user has named it; None if it is not in a file."""
    return None if cell.game_file is None else IN_FILES.recorded(cell.game_file, cell.game_sha256).path


def strategy_file(cell: CellConfig) -> Path | None:
    """Return the file of a cell's custom strategy, as the user has named it; None if it is not in a file."""
    strategy = cell.budget.strategy
    return None if strategy is None else load_strategy(strategy, cell.strategy_sha256).path


def prices_in_tables(cells: Iterable[CellConfig]) -> dict[str, Price]:
    """Return the prices of players from the tables; none for a player whose cells differ in it, or partly have none."""
    by_player: dict[str, set[Price | None]] = {}
    for player, options in {player_key(cell): (player_of(cell), cell.player_options) for cell in cells}.values():
        by_player.setdefault(player, set()).add(find_price(player, options))
        if (second := second_name(options)) is not None:
            by_player.setdefault(second, set()).add(find_price(second, {}))
    return {player: price for player, prices in by_player.items() if len(prices) == 1 for price in prices if price}


def plan_episodes(
    cells: Iterable[CellConfig],
    *,
    trials: int | Mapping[str, int | None] | None = None,
    seed: int = 0,
    repeats: int = 1,
) -> Plan:
    """Plan `trials` episodes of every cell, or the paper's number of them for its game.

    Trials can be given for each game; where there is none, it is the paper's number too. With `repeats`, each of these
    worlds is played several times, with other random numbers of the player.

    Cells that cannot be played (the budget is too small for the head of a prompt, or the engine is not installed) raise
    an `InvalidArgumentError` that names them, before anything is played. No world is made for this check.
    """
    if repeats < 1:
        raise InvalidArgumentError(f"repeats must be at least 1, not {repeats}.")
    if isinstance(trials, int) and trials < 1:
        raise InvalidArgumentError(f"trials must be at least 1, not {trials}.")
    cells = tuple(cells)
    episodes: list[PlannedEpisode] = []
    faults: list[str] = []
    for place, cell in enumerate(cells):
        try:
            check_playable(cell)
            asked = trials.get(cell.game) if isinstance(trials, Mapping) else trials
            episodes += _trials(cell, place, asked or cell.spec.trials, seed, repeats)
        except InvalidArgumentError as error:
            faults.append(f"{cell_name(cell)}: {error}")
    if faults:
        raise InvalidArgumentError("This cannot be played. " + " ".join(faults))
    if len({episode.key for episode in episodes}) < len(episodes):
        raise InvalidArgumentError("The run asks for the same episode twice; name every game and player once.")
    return Plan(seed, cells, tuple(episodes), repeats)


def plan_suite(
    suite: Suite,
    players: Sequence[str | PlayerConfig],
    *,
    seed: int = 0,
    player_options: Mapping[str, Any] | None = None,
    given: Iterable[str] = (),
) -> Plan:
    """Plan a fixed suite; `given` are the other arguments, of which those that the suite fixes are refused."""
    if refused := sorted(set(given) & set(FIXED)):
        raise InvalidArgumentError(
            f"The suite {suite.name} fixes {', '.join(refused)}; leave that out, or name games instead of the suite."
        )
    cells = make_cells(suite.games, players, suite.budgets, options=suite.options, player_options=player_options)
    return plan_episodes(cells, trials=suite.trials, seed=seed).with_prompts(suite.prompts)


def check_playable(cell: CellConfig) -> None:
    """Check the options of the game, its engine and the budget by creating them, without making a world."""
    game = cell.make_game(cell.spec)
    try:
        GameSession(cell.spec, game, cell, shared_counter(cell.tokenizer, cell.prompts))
    finally:
        close_game(game)


def _trials(cell: CellConfig, place: int, worlds: int, seed: int, repeats: int) -> Iterator[PlannedEpisode]:
    if repeats > 1 and cell.carry is not None:
        raise InvalidArgumentError(f"carry={cell.carry} plays every world once; leave out repeats={repeats}.")
    for world in range(worlds):
        own = trial_seed(seed, cell.game, world)
        for repeat in range(repeats):
            key = cell.with_seed(own, repeat).key
            yield PlannedEpisode(key, cell, place, world * repeats + repeat, own, repeat)


def make_cells(
    games: Sequence[str],
    players: Sequence[str | PlayerConfig],
    budgets: Sequence[Budget] | Callable[[GameSpec], Sequence[Budget]],
    *,
    engine: str | None = None,
    tokenizer: str | None = None,
    options: Mapping[str, Any] | None = None,
    player_options: Mapping[str, Any] | None = None,
    **rules: Any,
) -> list[CellConfig]:
    """Return a cell for every game, player and budget, in this order, under the given rules (`Rules`).

    `budgets` may be a function that returns those of a game.

    An engine or a game's option applies to the games that have it; it is an error if no game has it. `player_options`
    apply to all players; a `PlayerConfig` can have further options.
    """
    if unknown := ", ".join(name for name in rules if name not in RULES):
        raise InvalidArgumentError(f"A run has no argument {unknown}; the rules are {', '.join(RULES)}.")
    if not callable(budgets) and (other := next((b for b in budgets if not isinstance(b, Budget)), None)) is not None:
        raise InvalidArgumentError(f"{other!r} is not a Budget; write Budget(history=5), for example.")
    configs = read_players(players)
    _check_player_options(configs, player_options or {})
    kinds = {game: get_spec(game).load() for game in games}
    if engine is not None and not any(engine in kind.engines for kind in kinds.values()):
        raise InvalidArgumentError(f"None of the games has an engine {engine!r}.")
    for name in options or {}:
        if not any(name in kind.options for kind in kinds.values()):
            raise InvalidArgumentError(f"None of the games has an option {name!r}.")
    counter = shared_counter(tokenizer)
    return [
        cell_config(
            game,
            budget=budget,
            engine=engine if engine in kinds[game].engines else None,
            counter=counter,
            player=config.name,
            player_options={**(player_options or {}), **config.options},
            **rules,
            **{name: value for name, value in (options or {}).items() if name in kinds[game].options},
        )
        for game in games
        for config in configs
        for budget in (budgets(get_spec(game)) if callable(budgets) else budgets)
    ]


def _check_player_options(configs: Sequence[PlayerConfig], common: Mapping[str, Any]) -> None:
    for where, options in [("player_options", common), *((config.name, config.options) for config in configs)]:
        check_no_credentials(where, options)
        if "seed" in options:
            raise InvalidArgumentError("seed is not an option of a player here: a player has the seed of its episode.")
