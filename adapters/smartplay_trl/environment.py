"""`environment`: the class whose instances `GRPOTrainer` makes, one for each rollout of a batch, and uses again.

The trainer looks for the tools on the class: every public method but `reset` and `get_reward` is one, described by its
annotations and docstring. The description of `act` lists the game's actions, so each game has its own class.

`rows` are the rows of the dataset: prompts of the head's own messages, as exported rows have them, so that a model
that was trained on those knows what it sees.

The model calls the tools in a conversation of the trainer's, so the host manages the context: `observe` shows the
history, and limits on prompts do not apply. A rollout ends when the model stops calling tools or the trainer stops it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

from smartplay_tools import Budget, Episode, InvalidArgumentError, Message
from smartplay_tools.training import EpisodeFactory, RewardName
from smartplay_tools.types.messages import text_of


class GameEnvironment:
    """The environment of one rollout at a time. `environment` makes the subclass for a game, which has the tools.

    Public methods would be tools, so there are no others.
    """

    _factory: ClassVar[EpisodeFactory]

    def __init__(self) -> None:
        self.episode: Episode | None = None
        """The episode of the latest rollout."""

    def reset(self, *, seed: int | None = None, prompt: Any = None, **row: Any) -> str | None:
        """Begin the episode of a row's column `seed`. The rollouts of a group share a row, hence a seed.

        A prompt of `rows` is complete. To any other prompt the trainer appends what is returned, the game's first
        messages as one text.
        """
        if seed is None:
            raise InvalidArgumentError("The dataset needs a column `seed`: the seed of each row's episode.")
        self._close()
        self.episode = self._factory.episode(int(seed))
        self.episode.refuse_pictures("TRL")
        if _is_complete(prompt, self.episode.head):
            return None
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


def rows(
    game: str,
    seeds: Iterable[int],
    *,
    context: Literal["window", "host"] = "window",
    budget: Budget | None = None,
    **options: Any,
) -> dict[str, list[Any]]:
    """Return the columns of a dataset for `environment`, with a row for every seed: `Dataset.from_dict(rows(...))`.

    Arguments:
        game: the id of a setting.
        seeds: the seeds of the episodes.
        context: whose system message the prompts have. "window": the one with which the records of a window were
            played, and what is exported from them; "host": the one of episodes whose host manages the context, which
            does not say that anything will leave the view.
        budget: the one of the environment; with `manual="pinned"` it decides where the manual is cut.
        options: the other arguments of `environment`, as far as they are `Episode`'s.
    """
    factory = EpisodeFactory(game, budget=budget, reward="return", context=context, **options)
    columns: dict[str, list[Any]] = {"prompt": [], "seed": []}
    for seed in seeds:
        with factory.episode(seed) as episode:
            columns["prompt"].append([{"role": m["role"], "content": text_of(m)} for m in episode.head])
        columns["seed"].append(seed)
    return columns


def tools_as_text(made: type[GameEnvironment]) -> str:
    """Return the tools of an environment class as `GRPOTrainer` describes them to its model, as JSON text.

    The trainer describes them by their methods, in alphabetical order and without what their schemas forbid. A model
    that is first trained on exported rows sees the same tools in both if this text is the column `tools` of the rows.
    """
    from transformers.utils.chat_template_utils import get_json_schema

    names = sorted(function.__name__ for function in _tools())
    return json.dumps([get_json_schema(getattr(made, name)) for name in names])


def _is_complete(prompt: Any, head: Sequence[Message]) -> bool:
    """Whether a row's prompt has the game's first messages, whoever manages the context."""
    if not isinstance(prompt, list) or len(prompt) < len(head):
        return False
    opening = text_of(head[0]).partition("\n\n")[0]
    return bool(prompt[0]["role"] == "system" and str(prompt[0]["content"]).startswith(opening))


def _tools() -> tuple[Callable[..., str], ...]:
    """New methods for a class, in the order of `Episode.functions`."""

    def observe(self: GameEnvironment) -> str:
        return self._answer("observe", {})

    def act(self: GameEnvironment, action: str) -> str:
        return self._answer("act", {"action": action})

    def read_manual(self: GameEnvironment) -> str:
        return self._answer("read_manual", {})

    return observe, act, read_manual
