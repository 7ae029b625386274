"""SmartPlay: the capability that plays one episode in an agent of Pydantic AI's.

Its hooks surround every request to the model. Before it, the messages are replaced by the window of an `AgentSession`;
after it, the session takes the reply, charges it, and plays its calls in the order of the message. The toolset of
the capability only hands out these answers, so the agent may run the calls in any order. The agent's history is not
touched: what a capability does to a request is not kept there.

A reply of words only, or of calls that the agent cannot run (an unknown tool, broken arguments), is answered by the
session and followed by another attempt in the same step, so the agent's own retry limits are not used up.

Models of Anthropic and OpenAI are sent marks in the messages and the episode's key, for the provider's cache. Others
have no place for them: a mark would leave an empty message behind there.

`PlayerModel` is a player of this package as a model of Pydantic AI's, with which an agent can be tried without a key.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from contextvars import ContextVar
from typing import Any, cast

from pydantic_ai import RunContext
from pydantic_ai.capabilities import AbstractCapability, WrapModelRequestHandler, WrapToolExecuteHandler
from pydantic_ai.exceptions import RetryModelRequest, ToolFailed, UsageLimitExceeded
from pydantic_ai.messages import ModelMessage, ModelResponse, TextPart, ToolCallPart
from pydantic_ai.models import Model, ModelRequestContext, ModelRequestParameters
from pydantic_ai.models.function import AgentInfo, FunctionModel
from pydantic_ai.run import AgentRunResult
from pydantic_ai.settings import ModelSettings
from pydantic_ai.tools import Tool, ToolDefinition
from pydantic_ai.toolsets import FunctionToolset
from pydantic_ai.usage import RequestUsage
from pydantic_core import from_json

from smartplay_pydantic_ai.messages import (
    PydanticAIChat,
    from_history,
    from_response,
    known_by,
    since_response,
    takes_pictures_in_results,
    to_response,
    tool_spec,
    usage_of,
    with_calls,
)
from smartplay_tools import (
    AgentSession,
    AsyncPlayer,
    Episode,
    InvalidArgumentError,
    Message,
    Player,
    Prompt,
    Reply,
    ToolResult,
    ToolSpec,
)
from smartplay_tools.conversation import HostChat, HostHistory
from smartplay_tools.conversation.loop import reply_of
from smartplay_tools.errors import PromptRefusedError
from smartplay_tools.players import left_to_provider, reply_in
from smartplay_tools.players.cache_marks import CacheMarks, checked_marks, last_markable, stable_end
from smartplay_tools.players.conversion import received, with_pictures_below
from smartplay_tools.providers.cache_fields import CacheFields, openai_cache_fields


def cache_key(prompt: Prompt, model: Model, cache: CacheMarks) -> dict[str, Any]:
    """Return the setting that tells OpenAI which prompts belong together; nothing for other providers."""
    return {"openai_prompt_cache_key": prompt.cache_key} if cache and _openai(model).key else {}


def marked_messages(prompt: Prompt, model: Model, cache: CacheMarks) -> Collection[int]:
    """Return which messages of a prompt are marked for the cache of the model's provider."""
    is_anthropic = model.system == "anthropic"
    if not cache or not (is_anthropic or _openai(model).marks):
        return ()
    stable = stable_end(prompt, one_system_text=True)
    end = last_markable(prompt.messages) if is_anthropic and cache is True else None  # OpenAI marks the end itself
    return {at for at in (stable, end) if at is not None}


def _openai(model: Model) -> CacheFields:
    if model.system != "openai":
        return CacheFields()
    return openai_cache_fields(model.model_name, model.base_url or "")


OVER = "The episode is over."

_IN_TOOLS_OF: ContextVar[tuple[SmartPlay, ...]] = ContextVar("smartplay_in_tools_of", default=())
"""The capabilities in whose agent's tools this code runs."""


class SmartPlay(AbstractCapability[Any]):
    """Plays one episode with the model of an agent.

    Arguments:
        episode: a fresh episode whose context is "window".
        player: the player's name, for the record; "pydantic-ai:MODEL" if not given.
        cache: for Anthropic's models, mark the prompt's end and that of the part that is unchanged since the previous
            prompt, so that the provider caches them, or with "stable" only the latter; for OpenAI's, send the episode's
            `openai_prompt_cache_key`, and that mark to models that cache up to marks. False sends nothing.
        pictures: whether the model sees pictures; without it, an episode whose observations are pictures is refused.

    The agent's run ends with the episode. The agent's instructions and prompt are in every prompt, after the game's own
    head; its other tools are counted, shown and run as usual, and may change from request to request.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        player: str | None = None,
        cache: CacheMarks = True,
        pictures: bool = False,
    ) -> None:
        self.episode = episode
        self._host = HostChat(episode, player=player, pictures=pictures)
        self._cache = checked_marks(cache)
        self._system: Sequence[Message] = ()
        """The agent's instructions in its first request."""
        self._history = HostHistory[ModelMessage](episode.counter, known_by)
        self._chat = PydanticAIChat()
        self._results: dict[str, ToolResult] = {}
        """The latest reply's results by call id."""
        self._mistake: Reply | None = None
        """The reply that the latest error was, until it is received."""

    def get_toolset(self) -> FunctionToolset[Any]:
        """Return the game's tools, which hand out the answers; the episode has validated the arguments before."""

        async def handed_out(ctx: RunContext[Any], /, **_: Any) -> str:
            assert ctx.tool_call_id is not None
            result = self._results[ctx.tool_call_id]
            if result.is_error:
                raise ToolFailed(result.text)
            return result.text

        tools = [
            Tool[Any].from_schema(
                handed_out, tool.name, tool.description, dict(tool.parameters), takes_ctx=True, sequential=True
            )
            for tool in self.episode.tools
        ]
        return FunctionToolset(tools, max_retries=0, id="smartplay")

    async def before_run(self, ctx: RunContext[Any]) -> None:
        """Expect a history that begins anew."""
        if self not in _IN_TOOLS_OF.get():
            self._history.begin_again()

    async def wrap_model_request(
        self, ctx: RunContext[Any], *, request_context: ModelRequestContext, handler: WrapModelRequestHandler
    ) -> ModelResponse:
        """Leave the model alone when the episode is over, and when an agent in a tool of this one asks."""
        if self in _IN_TOOLS_OF.get():
            return _words(self.episode.words("sub_agent"))
        if self._host.session is None:
            self._begin(request_context)
        else:
            self._catch_up(request_context.messages)
            others = self._other_tools(request_context.model_request_parameters)
            self._host.change(system=self._system, foreign_tools=others)
        self._history.see(request_context.messages)
        return await handler(request_context) if await self._session.aprompt() is not None else _words(OVER)

    async def wrap_tool_execute(
        self,
        ctx: RunContext[Any],
        *,
        call: ToolCallPart,
        tool_def: ToolDefinition,
        args: dict[str, Any],
        handler: WrapToolExecuteHandler,
    ) -> Any:
        """Run a tool; an agent with this capability that runs inside it is a sub-agent."""
        token = _IN_TOOLS_OF.set((*_IN_TOOLS_OF.get(), self))
        try:
            return await handler(args)
        finally:
            _IN_TOOLS_OF.reset(token)

    async def prepare_model_request(
        self, ctx: RunContext[Any], request_context: ModelRequestContext
    ) -> ModelRequestContext:
        """Show the window instead of the history."""
        prompt = await self._session.aprompt()
        assert prompt is not None, "the episode is over, and yet the model is asked"
        model = request_context.model
        # Pydantic AI's own words about its tags would be neither counted nor recorded.
        own = {**(model.settings or {}), **(request_context.model_settings or {}), "framing_announcement": "never"}
        settings = cast(ModelSettings, prompt.settings({**cache_key(prompt, model, self._cache), **own}))
        # The head has the agent's instructions.
        asked = request_context.model_request_parameters
        shown = {tool.name for tool in prompt.tools}
        tools = [tool for tool in asked.function_tools if tool.name in shown]
        if missing := sorted(shown - {tool.name for tool in tools}):
            raise InvalidArgumentError(
                f"Another capability has removed {', '.join(missing)}; every request must offer the game's tools."
            )
        prompt = prompt if takes_pictures_in_results(model) else with_pictures_below(prompt)
        parameters = dataclasses.replace(asked, instruction_parts=[], function_tools=tools)
        return dataclasses.replace(
            request_context,
            messages=self._chat.write(
                prompt.messages, marked=marked_messages(prompt, model, self._cache), pictures=prompt.pictures
            ),
            model_settings=settings,
            model_request_parameters=parameters,
        )

    async def on_model_request_error(
        self, ctx: RunContext[Any], *, request_context: ModelRequestContext, error: Exception
    ) -> ModelResponse:
        """Take a call that the server could not read as the reply that it was; a refused prompt ends the episode."""
        try:
            self._mistake = reply_in(error)
        except PromptRefusedError as refused:
            self._session.give_up(refused)
            return _words(OVER)
        except Exception:
            self._session.fail(error)
            raise
        return to_response(self._mistake.message)

    async def after_model_request(
        self, ctx: RunContext[Any], *, request_context: ModelRequestContext, response: ModelResponse
    ) -> ModelResponse:
        """Have the reply's calls answered; return it with the calls that the agent is to run."""
        session = self._session
        if self.episode.done:
            return response
        before = session.latest_turn
        usage = left_to_provider(usage_of(response), request_context.model_settings)
        reply, self._mistake = self._mistake or Reply(from_response(response), usage), None
        calls = await session.areceive(reply)
        turn = session.latest_turn
        if turn is None or turn is before:  # a summary
            return await self._another_attempt()
        foreign = {tool.name for tool in session.foreign_tools}
        self._results = {call.id: await session.aanswer(call.id) for call in calls if call.name not in foreign}
        response = with_calls(response, turn.assistant)
        self._chat.remember(turn.shown, with_calls(response, turn.shown))
        runnable = [part for part in response.parts if not isinstance(part, ToolCallPart) or self._can_run(part)]
        if any(isinstance(part, ToolCallPart) for part in runnable):
            return dataclasses.replace(response, parts=runnable)
        return await self._another_attempt()

    async def on_run_error(self, ctx: RunContext[Any], *, error: BaseException) -> AgentRunResult[Any]:
        """End the episode as `host` when a limit of the agent's usage ends its run."""
        if isinstance(error, UsageLimitExceeded) and self not in _IN_TOOLS_OF.get():
            self.episode.end("host", detail=str(error))
        raise error

    async def _another_attempt(self) -> ModelResponse:
        """Have the model asked again in the same step, unless the episode is over."""
        self._catch_up(())
        if await self._session.aprompt() is None:
            return _words(OVER)
        raise RetryModelRequest

    @property
    def _session(self) -> AgentSession:
        assert self._host.session is not None
        return self._host.session

    def _catch_up(self, history: Sequence[ModelMessage]) -> None:
        """Take over the results of other tools, and other words, since the latest reply."""
        since = since_response(history)
        if self._session.awaits_reply:
            self._host.refuse_late_words(since)
        self._host.settle(since)
        self._host.hear(since)

    def _begin(self, request: ModelRequestContext) -> None:
        parameters = request.model_request_parameters
        if parameters.output_tools or not parameters.allow_text_output:
            raise InvalidArgumentError("An agent that plays cannot have an output_type: its run ends with the game.")
        if request.streaming:
            raise InvalidArgumentError("A streamed run cannot play: use `run` or `run_sync`.")
        instructions = "\n\n".join(part.content for part in parameters.instruction_parts or ())
        self._system = [{"role": "system", "content": instructions}] if instructions else []
        others, player = self._other_tools(parameters), f"pydantic-ai:{request.model.model_name}"
        self._host.begin(from_history(request.messages), system=self._system, foreign_tools=others, player=player)

    def _other_tools(self, parameters: ModelRequestParameters) -> list[ToolSpec]:
        """The agent's other tools, which may change from request to request."""
        ours = {tool.name for tool in self.episode.tools}
        return [tool_spec(tool) for tool in parameters.function_tools if tool.name not in ours]

    def _can_run(self, call: ToolCallPart) -> bool:
        """Whether the agent would run a call; it answers the others itself, a second time."""
        if call.tool_name not in {tool.name for tool in (*self.episode.tools, *self._session.foreign_tools)}:
            return False
        return not isinstance(call.args, str) or _is_readable(call.args or "{}")


def _is_readable(arguments: str) -> bool:
    """Whether Pydantic AI, which is stricter than Python's `json`, can read the arguments of a call."""
    try:
        return isinstance(from_json(arguments), dict)
    except ValueError:
        return False


def _words(text: str) -> ModelResponse:
    return ModelResponse([TextPart(text)])


class PlayerModel(FunctionModel):
    """A player as a model. One player serves one run at a time: some draw from their own generator."""

    def __init__(self, player: Player | AsyncPlayer) -> None:
        self._player = player
        super().__init__(self._answer, model_name=player.name)

    async def _answer(self, messages: list[ModelMessage], info: AgentInfo) -> ModelResponse:
        history, cap = from_history(messages), (info.model_settings or {}).get("max_tokens")
        tools = tuple(map(tool_spec, info.function_tools))
        reply = await reply_of(self._player, received(history, tools, cap))
        response = to_response(reply.message)
        if (usage := reply.usage) is not None:
            response.usage = RequestUsage(
                input_tokens=usage.prompt,
                output_tokens=usage.reply,
                cache_read_tokens=usage.cached or 0,
                cache_write_tokens=usage.written,
                details={"reasoning_tokens": usage.reasoning},
            )
            response.finish_reason = "length" if usage.cut else None
        return response
