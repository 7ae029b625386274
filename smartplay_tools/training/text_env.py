"""TextEnv: an episode in the shape that trainers of language models expect, `reset` and `step` on messages.

    env = TextEnv("RockPaperScissorBasic-v0", budget=Budget(prompt_tokens=800, slack=0.5))
    messages, done = env.reset(seed=1_000_000), False
    while not done:
        messages, reward, done, info = env.step(policy(messages, env.tools))

The messages are the exact window, so a model is trained on what it will see under the budget. Many environments can be
stepped side by side, one forward pass of a model for all of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.conversation.base import AnyReply
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.tool_formats.schemas import schema
from smartplay_tools.training.factory import EpisodeFactory, RewardName
from smartplay_tools.types import Budget, Prompt
from smartplay_tools.types.messages import Message


class TextEnv:
    """One episode at a time of one game, for a policy that answers messages.

    Arguments:
        game: the id of a setting, or a `GameSpec` of your own.
        budget: what the policy sees and may spend.
        reward: "normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards. The rewards
            of an episode's steps sum up to it.
        records: a folder for the record of every episode.
        player: the policy's name, for the record.
        options: `Episode`'s other arguments, such as MESSENGER's `split="train"`.
    """

    def __init__(
        self,
        game: str | GameSpec,
        *,
        budget: Budget | None = None,
        reward: RewardName = "normalized",
        records: str | Path | None = None,
        player: str = "policy",
        **options: Any,
    ) -> None:
        self._factory = EpisodeFactory(game, budget=budget, reward=reward, records=records, **options)
        self._player = player
        self._talk: Conversation | None = None
        self._prompt: Prompt | None = None
        self._rewarded = 0.0

    @property
    def tools(self) -> list[dict[str, Any]]:
        """The tools, each a function of chat completions, as chat templates take them."""
        return [{"type": "function", "function": schema(tool, "json")} for tool in self._factory.tools]

    @property
    def episode(self) -> Episode:
        """The episode of the latest reset."""
        return self._conversation.episode

    def reset(self, seed: int) -> list[Message]:
        """Begin the episode of a seed, and return the messages of its first prompt."""
        self.close()
        self._talk = Conversation(self._factory.episode(seed), player=self._player)
        self._rewarded, self._prompt = 0.0, self._talk.prompt()
        return self._messages()

    def step(self, reply: AnyReply | str) -> tuple[list[Message], float, bool, dict[str, Any]]:
        """Take the reply to the latest messages; return the next messages, the reward, whether it is over, and facts.

        The reply is an assistant message in chat form, a `Reply`, or a text without calls. All its calls are played.
        The facts have `purpose` ("summary" if the next messages ask for one), `max_tokens`, the cap on the next reply,
        and at the end `result`, the `EpisodeResult`. A step after the end is an `InvalidArgumentError`.
        """
        talk = self._conversation
        if self._prompt is None:
            raise InvalidArgumentError("The episode is over; reset the environment.")
        talk.receive({"role": "assistant", "content": reply} if isinstance(reply, str) else reply)
        self._prompt = talk.prompt()
        before, self._rewarded = self._rewarded, self._factory.reward(talk.episode)
        return self._messages(), self._rewarded - before, self._prompt is None, self._facts()

    def close(self) -> None:
        """End the episode, if it is not over, and close its game."""
        if self._talk is not None:
            self._talk.episode.end("host", detail="The trainer has ended the rollout.")
            self._talk.episode.close()

    @property
    def _conversation(self) -> Conversation:
        if self._talk is None:
            raise InvalidArgumentError("The environment has not been reset yet.")
        return self._talk

    def _messages(self) -> list[Message]:
        return [] if self._prompt is None else list(self._prompt.messages)

    def _facts(self) -> dict[str, Any]:
        if self._prompt is None:
            return {"purpose": None, "max_tokens": None, "result": self.episode.result}
        return {"purpose": self._prompt.purpose, "max_tokens": self._prompt.max_tokens}
