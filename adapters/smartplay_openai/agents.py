"""OpenAI's Agents SDK: `SmartPlayModel` plays an episode with a model of the SDK, in agents of the SDK.

    from agents import Agent, OpenAIResponsesModel, Runner
    from smartplay_openai.agents import SmartPlayModel

    model = SmartPlayModel(OpenAIResponsesModel("gpt-4o-mini", client), episode)
    await Runner.run(Agent("player", model=model, tools=model.tools), [], max_turns=None, run_config=model.run_config)

`SmartPlayModel` wraps the model that the runner calls. It replaces the runner's input by the window of one
`AgentSession`, and its tools play the calls when the runner runs them, so that approvals and guardrails come before a
move. The SDK's own hook for windows, a filter of the model's input, sees no reply, so it could neither record nor
charge one, nor answer calls to unknown tools.

The functions convert the runner's items to canonical messages, and prompts to items.
"""

from __future__ import annotations

import asyncio
import dataclasses
import itertools
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openai.agents", "agents"):
    from agents import (
        FunctionTool,
        Model,
        ModelResponse,
        ModelSettings,
        OpenAIChatCompletionsModel,
        OpenAIResponsesModel,
        RunConfig,
        Tool,
        ToolExecutionConfig,
    )
    from agents.tool_context import ToolContext
    from agents.usage import Usage as AgentsUsage
    from openai.types.responses import (
        Response,
        ResponseCompletedEvent,
        ResponseFunctionToolCall,
        ResponseOutputMessage,
        ResponseOutputText,
        ResponseUsage,
    )

from smartplay_openai.fitting import offered, refuse_stored
from smartplay_tools import AgentSession, Episode, InvalidArgumentError, Message, Prompt, Reply, ToolSpec, Usage
from smartplay_tools.conversation import HostChat, HostHistory
from smartplay_tools.players import left_to_provider, reply_in
from smartplay_tools.players.conversion import check_names, with_pictures_below
from smartplay_tools.players.wire import RESPONSES, read_items
from smartplay_tools.providers.cache_fields import CacheFields, openai_cache_fields
from smartplay_tools.providers.caps import cap_at
from smartplay_tools.types.messages import Call, text_of, words_of

Item = Mapping[str, Any]

OVER = "smartplay_over"
"""The id of the message that ends a run."""


def before_the_game(items: Sequence[Item], ours: set[str]) -> list[Message]:
    """The messages that a run begins with; an earlier episode in the same session of the SDK is left out."""
    begin = 0
    for at, item in enumerate(items):
        if item.get("id") == OVER or item.get("name") in ours:
            begin = at + 1
    while begin < len(items) and (items[begin].get("type") == "function_call_output"):
        begin += 1
    return RESPONSES.read({"input": list(items[begin:])}).messages if begin < len(items) else []


def since_reply(items: Sequence[Item], first_call: str) -> list[Message]:
    """The results and the user messages after the latest reply's first call, read from the end."""
    for at in range(len(items) - 1, -1, -1):
        if items[at].get("type") == "function_call" and items[at].get("call_id") == first_call:
            return [message for item in items[at + 1 :] for message in _from_item(item)]
    raise InvalidArgumentError(
        "The runner's input has no trace of the model's latest reply. The window decides what a model sees: leave out "
        "input filters and nested histories of handoffs, and go on with the items of the run."
    )


def has_calls(items: Sequence[Item]) -> bool:
    """Whether there is any call of a tool among the items of a run."""
    return any(item.get("type") == "function_call" for item in items)


def known_by(item: Item) -> tuple[Any, str]:
    """Return what tells an item from others, and its text."""
    text, _ = words_of(item.get("output", item.get("content", item.get("arguments"))))
    return (item.get("type"), item.get("role"), item.get("call_id"), text), text


def _from_item(item: Item) -> list[Message]:
    if item.get("type") == "function_call_output":
        return [{"role": "tool", "tool_call_id": item["call_id"], "content": item.get("output")}]
    return [{"role": "user", "content": _text(item["content"])}] if item.get("role") == "user" else []


def input_of(prompt: Prompt, *, mark: bool) -> list[Any]:
    """The prompt as input items. The SDK's converter knows an output without an id only as a plain message."""
    return [
        {"role": item["role"], "content": _text(item["content"])}
        if item.get("type") == "message" and item.get("role") == "assistant" and "id" not in item
        else item
        for item in RESPONSES.conversation(prompt, mark=mark)["input"]
    ]


def read_response(response: ModelResponse) -> Message:
    """A reply in canonical form."""
    return read_items([item.model_dump(exclude_unset=True) for item in response.output])


def _text(content: Any) -> str:
    """The text of a message; parts that are not text are an `InvalidArgumentError`."""
    return content if isinstance(content, str) else text_of({"content": content})


def usage_of(usage: AgentsUsage) -> Usage | None:
    """The usage of a reply; None if the provider has reported none."""
    if not usage.input_tokens and not usage.output_tokens:
        return None
    return Usage(
        prompt=usage.input_tokens,
        reply=usage.output_tokens,
        cached=usage.input_tokens_details.cached_tokens or 0,
        written=getattr(usage.input_tokens_details, "cache_write_tokens", None) or 0,
        reasoning=usage.output_tokens_details.reasoning_tokens or 0,
        requests=usage.requests,
    ).checked(usage.total_tokens)


def calls_in(response: ModelResponse) -> list[ResponseFunctionToolCall]:
    """The calls of a response."""
    return [item for item in response.output if isinstance(item, ResponseFunctionToolCall)]


def last_words(text: str, usage: AgentsUsage) -> ModelResponse:
    """Return words that end the agent's run, and that the model has not said."""
    content = ResponseOutputText(text=text, type="output_text", annotations=[])
    message = ResponseOutputMessage(id=OVER, content=[content], role="assistant", status="completed", type="message")
    return ModelResponse(output=[message], usage=usage, response_id=None)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Answer(Reply):
    """A reply and the response of the model that it was read from."""

    response: ModelResponse


class SmartPlayModel(Model):
    """A model that plays one episode.

    Arguments:
        model: the model of the SDK that is to play.
        episode: a fresh episode whose context is "window"; or, to go on with an episode from its record, the session
            of `smartplay_tools.resume(record, session=True)`.
        player: the model's name, for the record.
        cache: send to OpenAI the episode's `prompt_cache_key`, unless the settings have one, and mark the end of what
            is unchanged since the previous prompt for models that cache up to marks. Other servers are sent neither.
        pictures: whether the model sees pictures; without it, an episode whose observations are pictures is refused.

    Pass its `tools` to the agent and to each agent that takes over from it, and its `run_config` to the runner. A reply
    without a call is answered here, so the run ends when the episode does.
    """

    def __init__(
        self,
        model: Model,
        episode: Episode | AgentSession,
        *,
        player: str = "agents",
        cache: bool = True,
        pictures: bool = False,
    ) -> None:
        self._chat = HostChat(episode, player=player, pictures=pictures)
        self.episode = self._chat.episode
        self.tools: list[Tool] = [self._tool(spec) for spec in self.episode.tools]
        self.run_config = RunConfig(
            tool_execution=ToolExecutionConfig(max_function_tool_concurrency=1),
            tool_not_found_behavior="return_error_to_model",
        )
        self._names = {tool.name for tool in self.episode.tools}
        self._plays = {tool.name: tool.on_invoke_tool for tool in self.tools if isinstance(tool, FunctionTool)}
        self._history = HostHistory[Item](self.episode.counter, known_by)
        self._handoffs: frozenset[str] = frozenset()
        """The names of the latest request's handoffs."""
        self._latest: ModelResponse | None = None
        """The response of the latest reply, unless it was returned twice."""
        self._model, self._player, self._cache = model, player, cache

    @property
    def session(self) -> AgentSession | None:
        """The session of the episode; None before the first prompt."""
        return self._chat.session

    async def get_response(
        self,
        system_instructions: str | None,
        input: str | list[Any],  # noqa: A002
        model_settings: ModelSettings,
        tools: list[Tool],
        output_schema: Any = None,
        handoffs: Sequence[Any] = (),
        *arguments: Any,
        **options: Any,
    ) -> ModelResponse:
        """Call the model with the window as its input; when the episode is over, reply so without calling it.

        Where the window owes a summary, the model is called for it first; the runner sees its usage, not its text. An
        agent that runs in a tool of this one is answered in words.
        """
        items = [{"role": "user", "content": input}] if isinstance(input, str) else input
        if self._is_asked_by_sub_agent(items):
            return last_words(self.episode.words("sub_agent"), AgentsUsage())
        _check(output_schema, options)
        if (unseen := self._unseen_response(items)) is not None:
            return unseen
        session = await asyncio.to_thread(self._prepare, system_instructions, items, self._foreign(tools, handoffs))
        usage = AgentsUsage()

        async def send(prompt: Prompt) -> _Answer:
            fields = _cache_fields(self._model) if self._cache else CacheFields()
            settings = _settings(model_settings, prompt, _limit_field(self._model), with_key=fields.key)
            shown = prompt if isinstance(self._model, OpenAIResponsesModel) else with_pictures_below(prompt)
            items = input_of(shown, mark=fields.marks)
            offered = (tools, list(handoffs)) if prompt.tools else ([], [])
            try:
                response = await self._model.get_response(
                    None, items, settings, offered[0], output_schema, offered[1], *arguments, **options
                )
            except Exception as error:
                reply, nothing = reply_in(error), ModelResponse(output=[], usage=AgentsUsage(), response_id=None)
                return _Answer(reply.message, reply.usage, response=nothing)
            usage.add(response.usage)
            reported = left_to_provider(usage_of(response.usage), vars(settings))
            return _Answer(read_response(response), reported, response=response)

        self._handoffs = frozenset(handoff.tool_name for handoff in handoffs)
        while (answer := await session.aask(send)) is not None:
            self._latest = answer.response
            calls = await session.areceive(answer)
            response = self._for_runner(answer.response, calls)
            if shown := calls_in(response):
                self._note_handoff(session, shown)
                return dataclasses.replace(response, usage=usage)
            self._answer_unknown(())
        return last_words("The episode is over.", usage)

    def _unseen_response(self, items: Sequence[Item]) -> ModelResponse | None:
        """Return the latest response once more to a run without it: one that began when another had been cancelled.

        Calls that were played give their recorded results again. Those of other tools could be run twice.
        """
        session, latest = self._chat.session, self._latest
        if latest is None or session is None or session.awaits_reply or self.episode.done:
            return None
        turn = session.latest_turn
        assert turn is not None
        ids, foreign = {call.id for call in turn.calls}, {tool.name for tool in session.foreign_tools}
        response = self._for_runner(latest, turn.calls)
        has_foreign = any(call.name in foreign for call in turn.calls)
        if has_foreign or not calls_in(response) or any(item.get("call_id") in ids for item in items):
            return None
        self._chat.refuse_late_words(before_the_game(items, self._names))
        self._latest = None
        return dataclasses.replace(response, usage=AgentsUsage())

    def _note_handoff(self, session: AgentSession, calls: Sequence[ResponseFunctionToolCall]) -> None:
        """Take note of a handoff: the other agent may have another model, which does not play."""
        if used := [call.name for call in calls if call.name in self._handoffs]:
            session.halt(f"The agent handed over with {used[0]}, and this model was not asked again.")

    def _is_asked_by_sub_agent(self, items: Sequence[Item]) -> bool:
        """Whether this is the request of an agent in one of the agent's tools: its run has no call yet.

        After a handoff, whose call is just as open, an input without calls comes from a filter.
        """
        session = self._chat.session
        if session is None or self.episode.done or session.awaits_reply or session.latest_turn is None:
            return False
        foreign = {tool.name for tool in session.foreign_tools} - self._handoffs
        answered = {item.position for item in session.latest_turn.items}
        calls = enumerate(session.latest_turn.calls)
        waits = any(call.name in foreign for position, call in calls if position not in answered)
        return waits and not has_calls(items)

    def _for_runner(self, response: ModelResponse, calls: Sequence[Call]) -> ModelResponse:
        """Return a response with the call ids of the session."""
        ids = iter([call.id for call in calls])
        output = [
            item.model_copy(update={"call_id": next(ids)}) if isinstance(item, ResponseFunctionToolCall) else item
            for item in response.output
        ]
        return dataclasses.replace(response, output=output)

    async def stream_response(self, *arguments: Any, **options: Any) -> AsyncIterator[Any]:
        """Ask the model as `get_response` does, for a streamed run; the stream has one event, the whole response."""
        response = await self.get_response(*arguments, **options)
        usage = response.usage
        reported = ResponseUsage(
            input_tokens=usage.input_tokens,
            input_tokens_details=usage.input_tokens_details,
            output_tokens=usage.output_tokens,
            output_tokens_details=usage.output_tokens_details,
            total_tokens=usage.total_tokens,
        )
        whole = Response.model_construct(
            id="smartplay",
            object="response",
            output=response.output,
            usage=reported if usage.requests else None,  # the runner counts a request for each usage
            created_at=0,
            model=self._player,
        )
        yield ResponseCompletedEvent.model_construct(response=whole, sequence_number=0, type="response.completed")

    def _foreign(self, tools: Sequence[Tool], handoffs: Sequence[Any]) -> list[ToolSpec]:
        """The agent's other tools and its handoffs, which are tools to the model; all of them are counted."""
        for tool in tools:
            if not isinstance(tool, FunctionTool) or tool.defer_loading:
                raise InvalidArgumentError(
                    f"What the tool {tool.name!r} adds to a prompt cannot be counted, because the provider runs or "
                    "loads it; an agent that plays has function tools and handoffs only."
                )
        if not self._names <= {tool.name for tool in tools}:
            raise InvalidArgumentError(
                "An agent that plays has the game's tools: pass `tools=[*model.tools, ...]` to every agent with this "
                "model."
            )
        specs = offered(tools, handoffs)
        plays = [*(tool.on_invoke_tool for tool in tools if isinstance(tool, FunctionTool)), *handoffs]
        check_names(zip((spec.name for spec in specs), plays, strict=True), self._plays)
        return [spec for spec in specs if spec.name not in self._names]

    def _prepare(self, instructions: str | None, items: Sequence[Item], foreign: Sequence[ToolSpec]) -> AgentSession:
        """Begin the session, or take over what has happened since the latest reply."""
        chat = self._chat
        system: list[Message] = [{"role": "system", "content": instructions}] if instructions else []
        if chat.session is None:
            first = before_the_game(items, self._names)
            return chat.begin(first, system=system, foreign_tools=foreign)
        if self.episode.done:
            return chat.session
        if chat.session.awaits_reply:
            chat.refuse_late_words(before_the_game(items, self._names))
        if not has_calls(items):
            self._history.begin_again()  # a run that begins anew
        turn = chat.session.latest_turn
        if turn is not None and turn.calls and not chat.session.awaits_reply:
            messages = since_reply(items, turn.calls[0].id)
            self._answer_unknown(messages)
            chat.hear(messages)
        self._history.see(items)
        chat.change(system=system, foreign_tools=foreign)
        return chat.session

    def _answer_unknown(self, messages: Sequence[Message]) -> None:
        """Decide the calls of the latest reply; the SDK's own words about unknown tools are not the game's."""
        session = self._chat.session
        assert session is not None
        assert session.latest_turn is not None
        names = {tool.name for tool in (*self.episode.tools, *session.foreign_tools)}
        unknown = {call.id: None for call in session.latest_turn.calls if call.name not in names}
        self._chat.settle(messages, play=unknown)

    def _tool(self, spec: ToolSpec) -> FunctionTool:
        async def invoke(context: ToolContext[Any], _: str) -> str:
            execution = context.run_config.tool_execution if context.run_config is not None else None
            if execution is None or execution.max_function_tool_concurrency != 1:
                raise InvalidArgumentError(
                    "Calls are played in the order of the message: pass `run_config=model.run_config` to the runner, "
                    "or set `tool_execution=ToolExecutionConfig(max_function_tool_concurrency=1)` in your own."
                )
            return await self._play(context.tool_call_id)

        return FunctionTool(spec.name, spec.description, dict(spec.parameters), invoke)

    async def _play(self, call_id: str) -> str:
        """Play a call. The runner runs calls in their order, so earlier ones that are open were not run.

        They await approval, or a guardrail has rejected them; the runner's next input has the guardrail's words, which
        become their results.
        """
        assert self.session is not None
        by_name = {tool.name: tool for tool in self.tools if isinstance(tool, FunctionTool)}
        before = itertools.takewhile(lambda call: call.id != call_id, self.session.open_calls)
        if any(call.name in by_name and by_name[call.name].needs_approval for call in before):
            return self.session.refuse(call_id, self.episode.words("awaits_approval")).text
        return (await self.session.aanswer(call_id, earlier=False)).text


def _check(output_schema: Any, options: Mapping[str, Any]) -> None:
    """Refuse what an episode has no place for, before it begins."""
    if output_schema is not None and not output_schema.is_plain_text():
        raise InvalidArgumentError("An agent that plays cannot have an output_type: its run ends with the game.")
    refuse_stored(options)


def _settings(own: ModelSettings, prompt: Prompt, limit_field: str, *, with_key: bool) -> ModelSettings:
    """The settings of a request: the agent's own, with those of the prompt; `limit_field` names the cap on a reply."""
    settings = prompt.settings({"max_tokens": own.max_tokens, "tool_choice": own.tool_choice})
    if not prompt.tools:  # what a provider takes with tools only
        settings |= {"tool_choice": None, "parallel_tool_calls": None}
    given = {**(own.extra_args or {}), **(own.extra_body if isinstance(own.extra_body, Mapping) else {})}
    extra = {"prompt_cache_key": prompt.cache_key} if with_key and "prompt_cache_key" not in given else {}
    if limit_field != "max_tokens" and settings.get("max_tokens") is not None:
        extra[limit_field], settings["max_tokens"] = settings["max_tokens"], None
    if extra:
        settings["extra_args"] = {**(own.extra_args or {}), **extra}
    return dataclasses.replace(own, **settings)


def _limit_field(model: Model) -> str:
    """The name of the cap on a reply where the SDK's own, `max_tokens`, is refused."""
    if not isinstance(model, OpenAIChatCompletionsModel):
        return "max_tokens"
    return cap_at(str(model._get_client().base_url))


def _cache_fields(model: Model) -> CacheFields:
    """What the requests of a model of the SDK may have for the cache; the SDK's other models have no such fields."""
    if not isinstance(model, OpenAIResponsesModel | OpenAIChatCompletionsModel):
        return CacheFields()
    return openai_cache_fields(str(model.model), str(model._get_client().base_url))
