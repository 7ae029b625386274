"""EpisodeFactory: the episodes of one game that a training framework asks for, seed by seed, and their rewards.

The reward of an episode is one of three (`RewardName`), the same in every training framework.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args
from uuid import uuid4

from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.types import Budget

RewardName = Literal["normalized", "score", "return"]
"""The score on the scale where 0 is the worst and 1 the human's, the score itself, or the sum of the game's rewards."""


def reward_of(episode: Episode, reward: RewardName) -> float:
    """Return an episode's reward so far; `InvalidArgumentError` if its score has no normalised form."""
    check_choice("reward", reward, get_args(RewardName))
    progress = episode.progress
    match reward:
        case "score":
            return float(progress.score)
        case "return":
            return float(progress.reward)
    if progress.normalized_score is None:
        raise InvalidArgumentError(
            f"{episode.spec.id} has no human score here, so its score is not normalised; "
            'use reward="score" or reward="return".'
        )
    return float(progress.normalized_score)


NAME = re.compile(r"[\w .+=@#-]{0,100}", re.ASCII)
"""What names the record of an episode. It may come from the network, so it leads to no other folder."""


class EpisodeFactory:
    """Makes episodes that differ only in their seeds, and rewards them.

    A mistake in the arguments is reported here, before anything is played.

    Arguments:
        game: the id of a setting, or a `GameSpec` of your own.
        budget: what the model sees and may spend.
        reward: "normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards.
        records: a folder for the record of every episode.
        options: `Episode`'s other arguments.
    """

    def __init__(
        self,
        game: str | GameSpec,
        *,
        budget: Budget | None = None,
        reward: RewardName = "normalized",
        records: str | Path | None = None,
        **options: Any,
    ) -> None:
        self._new = partial(Episode, game, budget=budget, **options)
        self._reward: RewardName = reward
        self._records = None if records is None else Path(records)
        with self.sample() as sample:
            reward_of(sample, reward)
            self._config, self.game, self.tools = sample.config, sample.spec.id, sample.tools

    def sample(self) -> Episode:
        """Return an episode that is not recorded, to look at."""
        return self._new(seed=0)

    def config(self, seed: int) -> EpisodeConfig:
        """Return the config of a seed's episode, for frameworks that carry tasks as data."""
        return self._config.model_copy(update={"seed": seed})

    def episode(self, seed: int, name: str | None = None) -> Episode:
        """Return the episode of a seed; its record is `SEED.NAME.jsonl`, by default with a random name."""
        record = None if self._records is None else self._records / f"{seed}.{_checked(name) or uuid4().hex}.jsonl"
        return self._new(seed=seed, transcript=record)

    def reward(self, episode: Episode) -> float:
        """Return the reward of an episode so far."""
        return reward_of(episode, self._reward)


def _checked(name: str | None) -> str | None:
    """Return the name of a record; `InvalidArgumentError` for one that is not part of a file's name."""
    if name is not None and NAME.fullmatch(name) is None:
        raise InvalidArgumentError(
            f"The id of an episode is part of its record's name, so {name[:100]!r} cannot be one: it has up to 100 "
            "letters, digits, spaces and . _ + = @ # -."
        )
    return name
