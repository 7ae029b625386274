"""`environment`: the class whose instances `GRPOTrainer` makes, one for each rollout of a batch, and uses again.

The trainer looks for the tools on the class: every public method but `reset` and `get_reward` is one, described by its
annotations and docstring. The description of `act` lists the game's actions, so each game has a class of its own.

The model calls the tools in a conversation of the trainer's, so the host manages the context: `observe` shows the
history, and limits on prompts do not apply. A rollout ends when the model stops calling tools or the trainer stops it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from smartplay_tools import Budget, Episode, InvalidArgumentError
from smartplay_tools.episode import EpisodeFactory, RewardName
from smartplay_tools.messages import text_of


class GameEnvironment:
    """The environment of one rollout at a time. `environment` makes the subclass for a game, which has the tools.

    Public methods would be tools, so there are no others.
    """

    _factory: ClassVar[EpisodeFactory]

    def __init__(self) -> None:
        self.episode: Episode | None = None
        """The episode of the latest rollout."""

    def reset(self, *, seed: int | None = None, **row: Any) -> str:
        """Begin the episode of a row's column `seed` and return its first messages as text.

        The trainer appends the text to the row's prompt. The rollouts of a group share a row, hence a seed.
        """
        if seed is None:
            raise InvalidArgumentError("The dataset needs a column `seed`: the seed of each row's episode.")
        self._close()
        self.episode = self._factory.episode(int(seed))
        return "\n\n".join(text_of(message) for message in self.episode.head)

    def get_reward(self) -> float:
        """End the episode, if the game has not ended it, and return its reward."""
        episode = self._close()
        assert episode is not None, "a reward is asked for before the first reset"
        return self._factory.reward(episode)

    def _answer(self, name: str, arguments: dict[str, str]) -> str:
        assert self.episode is not None, "a tool is called before the first reset"
        return self.episode.call(name, arguments).text

    def _close(self) -> Episode | None:
        if self.episode is not None:
            self.episode.end("host", detail="The trainer has ended the rollout.")
            self.episode.close()
        return self.episode


def environment(
    game: str,
    *,
    budget: Budget | None = None,
    reward: RewardName = "normalized",
    records: str | Path | None = None,
    **options: Any,
) -> type[GameEnvironment]:
    """Return the environment class of a game, for `GRPOTrainer(environment_factory=...)`.

    Arguments:
        game: the id of a setting.
        budget: what a rollout may spend; here `history`, `result_tokens` and `tool_calls` are enforced.
        reward: "normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards.
        records: a folder for the record of every rollout, from which it can be replayed.
        options: `Episode`'s other arguments: `engine`, `manual`, `batch`, `tokenizer`, and the game's own.
    """
    factory = EpisodeFactory(game, budget=budget, reward=reward, records=records, context="host", **options)
    members: dict[str, Any] = {"__doc__": f"The environment of {game}.", "_factory": factory}
    with factory.sample() as sample:
        functions = sample.functions()
    for method, function in zip(_tools(), functions, strict=True):
        # What the schema of a tool is made of; `self` must have no annotation.
        method.__doc__, method.__annotations__ = function.__doc__, function.__annotations__
        members[function.__name__] = method
    return type(f"SmartPlay{re.sub(r'[^0-9a-zA-Z]', '', game)}", (GameEnvironment,), members)


def _tools() -> tuple[Callable[..., str], ...]:
    """New methods for a class, in the order of `Episode.functions`."""

    def observe(self: GameEnvironment) -> str:
        return self._answer("observe", {})

    def act(self: GameEnvironment, action: str) -> str:
        return self._answer("act", {"action": action})

    def read_manual(self: GameEnvironment) -> str:
        return self._answer("read_manual", {})

    return observe, act, read_manual
