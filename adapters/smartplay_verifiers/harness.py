"""SmartPlayHarness: this package's own loop, in the process of the evaluation.

verifiers asks of a harness only that every call of the model goes through its endpoint, which records the tokens that
training needs. So each prompt is exactly the window. A limit of verifiers' refuses the call that would exceed it; the
episode then ends as `host`, with the limit's name, and keeps its score.
"""

from __future__ import annotations

import asyncio
from typing import Any

import verifiers.v1 as vf

from smartplay_tools import Conversation, Episode, EpisodeResult, get_player
from smartplay_tools.players import ModelPlayer
from smartplay_tools.transcript import Event
from smartplay_verifiers.tasks import INFO, SmartPlayData, outcome

CANCELLED = "cancelled"
"""The detail of an episode that verifiers has cancelled."""


class SmartPlayHarnessConfig(vf.HarnessConfig):
    """The harness has no options: the taskset decides what is played."""

    id: str = "smartplay_verifiers"


class SmartPlayHarness(vf.Harness[SmartPlayHarnessConfig]):
    """Plays a task's episode with the model of the evaluation."""

    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    def new_episode(self, data: SmartPlayData, record: list[Event]) -> Episode:
        """Return the episode of a task. A harness of your own may make another one, with `record` as its transcript."""
        return data.episode(record)

    async def launch(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace[Any, Any],
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
    ) -> vf.ProgramResult:
        """Play the episode, and leave its reward, result and record in the trace."""
        task = trace.task.data
        assert isinstance(task, SmartPlayData), "this harness plays the tasks of SmartPlayTaskset only"
        events: list[Event] = []
        episode = await asyncio.to_thread(self.new_episode, task, events)
        own = {} if ctx.sampling.max_tokens is None else {"max_tokens": ctx.sampling.max_tokens}
        # One attempt for each call: verifiers retries what fails at the model's provider.
        player = get_player(f"openai:{ctx.model}", base_url=endpoint, api_key=secret, retries=0, parameters=own)
        assert isinstance(player, ModelPlayer)
        try:
            with episode:
                async with player:
                    await _play(episode, player, trace)
        finally:
            trace.info[INFO] = outcome(episode, task.reward, events)
        assert episode.result is not None
        return _program_result(episode.result)


async def _play(episode: Episode, player: ModelPlayer, trace: vf.Trace[Any, Any]) -> None:
    episode.refuse_pictures("verifiers")
    conversation = Conversation(episode, player=f"verifiers:{player.name.partition(':')[2]}")
    while (prompt := await conversation.aprompt()) is not None:
        try:
            reply = await player.areply(prompt)
        except asyncio.CancelledError:  # the limit of time, whose name verifiers notes afterwards
            episode.end("host", detail=CANCELLED)
            raise
        except Exception as error:
            if trace.stop_condition is None:
                conversation.give_up(error)
            else:
                episode.end("host", detail=trace.stop_condition)
            return
        await conversation.areceive(reply)


def _program_result(result: EpisodeResult) -> vf.ProgramResult:
    """A model that cannot be reached fails the rollout; every other end is one that is scored."""
    failed: Any = result.end_reason == "player_error"
    return vf.ProgramResult(exit_code=int(failed), stdout="", stderr=result.error or "")
