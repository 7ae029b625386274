"""CallPlayer: plays the calls of replies where a LangGraph graph runs its tools, in the order of the message.

The tools here are innermost: a middleware that stops, edits or answers a call has done so when the tool runs, and what
it did is recorded. `wrap_tool_call` answers calls of unknown tools in the game's words; a tool node takes it as an
argument, and `SmartPlayMiddleware` as a hook.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from langchain_core.messages import BaseMessage, ToolMessage
from langchain_core.runnables import RunnableConfig
from langchain_core.tools import BaseTool
from pydantic import Field

from smartplay_langchain.messages import from_langchain
from smartplay_langchain.order import TurnOrder
from smartplay_langchain.toolkit import SmartPlayTool, SmartPlayToolkit, artifact_of
from smartplay_tools import AgentSession, InvalidArgumentError, ToolResult
from smartplay_tools.conversation import HostChat
from smartplay_tools.players.conversion import check_names
from smartplay_tools.types.messages import Call

T = TypeVar("T")

OURS = "smartplay-"
"""The prefix of the ids of messages that this package adds to a graph's state."""

HELD = "This call waits for the decision about an earlier one."
"""The provisional result of a call that is held."""


NO_CHECKPOINTER = (
    " An agent without a checkpointer keeps nothing: to invoke it again after an error, give it one, and invoke it "
    "with None and the same configuration."
)


class CallPlayer:
    """The calls of an episode's replies."""

    def __init__(self, chat: HostChat) -> None:
        self._chat, self.episode = chat, chat.episode
        self.tools: Sequence[BaseTool] = [
            SessionTool(**dict(tool), player=self)
            for tool in SmartPlayToolkit(episode=self.episode, pictures=True).get_tools()
        ]
        """The game's tools, for a tool node."""
        self.begin_turn()

    @property
    def session(self) -> AgentSession | None:
        """The session; None before the first prompt."""
        return self._chat.session

    def begin_turn(self) -> None:
        """Forget the calls of the reply before."""
        self._order = TurnOrder(self._earlier_open)

    def wrap_tool_call(self, request: Any, handler: Callable[[Any], Any]) -> Any:
        """Run a call of the tool node; calls of unknown tools are answered here."""
        self._settle(request)
        call = request.tool_call
        if self._is_unknown(call):
            return self._message(call["id"], call["name"], *self.play(call))
        with self._in_a_tool():
            return handler(request)

    async def awrap_tool_call(self, request: Any, handler: Callable[[Any], Awaitable[Any]]) -> Any:
        """Run a call as `wrap_tool_call` does, without blocking the event loop."""
        self._settle(request)
        call = request.tool_call
        if self._is_unknown(call):
            return self._message(call["id"], call["name"], *await self.aplay(call))
        with self._in_a_tool():
            return await handler(request)

    def check_names(self, tools: Iterable[tuple[str, object]]) -> None:
        """Refuse two tools with one name, and another's in the place of one of these, whatever it looks like."""
        # A middleware may copy a tool, as that for Anthropic's cache does: who plays its calls stays the same object.
        players = ((name, getattr(tool, "player", tool)) for name, tool in tools)
        check_names(players, {own.name: self for own in self.tools})

    @property
    def is_asked_by_sub_agent(self) -> bool:
        """Whether this request comes from within one of the agent's own tools, as from an agent that runs there."""
        return self in _IN_TOOLS_OF.get()

    def _in_a_tool(self) -> AbstractContextManager[None]:
        return _holding(_IN_TOOLS_OF, (*_IN_TOOLS_OF.get(), self))

    def play(self, tool_call: Any) -> tuple[str, dict[str, Any]]:
        """Play a call (LangChain's `ToolCall`) after the calls before it; returns the text and the artifact."""
        position, call = self._find(tool_call)
        if not self._order.begin(position):
            return HELD, {"held": True, "arguments": tool_call["args"]}
        try:
            return _answer(self._session.answer(call.id, tool_call["args"]))
        finally:
            self._order.end(position)

    async def aplay(self, tool_call: Any) -> tuple[str, dict[str, Any]]:
        """Play a call as `play` does, without blocking the event loop."""
        position, call = self._find(tool_call)
        if not await self._order.abegin(position):
            return HELD, {"held": True, "arguments": tool_call["args"]}
        try:
            return _answer(await self._session.aanswer(call.id, tool_call["args"]))
        finally:
            self._order.end(position)

    def lacked(self, messages: Sequence[BaseMessage]) -> int:
        """Return how many of the episode's replies the messages in the graph's state lack."""
        latest = self.session.latest_turn if self.session is not None else None
        turn = next((turn for message in reversed(messages) if (turn := turn_of(message)) is not None), -1)
        return (-1 if latest is None else latest.number) - turn

    def another_state(self, lacked: int) -> InvalidArgumentError:
        """Return the error for a graph's state that is not the episode's, since it lacks this number of replies."""
        if self.episode.done:
            return InvalidArgumentError("The episode is over; make a new one, and an agent with it.")
        difference = (
            f"lacks {lacked} of the episode's replies" if lacked > 0 else "has replies that the episode has not"
        )
        latest = self._session.latest_turn
        has_none = latest is not None and lacked == latest.number + 1
        return InvalidArgumentError(
            f"The state of the graph {difference}: its checkpoint is older than the episode's record, this is another "
            "thread, or a middleware has removed messages. Continue the thread on which the episode is played, and "
            'have its checkpoints written at once, with `durability="sync"`.' + (NO_CHECKPOINTER if has_none else "")
        )

    def result_id(self, call_id: str) -> str:
        """The id of the message with a call's result."""
        turn = self._session.latest_turn
        assert turn is not None
        return f"{OURS}{turn.number}.{self._positions()[call_id]}"

    @property
    def _session(self) -> AgentSession:
        if self.session is None:
            raise InvalidArgumentError("The episode's tools are called after the first reply of its model.")
        return self.session

    def _calls(self) -> Sequence[Call]:
        turn = self.session.latest_turn if self.session is not None else None
        return turn.calls if turn is not None else ()

    def _positions(self) -> dict[str, int]:
        return {call.id: position for position, call in enumerate(self._calls())}

    def _is_unknown(self, tool_call: Any) -> bool:
        """Whether a call of the latest reply names a tool that the model was not shown; the game answers it."""
        shown = {tool.name for tool in (*self.episode.tools, *self._session.foreign_tools)}
        return any(call.id == tool_call["id"] and call.name not in shown for call in self._calls())

    def _earlier_open(self, position: int) -> set[int]:
        """The positions of the game's calls before a position that are not answered yet."""
        positions = self._positions()
        return {positions[call.id] for call in self._session.open_calls if positions[call.id] < position}

    def _find(self, tool_call: Any) -> tuple[int, Call]:
        position = self._positions().get(tool_call["id"])
        if position is None:
            raise InvalidArgumentError(
                f"The latest reply of the episode's model has no call {tool_call['id']!r}; a middleware has made it."
            )
        call = self._calls()[position]
        if call.name != tool_call["name"]:
            raise InvalidArgumentError(
                f"The call {call.id} of {call.name} was changed into one of {tool_call['name']}. A reviewer may change "
                "its arguments; to have another tool called, reject the call and say so."
            )
        return position, call

    def _settle(self, request: Any) -> None:
        """Record which calls were refused before any was run: a call waits for the earlier ones that are to come."""
        self.check_names([(request.tool.name, request.tool)] if request.tool is not None else ())
        state = request.state
        messages = state.get("messages", ()) if isinstance(state, dict) else getattr(state, "messages", state)
        if messages and (lacked := self.lacked(messages)):
            raise self.another_state(lacked)
        with self._session.episode.lock:
            waiting = {call.id for call in self._session.open_calls}
            for message in after_latest_reply(messages):
                if isinstance(message, ToolMessage) and message.tool_call_id in waiting and not is_ours(message):
                    self._session.add(from_langchain(message))

    def _message(self, call_id: str, name: str, text: str, artifact: dict[str, Any]) -> ToolMessage:
        return ToolMessage(
            text,
            id=self.result_id(call_id),
            name=name,
            tool_call_id=call_id,
            status="error" if artifact.get("is_error") else "success",
            artifact=artifact,
        )


class SessionTool(SmartPlayTool):
    """One of the game's tools in a graph, called with a `ToolCall`, whose id says which call of the reply it is.

    Its messages are words even where observations are pictures: what the model is sent is in the window, not in the
    state.
    """

    player: CallPlayer = Field(exclude=True, repr=False)

    def invoke(self, input: Any, config: RunnableConfig | None = None, **kwargs: Any) -> Any:  # noqa: A002
        """Play the call."""
        with _holding(_CALL, _as_call(input)):
            return self._with_id(super().invoke(input, config, **kwargs))

    async def ainvoke(self, input: Any, config: RunnableConfig | None = None, **kwargs: Any) -> Any:  # noqa: A002
        """Play the call without blocking the event loop."""
        with _holding(_CALL, _as_call(input)):
            return self._with_id(await super().ainvoke(input, config, **kwargs))

    def _run(self, /, *_: Any, **arguments: Any) -> tuple[str, dict[str, Any]]:
        return self.player.play({**_CALL.get(), "args": arguments})

    async def _arun(self, /, *_: Any, **arguments: Any) -> tuple[str, dict[str, Any]]:
        return await self.player.aplay({**_CALL.get(), "args": arguments})

    def _with_id(self, output: Any) -> Any:
        if isinstance(output, ToolMessage):
            output.id = self.player.result_id(output.tool_call_id)
        return output


_IN_TOOLS_OF: ContextVar[tuple[CallPlayer, ...]] = ContextVar("smartplay_in_tools_of", default=())
"""The players of calls in whose agent's tools this code runs."""

_CALL: ContextVar[dict[str, Any]] = ContextVar("smartplay_call")
"""The call that a `SessionTool` is invoked with."""


@contextmanager
def _holding(variable: ContextVar[T], value: T) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def is_ours(message: ToolMessage) -> bool:
    """Whether a result comes from the game, and not from a middleware."""
    return (message.id or "").startswith(OURS)


def after_latest_reply(messages: Sequence[BaseMessage]) -> Sequence[BaseMessage]:
    """Return the messages after the latest reply of an episode's model; none if there is no such reply."""
    for at in range(len(messages) - 1, -1, -1):
        if turn_of(messages[at]) is not None:
            return messages[at + 1 :]
    return ()


TURN = "smartplay_turn"
"""The field of a reply's response metadata that has the number of its turn."""


def turn_of(message: BaseMessage) -> int | None:
    """Return the number of the turn that a reply began; None for any other message."""
    turn = message.response_metadata.get(TURN) if message.type == "ai" else None
    return turn if isinstance(turn, int) else None


def _as_call(sent: Any) -> dict[str, Any]:
    if not isinstance(sent, dict) or sent.get("type") != "tool_call":
        raise InvalidArgumentError(
            "A tool of a graph's episode is called with a ToolCall; SmartPlayToolkit has others."
        )
    return {"id": sent["id"], "name": sent["name"]}


def _answer(result: ToolResult) -> tuple[str, dict[str, Any]]:
    return result.text, artifact_of(result)
