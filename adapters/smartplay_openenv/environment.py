"""SmartPlayEnvironment: an episode behind OpenEnv's server.

The host manages the context, so `observe` shows the history. The reward of a step is what it adds to the episode's
reward, so that the rewards of an episode sum up to it.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any
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
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.training import EpisodeFactory, RewardName
from smartplay_tools.types.messages import text_of
from smartplay_tools.web import Bounded

RUN_SEED = 1
"""Resets without a seed play the worlds of `smartplay-tools eval --seed 1`, one after another."""


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
        options: `Episode`'s other arguments.
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
        self._factory = EpisodeFactory(game, budget=budget, reward=reward, records=records, context="host", **options)
        with self._factory.sample() as sample:
            sample.refuse_pictures("OpenEnv")
        self._game = self._factory.game
        self._tools = [
            Tool(name=tool.name, description=tool.description, input_schema=dict(tool.parameters))
            for tool in self._factory.tools
        ]
        self.episode: Episode | None = None
        """The episode of the latest reset."""
        self._episode_id: str | None = None
        self._rewarded = 0.0
        self._trial = 0
        """How many resets had no seed."""

    def reset(self, seed: int | None = None, episode_id: str | None = None, **options: Any) -> Observation:
        """Begin an episode of a seed; without one, of the next world (see `RUN_SEED`)."""
        if options:
            raise InvalidArgumentError(f"reset takes seed and episode_id, and not {', '.join(sorted(options))}.")
        if seed is None:
            seed = trial_seed(RUN_SEED, self._game, self._trial)
            self._trial += 1
        self.close()
        self._episode_id, self._rewarded = episode_id or str(uuid4()), 0.0
        self.episode = self._factory.episode(seed, self._episode_id)
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
