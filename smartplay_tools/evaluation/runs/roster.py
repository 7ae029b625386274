"""The roster of a run: how each player of its plan is configured, and where its episodes are played.

A player suits an executor: one that waits is played on an event loop, one that computes in worker processes. A worker
imports what a task names. It imports a script again, as `multiprocessing` does, but it cannot import a notebook: what
is defined there is known in the notebook's process only, and is played there.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.conversation.loop import check_observation, check_player
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.processes import check_may_start_processes
from smartplay_tools.evaluation.runs.agents import FunctionAgent
from smartplay_tools.evaluation.runs.attempt import Task, make_player
from smartplay_tools.evaluation.runs.plan import Plan, PlannedEpisode, player_key, player_of, priced_names
from smartplay_tools.evaluation.runs.players import PlayerConfig, check_prices
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.games.specs import GAMES
from smartplay_tools.players import ModelPlayer
from smartplay_tools.types import AsyncPlayer, Player

ELSEWHERE = ("processes", "ray")
"""Executors whose attempts are made in other processes."""


@dataclass(frozen=True)
class Roster:
    """The part of a plan that is played, and its players, by `player_key` where nothing else is said."""

    part: Plan
    players: Mapping[str, PlayerConfig]
    episodes: Mapping[str, Sequence[PlannedEpisode]]
    """The episodes of the part, by the name of the executor that suits their player; models come first."""
    tried: Set[str]
    """The players of which one episode is tried first: models and agent functions."""


def roster_of(plan: Plan, players: Sequence[PlayerConfig], options: RunOptions) -> Roster:
    """Return the roster of a plan. Every player is made once, so that mistakes are found before the run."""
    configs = _configs(plan, players)
    part = plan if options.shard is None else plan.shard(*options.shard)
    check_prices(options.prices or (), priced_names(plan.cells))
    episodes, tried = _by_executor(part, configs, options.executor)
    return Roster(part, configs, episodes, tried)


def _configs(plan: Plan, given: Sequence[PlayerConfig]) -> dict[str, PlayerConfig]:
    """The players of a plan by `player_key`, each as it was configured."""
    configs = {}
    for cell in plan.cells:
        name, options = player_of(cell), cell.player_options
        own = [config for config in given if config.name == name and config.options.items() <= options.items()]
        # If several players have the same name, the one with the most options in common is chosen.
        configs[player_key(cell)] = max(own, key=lambda config: len(config.options), default=PlayerConfig(name=name))
    return configs


def _by_executor(
    plan: Plan, configs: Mapping[str, PlayerConfig], asked: str | None
) -> tuple[dict[str, list[PlannedEpisode]], set[str]]:
    """Return the episodes by the executor that suits their player, and the players that are tried first."""
    suits: dict[int, str] = {}
    made: dict[str, Player | AsyncPlayer] = {}
    tried: set[str] = set()
    episodes_of: dict[str, list[PlannedEpisode]] = {"async": []}
    for episode in plan.episodes:
        if episode.place not in suits:
            key = player_key(episode.cell)
            task = Task(episode, configs[key], Path())
            agent = task.player.agent
            if agent is None:
                if key not in made:
                    made[key] = _checked(task)
                check_observation(made[key], episode.cell.observation)
                suits[episode.place] = _suitable(task, made[key], asked)
            else:
                suits[episode.place] = "async"
            if isinstance(agent, FunctionAgent) or isinstance(made.get(key), ModelPlayer):
                tried.add(key)
        episodes_of.setdefault(suits[episode.place], []).append(episode)
    return {name: episodes for name, episodes in episodes_of.items() if episodes}, tried


def _checked(task: Task) -> Player | AsyncPlayer:
    """Make a task's player, and check what can be checked before it plays."""
    player = make_player(task)
    check_player(player)
    if isinstance(player, ModelPlayer):
        player.check_ready()
    return player


def _suitable(task: Task, player: Player | AsyncPlayer, asked: str | None) -> str:
    """Return the executor for a player and a game, which other processes may not know."""
    if asked is None and getattr(player, "interactive", False):
        return "inline"
    name = asked or ("async" if isinstance(player, AsyncPlayer) else "processes")
    if name in ELSEWHERE and (why := why_only_here(task)) is not None:
        if asked is not None:
            raise InvalidArgumentError(f'{why}, or ask for executor="inline".')
        return "inline"
    if name == "processes":
        check_may_start_processes()
    return name


def why_only_here(task: Task) -> str | None:
    """Return why a task can be played in this process only, with a remedy; None if it can be played elsewhere."""
    cell = task.planned.cell
    unknown = "which worker processes cannot import"
    if _is_without_file() and cell.game_file is None and not GAMES.is_declared(cell.game):
        return f"{cell.game} was registered in this notebook, {unknown}; name it in a file as FILE.py:NAME"
    if _is_without_file() and getattr(task.player.factory, "__module__", None) == "__main__":
        return f"The player {cell.player!r} is defined in this notebook, {unknown}; have it in a module"
    try:
        pickle.dumps(task)
    except Exception as error:
        player = f"The player {cell.player!r} cannot be sent to worker processes ({error})"
        return f"{player}; have it in a module under its name"
    return None


def _is_without_file() -> bool:
    """Whether the main program is a notebook or an interactive session, and so no file that could be imported."""
    return getattr(sys.modules["__main__"], "__file__", None) is None
