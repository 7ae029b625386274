"""The taskset: a task is one episode, and its reward is the episode's.

Options are the taskset's, not the harness's, because a task has to say by itself what is played.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import verifiers.v1 as vf
from pydantic import Field, ValidationError

from smartplay_tools import Budget, Episode, EpisodeConfig, InvalidArgumentError
from smartplay_tools.episode import RewardName, cell_config, reward_of
from smartplay_tools.errors import in_one_line
from smartplay_tools.records import trial_seed
from smartplay_tools.tokens import TokenCounter
from smartplay_tools.types import BeyondHistory

INFO = "smartplay"
"""Where a trace keeps what the harness has played: reward, result and record."""

FIGURES = ("score", "normalized_score", "completed", "steps", "illegal_actions", "malformed_calls")
"""The metrics that are fields of the result."""


class SmartPlayData(vf.TaskData):
    """What a task plays."""

    config: dict[str, Any]
    """The `EpisodeConfig`, seed included."""
    reward: RewardName


class SmartPlayTask(vf.Task[SmartPlayData, vf.State, vf.TaskConfig]):
    """One episode."""

    @vf.reward
    async def game_reward(self, trace: vf.Trace[Any, Any]) -> float:
        """The episode's reward."""
        return float(trace.info[INFO]["reward"])

    @vf.metric
    async def figures(self, trace: vf.Trace[Any, Any]) -> Mapping[str, float]:
        """Figures of the episode's result; a game without a human score has no normalised one."""
        result = trace.info[INFO]["result"]
        found = {name: float(result[name]) for name in FIGURES if result[name] is not None}
        tokens = result["tokens"]
        return {**found, "prompt_tokens": float(tokens["prompt"]), "reply_tokens": float(tokens["reply"])}


class BudgetConfig(vf.BaseConfig):
    """Fields of a `Budget`. One that is not given has its default; the word "none" means no limit."""

    history: int | Literal["none"] | None = None
    prompt_tokens: int | Literal["none"] | None = None
    reply_tokens: int | Literal["none"] | None = None
    episode_tokens: int | Literal["none"] | None = None
    result_tokens: int | Literal["none", "auto"] | None = None
    tool_calls: int | Literal["none"] | None = None
    slack: float | None = None
    beyond_history: BeyondHistory | None = None
    notes_tokens: int | Literal["none"] | None = None
    summary_tokens: int | Literal["none"] | None = None

    def budget(self) -> Budget:
        """Return the budget."""
        given = {name: value for name, value in self.model_dump().items() if value is not None}
        asked: dict[str, Any] = {name: None if value == "none" else value for name, value in given.items()}
        try:
            return Budget(**asked)
        except ValidationError as error:
            raise InvalidArgumentError(f"The taskset's budget is invalid: {in_one_line(error)}.") from None


class SmartPlayConfig(vf.TasksetConfig):
    """The options of the taskset, under `--env.taskset`."""

    game: str = "Hanoi3Disk-v0"
    """The id of a setting."""
    seed: int = 0
    """Task i is the world of trial i of `smartplay-tools eval --seed`. Train on other seeds than you evaluate on."""
    reward: RewardName = "normalized"
    """"normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards."""
    budget: BudgetConfig = BudgetConfig()
    """What the model sees and may spend."""
    tokenizer: str | None = None
    """The tokenizer that counts budget tokens."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Rules of the episode (`manual`, `batch`), `engine`, and the game's own options."""


class SmartPlayTaskset(vf.Taskset[SmartPlayTask, SmartPlayConfig]):
    """The worlds of one game, without an end."""

    INFINITE = True

    def load(self) -> Iterator[SmartPlayTask]:
        """Yield a task for every trial."""
        asked = self.config
        cell = cell_config(
            asked.game,
            budget=asked.budget.budget(),
            counter=TokenCounter(asked.tokenizer),
            **{"engine": None, **asked.options},
        )
        with Episode.from_config(cell.with_seed(0), tokenizer=asked.tokenizer) as sample:
            reward_of(sample, asked.reward)  # a game without this reward is refused before anything is played
        for trial in itertools.count():
            config: EpisodeConfig = cell.with_seed(trial_seed(asked.seed, cell.game, trial))
            data = SmartPlayData(  # type: ignore[call-arg]  # defaults that mypy does not see
                name=f"{cell.game}-{trial}",
                prompt=f"Play {cell.game}, trial {trial}.",
                config=config.to_json(),
                reward=asked.reward,
            )
            yield SmartPlayTask(data, asked.task)
