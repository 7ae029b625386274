"""SmartPlayEnvironment: an episode behind OpenEnv's server, and its tasks, which are seeds.

The host manages the context, so `observe` shows the history. The reward of a step is what it adds to the episode's
reward, so that the rewards of an episode sum up to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from fastapi import FastAPI
from openenv.core.env_server.http_server import create_app
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.mcp_types import (
    CallToolAction,
    CallToolObservation,
    ListToolsAction,
    ListToolsObservation,
    Tool,
    ToolError,
    ToolErrorType,
)
from openenv.core.env_server.types import EnvironmentMetadata, Observation, State

from smartplay_tools import Budget, Episode, InvalidArgumentError
from smartplay_tools.games import get_spec
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.training import EpisodeFactory, RewardName
from smartplay_tools.types.messages import text_of
from smartplay_tools.web import Bounded


class Split(NamedTuple):
    """Tasks whose seeds are those of `smartplay-tools eval --seed RUN_SEED`: task i is trial i.

    A game that has splits, as MESSENGER, plays the one of the same name: another seed of its test split
    would have the same names in the same roles.
    """

    run_seed: int
    tasks: int


SPLITS: Mapping[str, Split] = {"train": Split(run_seed=1, tasks=1_000_000), "test": Split(run_seed=0, tasks=100)}
"""The splits by name. The test tasks are the worlds that an evaluation plays by default."""

PREVIEW = 100
"""The most tasks of a split that are listed; each has its number."""


class SmartPlayState(State):
    """The state of an episode, as the server gives it to the trainer; no tool shows it to a model."""

    game: str = ""
    seed: int | None = None
    score: float | None = None
    normalized_score: float | None = None
    end_reason: str | None = None


class ResetObservation(Observation):
    """The first messages of an episode as one text. The game is observed by a tool."""

    text: str = ""


class SmartPlayEnvironment(Environment[Any, Observation, SmartPlayState]):
    """One episode at a time of one game.

    Arguments:
        game: the id of a setting.
        budget: what an episode may spend; here `history`, `result_tokens` and `tool_calls` are enforced.
        reward: "normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards.
        records: a folder for the record of every episode, under its seed and episode id.
        options: `Episode`'s other arguments. A `split` of the game's own that is given here is the one of all tasks.
    """

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(
        self,
        game: str,
        *,
        budget: Budget | None = None,
        reward: RewardName = "normalized",
        records: str | Path | None = None,
        **options: Any,
    ) -> None:
        super().__init__()
        new = partial(EpisodeFactory, game, budget=budget, reward=reward, records=records, context="host")
        self._factory = new(**options)
        with self._factory.sample() as sample:
            sample.refuse_pictures("OpenEnv")
        self._game = self._factory.game
        self._tools = [
            Tool(name=tool.name, description=tool.description, input_schema=dict(tool.parameters))
            for tool in self._factory.tools
        ]
        has_splits = "split" in get_spec(game).load().options and "split" not in options
        self._of_split = {name: new(split=name, **options) if has_splits else self._factory for name in SPLITS}
        self.episode: Episode | None = None
        """The episode of the latest reset."""
        self._episode_id: str | None = None
        self._rewarded = 0.0

    def reset(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        split: str | None = None,
        index: int | None = None,
        **options: Any,
    ) -> Observation:
        """Begin an episode: of a seed, or of a task of a split. Without either, it is task 0 of "train"."""
        if options:
            raise InvalidArgumentError(f"reset takes seed, or split and index, and not {', '.join(sorted(options))}.")
        factory = self._factory
        if seed is None:
            split = split or "train"
            seed, factory = self.get_task(split, index or 0)["seed"], self._of_split[split]
        elif split is not None or index is not None:
            raise InvalidArgumentError("reset takes seed, or split and index, and not both.")
        self.close()
        self._episode_id, self._rewarded = episode_id or str(uuid4()), 0.0
        self.episode = factory.episode(seed, self._episode_id)
        return ResetObservation(text="\n\n".join(text_of(message) for message in self.episode.head))

    def step(self, action: Any, timeout_s: float | None = None, **options: Any) -> Observation:
        """List the tools, or call one. A model's mistake is the result of its call, as everywhere."""
        if isinstance(action, ListToolsAction):
            return ListToolsObservation(tools=self._tools)
        if not isinstance(action, CallToolAction):
            raise InvalidArgumentError(f"The actions are list_tools and call_tool, not {type(action).__name__}.")
        if self.episode is None:
            error = ToolError(error_type=ToolErrorType.EXECUTION_ERROR, message="Reset the environment first.")
            return CallToolObservation(tool_name=action.tool_name, error=error)
        result = self.episode.call(action.tool_name, action.arguments)
        return CallToolObservation(
            tool_name=action.tool_name,
            result=result.text,
            done=result.done,
            reward=self._gain() if "reward" in result.data else None,
            metadata={"is_error": result.is_error},
        )

    @property
    def state(self) -> SmartPlayState:
        """The state of the episode."""
        if self.episode is None:
            return SmartPlayState(game=self._game)
        progress = self.episode.progress
        return SmartPlayState(
            episode_id=self._episode_id,
            step_count=progress.steps,
            game=self._game,
            seed=self.episode.config.seed,
            score=progress.score,
            normalized_score=progress.normalized_score,
            end_reason=progress.end_reason,
        )

    def get_metadata(self) -> EnvironmentMetadata:
        """Return the name and description of the environment."""
        return EnvironmentMetadata(
            name=f"SmartPlay {self._game}",
            description="A game of the SmartPlay benchmark as the tools observe, act and read_manual.",
            documentation_url="https://arxiv.org/abs/2310.01557",
        )

    def list_splits(self) -> list[str]:
        """Return the names of the splits."""
        return list(SPLITS)

    def num_tasks(self, split: str) -> int:
        """Return the number of a split's tasks."""
        return _split(split).tasks

    def get_task(self, split: str, index: int) -> dict[str, Any]:
        """Return a task: its id, index and seed. An index that is out of range is an `IndexError`, as OpenEnv asks."""
        chosen = _split(split)
        if not 0 <= index < chosen.tasks:
            raise IndexError(f"{split} has the tasks 0 to {chosen.tasks - 1}, not {index}.")
        return {
            "id": f"{self._game}-{split}-{index}",
            "index": index,
            "seed": trial_seed(chosen.run_seed, self._game, index),
        }

    def get_task_range(self, split: str, start: int | None = None, stop: int | None = None) -> list[dict[str, Any]]:
        """Return the tasks of a slice."""
        return [self.get_task(split, index) for index in range(*slice(start, stop).indices(_split(split).tasks))]

    def list_tasks(self, split: str) -> list[dict[str, Any]]:
        """Return a preview of a split's tasks: its first 100."""
        return self.get_task_range(split, 0, PREVIEW)

    def close(self) -> None:
        """End the episode, if the game has not ended it."""
        if self.episode is not None:
            self.episode.end("host", detail="The client has ended the episode.")
            self.episode.close()

    def _gain(self) -> float:
        assert self.episode is not None
        before, self._rewarded = self._rewarded, self._factory.reward(self.episode)
        return self._rewarded - before


def new_app(game: str, *, sessions: int = 64, **options: Any) -> FastAPI:
    """Return the server of a game, an ASGI application; `options` are those of `SmartPlayEnvironment`.

    `sessions` is how many clients may play at the same time, each its own episode.
    """
    SmartPlayEnvironment(game, **options)  # a mistake is reported here, not to the first client
    app = create_app(
        partial(SmartPlayEnvironment, game, **options),
        CallToolAction,
        CallToolObservation,
        env_name="smartplay",
        max_concurrent_envs=sessions,
        state_cls=SmartPlayState,
        reset_observation_cls=ResetObservation,
    )
    app.add_middleware(Bounded)
    return app


def _split(name: str) -> Split:
    if name not in SPLITS:
        raise InvalidArgumentError(f"The splits are {', '.join(SPLITS)}, and not {name!r}.")
    return SPLITS[name]
