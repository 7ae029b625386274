"""The tasks: one game or several under one budget, and the paper's suite.

A sample is an episode. Its metadata holds the `EpisodeConfig`, from which the solver makes the episode, so a log says
by itself what was played. The seeds are those of `smartplay-tools eval`: trial i of a game is the same world there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from inspect_ai import Task, task
from inspect_ai.dataset import MemoryDataset, Sample

from smartplay_inspect.scorer import metrics_for, smartplay_scorer
from smartplay_inspect.solver import smartplay_agent
from smartplay_tools import GAMES, Budget, EpisodeConfig, InvalidArgumentError
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.episode import cell_config
from smartplay_tools.games import PAPER_RESULTS
from smartplay_tools.games.seeds import trial_seed

VERSION = "1"
"""Raised when a change makes the scores of a task incomparable with those of its former versions."""


@task
def smartplay(
    game: str | Sequence[str] = "Hanoi3Disk-v0",
    trials: int | None = None,
    seed: int = 0,
    engine: str | None = None,
    tokenizer: str | None = None,
    pictures: bool = False,
    **rules: Any,
) -> Task:
    """Play settings of the benchmark under a budget.

    `game` is the id of a setting, or several, as a list or with commas. `trials` is the number of episodes of every
    game, the paper's number for it if not given; their seeds follow from `seed`. `rules` are fields of a `Budget`, for
    which the word "none" means no limit, rules of the episode (`manual`, `batch`, `observation`) and the game's own
    options. `pictures` says that the model sees pictures, as `observation` needs it.
    """
    games = game.split(",") if isinstance(game, str) else list(game)
    limits = {name: value for name, value in rules.items() if name in Budget.model_fields}
    others = {name: value for name, value in rules.items() if name not in Budget.model_fields}
    options = {**others, "engine": engine, "counter": TokenCounter(tokenizer)}
    budget = _budget(limits)
    samples = [sample for name in games for sample in _samples(name.strip(), trials, seed, budget, options)]
    return _task(samples, "smartplay", pictures=pictures)


@task
def paper(trials: int | None = None, seed: int = 0, prompt_tokens: int | None = None) -> Task:
    """Play the seven settings of the paper's result tables, with its histories, rollouts and numbers of trials."""
    budget = _budget({"prompt_tokens": prompt_tokens})
    samples = [sample for game in PAPER_RESULTS[0].raw for sample in _samples(game, trials, seed, budget, {})]
    return _task(samples, "paper")


def _task(samples: list[Sample], name: str, *, pictures: bool = False) -> Task:
    games = {str((sample.metadata or {})["game"]) for sample in samples}
    return Task(
        dataset=MemoryDataset(samples, name=name),
        solver=smartplay_agent(pictures=pictures),
        scorer=smartplay_scorer(),
        metrics=metrics_for(games),
        version=VERSION,
    )


def _samples(game: str, trials: int | None, seed: int, budget: Budget, options: dict[str, Any]) -> list[Sample]:
    if trials is not None and trials < 1:
        raise InvalidArgumentError(f"trials must be at least 1, not {trials}.")
    cell = cell_config(game, budget=budget, **options)
    return [
        _sample(trial, cell.with_seed(trial_seed(seed, cell.game, trial)))
        for trial in range(trials or GAMES[cell.game].trials)
    ]


def _sample(trial: int, config: EpisodeConfig) -> Sample:
    return Sample(
        input=f"Play {config.game}, trial {trial}.",
        id=f"{config.game}-{trial}",
        metadata={"game": config.game, "trial": trial, "seed": config.seed, "config": config.to_json()},
    )


def _budget(limits: dict[str, Any]) -> Budget:
    """The budget of a task's arguments, where None is "not given" and the word "none" means no limit."""
    return Budget.of(**limits)
