"""SmartPlayHarness: OpenEnv's white-box harness, in which a trainer samples replies and each prompt is the window.

A trainer such as TRL's `AsyncGRPOTrainer` gives the harness a function that samples one reply. The loop around it is
that of an `AgentSession`, so budgets hold as in `smartplay_tools.play`. A limit of the trainer ends the episode as
`host`, with its name; calls of a message that are more than the trainer allows are refused in the host's name.
"""

from __future__ import annotations

from typing import Any, cast

from openenv.core.env_server.mcp_types import Tool
from openenv.core.harness import (
    HarnessAdapter,
    HarnessRolloutResult,
    HarnessRunLimits,
    ModelStep,
    ResourceSession,
    ResourceSessionFactory,
    ToolResult as OpenEnvResult,
    ToolTraceEntry,
    VerifyResult,
)

from smartplay_openenv.environment import tools_of
from smartplay_tools import AgentSession, Episode, InvalidArgumentError, Message, Prompt, Reply, ToolResult
from smartplay_tools.players import reply_in
from smartplay_tools.players.conversion import encodable, sendable
from smartplay_tools.training import EpisodeFactory, RewardName, reward_of


class SmartPlaySession(ResourceSession):
    """One rollout: an episode, and its reward."""

    def __init__(self, episode: Episode, reward: RewardName = "normalized") -> None:
        episode.refuse_pictures("OpenEnv")
        self.episode = episode
        self._reward: RewardName = reward

    def initial_messages(self) -> list[dict[str, Any]]:
        """Return the first messages of every prompt."""
        return [dict(message) for message in self.episode.head]

    def list_tools(self) -> list[Tool]:
        """Return the game's tools."""
        return tools_of(self.episode.tools)

    def call_tool(self, name: str, arguments: dict[str, Any]) -> OpenEnvResult:
        """Answer one call, for harnesses that manage the context themselves."""
        return _result(self.episode.call(name, arguments))

    def verify(self, transcript: list[dict[str, Any]], final_state: Any | None = None) -> VerifyResult:
        """End the episode, if the game has not ended it, and return its reward and its result."""
        self.close()
        assert self.episode.result is not None
        return VerifyResult(
            env_reward=reward_of(self.episode, self._reward),
            done=True,
            metrics=self.episode.result.model_dump(mode="json"),
        )

    def close(self) -> None:
        """End the episode. May be called twice."""
        self.episode.end("host", detail="The trainer has ended the rollout.")
        self.episode.close()


class SmartPlaySessions(EpisodeFactory, ResourceSessionFactory[SmartPlaySession]):
    """Makes the sessions of a game, each with an episode of the seed that the trainer asks for.

    Arguments:
        game: the id of a setting.
        budget: what the model sees and may spend.
        reward: "normalized", 1 is the human's score; "score"; or "return", the sum of the game's rewards.
        records: a folder for the record of every rollout, under its seed and episode id.
        options: `Episode`'s other arguments.
    """

    def create(self, task: Any, seed: int | None = None, episode_id: str | None = None) -> SmartPlaySession:
        """Return a session. A task that is a mapping with a `seed` has precedence over the trainer's seed."""
        chosen = task["seed"] if isinstance(task, dict) and "seed" in task else seed
        if chosen is None:
            raise InvalidArgumentError("A rollout needs a seed: the trainer's, or that of a task with a `seed`.")
        return SmartPlaySession(self.episode(int(chosen), episode_id), self._reward)


class SmartPlayHarness(HarnessAdapter):
    """Plays the episode of a `SmartPlaySession` with the replies that a trainer samples.

    `player` is the player's name, for the record.
    """

    def __init__(self, player: str = "openenv") -> None:
        self._player = player

    def run_white_box(
        self, model_step: ModelStep, session: ResourceSession, limits: HarnessRunLimits | None = None
    ) -> HarnessRolloutResult:
        """Play the episode to its end, or to a limit."""
        if not isinstance(session, SmartPlaySession):
            raise InvalidArgumentError("SmartPlayHarness plays the sessions of SmartPlaySessions only.")
        return _Rollout(session, model_step, limits or HarnessRunLimits(), self._player).play()

    def run_black_box(self, session: ResourceSession, limits: HarnessRunLimits | None = None) -> HarnessRolloutResult:
        """Refuse: a harness that samples for itself is a player; use `smartplay_tools.play`."""
        raise InvalidArgumentError("SmartPlayHarness has no model; use run_white_box, or smartplay_tools.play.")


class _Rollout:
    """One run of the harness."""

    def __init__(self, session: SmartPlaySession, model_step: ModelStep, limits: HarnessRunLimits, player: str) -> None:
        self._episode, self._tools = session.episode, session.list_tools()
        self._model_step, self._limits = model_step, limits
        self._agent = AgentSession(session.episode, player=player, summaries=True)
        self._trace: list[ToolTraceEntry] = []
        self._turns = 0

    def play(self) -> HarnessRolloutResult:
        while not self._is_at_a_limit() and (step := self._agent.ask(self._sample)) is not None:
            self._turns += 1
            for position, call in enumerate(self._agent.receive(step.message)):
                allowed = self._may_call(position)
                result = (
                    self._agent.answer(call.id)
                    if allowed
                    else self._agent.refuse(call.id, self._episode.words("too_many_calls"))
                )
                self._trace.append(ToolTraceEntry(call.name, dict(call.arguments.values or {}), _result(result)))
        return HarnessRolloutResult(
            messages=[encodable(message) for turn in self._agent.turns for message in turn.messages],
            tool_trace=self._trace,
            done=True,
            metrics={"turns": self._turns, "tool_calls": len(self._trace)},
        )

    def _sample(self, prompt: Prompt) -> Reply:
        sampling = prompt.settings(self._limits.sampling)
        # What the record keeps as it was said may have half a character, which a request cannot.
        messages = [dict(sendable(message)) for message in prompt.messages]
        try:
            step = self._model_step(messages, self._tools if prompt.tools else [], sampling)
        except Exception as error:
            return reply_in(error)
        return Reply(cast(Message, step.response.to_message_dict()))

    def _is_at_a_limit(self) -> bool:
        """Whether a limit of the trainer ends the episode here."""
        most = self._limits.max_total_tool_calls
        if self._turns == self._limits.max_turns:
            self._episode.end("host", detail="max_turns")
        elif most is not None and len(self._trace) >= most:
            self._episode.end("host", detail="max_total_tool_calls")
        return self._episode.done

    def _may_call(self, position: int) -> bool:
        """Whether the trainer's limits allow the next call of a message."""
        in_turn, in_all = self._limits.max_tool_calls_per_turn, self._limits.max_total_tool_calls
        return (in_turn is None or position < in_turn) and (in_all is None or len(self._trace) < in_all)


def _result(result: ToolResult) -> OpenEnvResult:
    error = result.text if result.is_error else None
    return OpenEnvResult(data=result.text, done=result.done, metadata=dict(result.data), error=error)
