"""The solver: a `Conversation` that asks Inspect's model, until the game, a budget or an Inspect limit ends it.

Inspect's ready agents have no hook that could show a model an exact window (they compact a history that is too long),
so the loop is this package's and only the model is Inspect's. A live episode cannot be kept in Inspect's store, which
holds JSON: it is kept in the solver, and its result and record are stored when it ends, however it ends.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any, TypeVar

import anyio.to_thread
from inspect_ai.model import GenerateConfig, Model, get_model
from inspect_ai.model._generate_config import active_generate_config  # no public name; tried with 0.3.285
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.tool import ToolDef
from inspect_ai.util import LimitExceededError, StoreModel, sample_limits, store_as
from pydantic import Field

from smartplay_inspect.messages import InspectChat, from_output, tool_infos
from smartplay_tools import Conversation, Episode, EpisodeConfig, Prompt
from smartplay_tools.errors import PromptRefusedError
from smartplay_tools.players import BrokenAnswerError, left_to_provider, reply_in
from smartplay_tools.players.conversion import check_names, with_pictures_below
from smartplay_tools.providers.cache_fields import openai_cache_fields
from smartplay_tools.transcript import Event

T = TypeVar("T")

NewEpisode = Callable[[TaskState, list[Event]], Episode]


class Played(StoreModel):
    """What is kept of a sample's episode in Inspect's store."""

    attempt: str = ""
    """The id of the attempt at the sample."""
    seed: int = 0
    """The episode's seed."""
    result: dict[str, Any] = Field(default_factory=dict)
    """The `EpisodeResult`."""
    record: str = ""
    """The record, the text of a JSON Lines file that `smartplay-tools replay` reads."""


@solver
def smartplay_agent(new_episode: NewEpisode | None = None, *, pictures: bool = False) -> Solver:
    """Play the episode that a sample's metadata configures (`config`) with the model of the evaluation.

    An Inspect limit ends the episode as `host`, with the limit's name as its detail, and the score so far counts.
    For tasks of your own, `new_episode` makes the episode of a sample: it gets the sample's state, and a list for the
    record, which it may pass to the episode as its transcript. `pictures` says that the model sees pictures; an episode
    whose observations are pictures is refused without it.
    """
    make = new_episode or _configured

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        events: list[Event] = []
        episode = await _in_thread(lambda: make(state, events))
        played = store_as(Played)
        played.attempt, played.seed = state.uuid, episode.config.seed
        try:
            with episode:
                if not pictures:
                    episode.refuse_pictures("Inspect", has_option=True)
                check_names(((ToolDef(tool).name, tool) for tool in state.tools), {t.name: t for t in episode.tools})
                await _play(state, episode)
        finally:
            if episode.result is not None:
                played.result = episode.result.model_dump(mode="json")
            played.record = "".join(json.dumps(event) + "\n" for event in events)
        return state

    return solve


def _configured(state: TaskState, record: list[Event]) -> Episode:
    return Episode.from_config(EpisodeConfig(**state.metadata["config"]), transcript=record)


async def _play(state: TaskState, episode: Episode) -> None:
    model = get_model()
    conversation = await _in_thread(lambda: Conversation(episode, player=f"inspect:{model}"))
    try:
        await _converse(state, conversation, model)
    except LimitExceededError as limit:
        episode.end("host", detail=f"{limit.type}_limit")
        raise
    except anyio.get_cancelled_exc_class():
        episode.end("host", detail=_cancelled_by())
        raise
    except PromptRefusedError as error:
        conversation.give_up(error)
    except Exception as error:
        episode.end("player_error", error)
        raise


async def _converse(state: TaskState, conversation: Conversation, model: Model) -> None:
    episode = conversation.episode
    chat, tools = InspectChat(str(model)), tool_infos(episode.tools)
    own = model.config.merge(active_generate_config())
    state.messages = chat.write(episode.head)
    takes_pictures_in_results = model.api.tool_result_images()
    while (prompt := await _in_thread(conversation.prompt)) is not None:
        # Inspect would put them below itself, but between two results if the second has none.
        sent = prompt if takes_pictures_in_results else with_pictures_below(prompt)
        # Not the tool choice: with "none", which a summary asks for, Inspect would leave out the tools we count.
        cap = prompt.settings({"max_tokens": own.max_tokens}).get("max_tokens")
        config = GenerateConfig(max_tokens=cap, extra_body=_with_cache_key(own, prompt, model))
        offered = tools if prompt.tools else []
        try:
            output = await model.generate(chat.write(sent.messages, sent.pictures), offered, config=config)
            if output.stop_reason == "model_length" and output.usage is None:  # Inspect's form of a refused prompt
                raise BrokenAnswerError(output.completion, body={"code": "context_length_exceeded"})
            reply = from_output(output)
            reply = dataclasses.replace(reply, usage=left_to_provider(reply.usage, own.extra_body))
            state.output = output
        except LimitExceededError:
            raise
        except Exception as error:
            reply, output = reply_in(error), None
        await _in_thread(lambda reply=reply: conversation.receive(reply))  # type: ignore[misc]
        if prompt.purpose != "play":
            continue  # no turn of the conversation: the log has it as an event of the model
        turn = conversation.latest_turn
        assert turn is not None
        if output is not None:
            chat.remember(turn.shown, output.message)
        state.messages.extend(chat.write(turn.messages, conversation.pictures))


def _with_cache_key(own: GenerateConfig, prompt: Prompt, model: Model) -> dict[str, Any] | None:
    """The fields of a request that Inspect has no names for: for OpenAI, the key of prompts that belong together.

    Inspect marks prompts for Anthropic's cache itself, and cannot mark the results of calls, where a prompt's stable
    part ends. Its option `cache_prompt=False` turns off marks and key.
    """
    client = getattr(model.api, "client", None)
    fields = openai_cache_fields(model.name, str(getattr(client, "base_url", "")))
    if own.cache_prompt is False or not fields.key or isinstance(getattr(model.api, "prompt_cache_key", None), str):
        return own.extra_body
    return {"prompt_cache_key": prompt.cache_key, **(own.extra_body or {})}


def _cancelled_by() -> str:
    """The name of the limit whose clock has run out; Inspect delivers those as a cancellation."""
    limits = sample_limits()
    for name in ("time", "working"):
        remaining = getattr(limits, name).remaining
        if remaining is not None and remaining <= 0:
            return f"{name}_limit"
    return "cancelled"


async def _in_thread(function: Callable[[], T]) -> T:
    """Run a step of the episode away from the event loop, asyncio's or trio's."""
    return await anyio.to_thread.run_sync(function)
