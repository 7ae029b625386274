"""The taskset: a task is one episode, and its reward is the episode's.

Options are the taskset's, not the harness's, because a task has to say by itself what is played. In `SmartPlayEnv` one
agent plays each task; it differs from verifiers' environment only in needing no sandbox. `save_records` writes the
records of an evaluation's episodes to files, which can be replayed.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import verifiers.v1 as vf
from pydantic import Field, create_model

from smartplay_tools import Budget, Episode, EpisodeConfig, InvalidArgumentError, get_player, play
from smartplay_tools.context.strategies.custom import load_strategy
from smartplay_tools.errors import TranscriptError
from smartplay_tools.games import get_spec
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.training import EpisodeFactory, RewardName, reward_of
from smartplay_tools.transcript import Event, write_records

INFO = "smartplay"
"""Where a trace keeps what the harness has played: reward, result and record."""

FIGURES = ("score", "normalized_score", "completed", "steps", "illegal_actions", "malformed_calls")
"""The metrics that are fields of the result."""


class SmartPlayData(vf.TaskData):
    """What a task plays."""

    config: dict[str, Any]
    """The `EpisodeConfig`, seed included."""
    reward: RewardName
    game: str | None = None
    """The game as the taskset names it, where that is a file, whose path a config does not have."""
    strategy: str | None = None
    """The budget's strategy as the taskset names it, with the path of its file, which a config does not have."""

    def episode(self, record: list[Event]) -> Episode:
        """Return the task's episode, with `record` as its transcript."""
        config = EpisodeConfig(**self.config)
        if self.game is not None:
            get_spec(self.game)
        if self.strategy is not None:
            load_strategy(self.strategy, config.strategy_sha256)
        return Episode.from_config(config, transcript=record)


def outcome(episode: Episode, reward: RewardName, record: Sequence[Event]) -> dict[str, Any]:
    """Return what a trace keeps of an episode that is over: reward, result, and the record as the text of its file.

    As text in ASCII, since a trace is written as UTF-8, which cannot hold the half characters that models write.
    """
    assert episode.result is not None
    return {
        "reward": reward_of(episode, reward),
        "result": episode.result.model_dump(mode="json"),
        "record": "".join(json.dumps(event) + "\n" for event in record),
    }


class SmartPlayTask(vf.Task[SmartPlayData, vf.State, vf.TaskConfig]):
    """One episode.

    `vf-validate` checks it without a model: the oracle's episode has to be worth more than one in which nothing is
    played, and that one less than 1.
    """

    async def finalize(self, trace: vf.Trace[Any, Any], runtime: vf.Runtime) -> None:
        """If no agent has played, leave the outcome of an episode in which nothing is played."""
        if INFO not in trace.info:
            trace.info[INFO] = await asyncio.to_thread(_play, self.data, None)

    async def validate(self, runtime: vf.Runtime) -> bool | None:
        """Return whether the oracle earns more than no play at all; None where the best play is not known."""
        try:
            best = await asyncio.to_thread(_play, self.data, "oracle")
        except InvalidArgumentError:
            return None
        nothing = await asyncio.to_thread(_play, self.data, None)
        return bool(best["reward"] > nothing["reward"])

    @vf.reward
    async def game_reward(self, trace: vf.Trace[Any, Any]) -> float:
        """The episode's reward."""
        return float(trace.info[INFO]["reward"])

    @vf.metric
    async def figures(self, trace: vf.Trace[Any, Any]) -> Mapping[str, float]:
        """Figures of the episode's result; a game without a human score has no normalised one."""
        result = trace.info[INFO]["result"]
        figures = {name: float(result[name]) for name in FIGURES if result[name] is not None}
        tokens = result["tokens"]
        return {**figures, "prompt_tokens": float(tokens["prompt"]), "reply_tokens": float(tokens["reply"])}


def _play(data: SmartPlayData, player: str | None) -> dict[str, Any]:
    """Play a task without a model: by a scripted player, or not at all."""
    record: list[Event] = []
    with data.episode(record) as episode:
        if player is not None:
            play(episode, get_player(player))
    return outcome(episode, data.reward, record)


Limit = Annotated[int | float | str | None, Field(union_mode="left_to_right")]
"""A number, or a word such as "none"; the budget says which of them it takes."""


_FIELDS: dict[str, Any] = dict.fromkeys(Budget.model_fields, (Limit, None))
_Fields: Any = create_model("_Fields", __base__=vf.BaseConfig, **_FIELDS)


class BudgetConfig(_Fields):  # type: ignore[misc]
    """The fields of a `Budget`. One that is not given has its default; the word "none" means no limit."""

    def budget(self) -> Budget:
        """Return the budget."""
        return Budget.of(**self.model_dump())


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
    """Rules of the episode (`manual`, `batch`), `engine`, and the game's own options.

    Train MESSENGER with `split="train"`: in its default split a name tells the role.
    """


class SmartPlayTaskset(vf.Taskset[SmartPlayTask, SmartPlayConfig]):
    """The worlds of one game, without an end."""

    INFINITE = True

    def load(self) -> Iterator[SmartPlayTask]:
        """Yield a task for every trial."""
        chosen = self.config
        budget = chosen.budget.budget()
        factory = EpisodeFactory(
            chosen.game,
            budget=budget,
            reward=chosen.reward,
            tokenizer=chosen.tokenizer,
            **chosen.options,
        )
        for trial in itertools.count():
            config = factory.config(trial_seed(chosen.seed, factory.game, trial))
            data = SmartPlayData(  # type: ignore[call-arg]  # defaults that mypy does not see
                name=f"{factory.game}-{trial}",
                prompt=f"Play {factory.game}, trial {trial}.",
                config=config.to_json(),
                reward=chosen.reward,
                game=None if config.game_file is None else chosen.game,
                strategy=budget.strategy,
            )
            yield SmartPlayTask(data, chosen.task)


class SmartPlayEnvConfig(vf.EnvConfig):
    """The agent, which runs in this process: the harness executes nothing that a model has written."""

    agent: vf.AgentConfig = vf.AgentConfig(runtime=vf.SubprocessConfig())


class SmartPlayEnv(vf.Env[SmartPlayEnvConfig]):
    """One agent that plays one episode."""

    async def run(self, task: vf.Task[Any, Any, Any], agents: vf.Agents) -> None:
        """Have the agent play."""
        await agents.agent.run(task)


def save_records(traces: str | Path, folder: str | Path) -> list[Path]:
    """Write the record of every rollout in verifiers' `traces.jsonl` to its own file, and return the files.

    A file is named by its task and the number of its rollout. An existing file, or traces without records, is a
    `TranscriptError`.
    """
    texts: dict[str, str] = {}
    for line in Path(traces).read_text(encoding="utf-8").splitlines():
        for trace in json.loads(line)["traces"]:
            if INFO in trace["info"]:
                name = trace["task"]["data"]["name"]
                rollout = sum(other.startswith(f"{name}.") for other in texts)
                texts[f"{name}.{rollout}.jsonl"] = trace["info"][INFO]["record"]
    if not texts:
        raise TranscriptError(f"{traces} holds no record of an episode; it has to be of smartplay_verifiers' tasks.")
    return write_records(texts, folder)
