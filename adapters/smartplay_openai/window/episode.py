"""One episode behind the window endpoint: whatever a host's agent sends and however often, each turn is played once.

There are two ways in. `reply` answers a request for a completion: if the request knows the latest reply, the next turn
begins, and if it does not, the latest reply has not arrived, and is given again. `call` plays a tool call that the
host's agent runs. Both know the calls by the ids and arguments of the latest reply (`PendingReply`), so a request or a
call that is sent twice, late, in another order or while the first is still under way changes nothing and costs nothing.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence, Set
from types import MappingProxyType
from typing import Any

from smartplay_openai.problems import RequestError
from smartplay_openai.window.completion_request import CompletionRequest
from smartplay_openai.window.names import HostTools, tell_apart
from smartplay_openai.window.pending_reply import PendingReply, Slot
from smartplay_tools import (
    AgentSession,
    AsyncPlayer,
    Episode,
    Message,
    Player,
    Prompt,
    Reply,
    ToolResult,
    ToolSpec,
    Usage,
)
from smartplay_tools.conversation import AttachedPlayer, HostChat
from smartplay_tools.episode import tool_functions
from smartplay_tools.errors import PlayerLeftError
from smartplay_tools.messages import MessageToolCall, assistant_message
from smartplay_tools.prompts import GAME_IS_OVER

NO_RESULT = "Error: The host's agent gave no result for this call."
"""The result of a foreign call that the host's next request does not have."""

NOT_CALLED = "Error: The model has made no such call; nothing was played."
"""The answer to a call that the latest reply does not have."""

NO_TOOLS = "This endpoint plays a game: it answers requests that offer the game's tools, from the MCP server beside it."
"""The answer to a request without the game's tools, as agents send for plans and titles. The model is not asked."""

LOST = 20
"""After this many requests in a row without the latest reply's call ids, the host is assumed not to keep ids."""

log = logging.getLogger("smartplay_openai.window")


class WindowEpisode:
    """An episode whose window the endpoint keeps.

    Arguments:
        handle: the episode's handle, from which the call ids are made.
        episode: an episode whose context is "window".
        player: who is asked with the window's prompts.
        session: the session that a record was continued with.
        closing: the name of a tool by which frameworks want a run to be closed, as smolagents does.
    """

    def __init__(
        self,
        handle: str,
        episode: Episode,
        player: Player | AsyncPlayer,
        *,
        session: AgentSession | None = None,
        closing: str | None = "final_answer",
    ) -> None:
        self.handle, self.episode, self.player = handle, episode, player
        self._chat = HostChat(session or episode, player=player.name)
        self._closing, self._is_resumed = closing, session is not None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._latest = self._of_record(episode.tools)
        self._turn: asyncio.Task[PendingReply] | None = None
        self._asking, self._calling = asyncio.Lock(), asyncio.Lock()
        self._by_key: dict[str, Slot] = {}
        self._failure: RequestError | None = None
        self.ignored = ""
        """What of the host's requests has not reached the model."""

    async def ready(self) -> Episode:
        """Return the episode."""
        return self.episode

    async def reply(self, request: CompletionRequest, *, is_retry: bool = False) -> PendingReply:
        """Answer a request: the next turn's reply, or the latest again where the request does not know it yet.

        `is_retry` says that the client calls it one. A turn that has begun continues when its request is cancelled, and
        the request that comes instead gets its reply.
        """
        tools = tell_apart(request.tools, self.episode.tools, self._closing)
        if not tools.names:
            text = GAME_IS_OVER if self.episode.done else NO_TOOLS
            return PendingReply({"role": "assistant", "content": text}, Usage(requests=0))
        self._note_ignored(request)
        self._loop = asyncio.get_running_loop()
        async with self._asking:
            if self._turn is not None:
                await self._finish_turn()
            if self._is_resumed:
                self._latest, self._is_resumed = self._of_record((*self.episode.tools, *tools.foreign)), False
            if self._failure is not None:
                raise self._failure
            if self._latest is not None and not self._goes_on_from(self._latest, request):
                self._count_repeat(self._latest, is_retry)
                return self._latest
            self._turn = asyncio.create_task(self._next(request, tools))
            return await self._finish_turn()

    async def call(self, name: str, arguments: Any, call_id: str | None = None) -> ToolResult:
        """Play a call of the latest reply that the host's agent runs; one that is played already is answered again.

        Calls are told apart by the transport's `call_id`, if there is one, then by name and arguments. A call with
        other arguments than the model's is recorded as edited by the host.
        """
        async with self._calling:
            slot = self._by_key.get(call_id or "") or (self._latest.called(name, arguments) if self._latest else None)
            session = self._chat.session
            if slot is None or session is None:
                return self._error(NOT_CALLED)
            if call_id:
                self._by_key[call_id] = slot
            if slot.result is None:
                edited = None if slot.has(arguments) else arguments
                slot.result = await session.aanswer(slot.call.id, edited)
            slot.is_delivered = True
            return slot.result

    def functions(self) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
        """Return the tools as plain functions, for an agent in another thread of this process."""
        return tool_functions(_FromThreads(self))

    def call_from_thread(self, name: str, arguments: Any) -> ToolResult:
        """Play a call as `call` does, from a thread that is not the server's."""
        if self._loop is None:
            return self._error(NOT_CALLED)
        return asyncio.run_coroutine_threadsafe(self.call(name, arguments), self._loop).result()

    async def stop(self) -> None:
        """Stop the turn under way; its reply is neither played nor recorded."""
        if self._turn is not None:
            self._turn.cancel()
            await asyncio.wait([self._turn])

    async def _finish_turn(self) -> PendingReply:
        """Wait for the turn under way; a cancelled request leaves it running."""
        turn = self._turn
        assert turn is not None
        try:
            return await asyncio.shield(turn)
        finally:
            if turn.done():
                self._turn = None

    def _goes_on_from(self, reply: PendingReply, request: CompletionRequest) -> bool:
        """Whether the request comes after a reply, of which it knows at least one call. Nothing comes after the end."""
        return any(request.holds(slot.host_id) for slot in reply.sent)

    def _count_repeat(self, reply: PendingReply, is_retry: bool) -> None:
        reply.repeats += not is_retry and bool(reply.slots)
        if reply.repeats > LOST:
            raise RequestError(
                400,
                "The requests do not have the ids of the latest reply's tool calls. Use an agent that sends the tool "
                "calls of the model back to it.",
                code="call_ids_lost",
            )

    # A turn.

    async def _next(self, request: CompletionRequest, tools: HostTools) -> PendingReply:
        """Close the latest turn, ask the model until it makes a call that the host can run, and keep that reply."""
        session = self._chat.session or self._begin(tools)
        async with self._calling:
            await asyncio.to_thread(self._settle, self._latest.slots if self._latest else (), request.results)
        while (reply := await self._ask(session)) is not None:
            await session.areceive(reply.message, reply.usage)
            pending = self._pending(session, tools.names, {tool.name for tool in tools.foreign}, reply.usage)
            if pending.sent:
                self._latest, self._by_key = pending, {}
                return pending
            await asyncio.to_thread(self._settle, pending.slots)
        self._latest = self._last_words(tools)
        return self._latest

    def _begin(self, tools: HostTools) -> AgentSession:
        session = self._chat.begin(foreign_tools=tools.foreign)
        if isinstance(self.player, AttachedPlayer):
            self.player.attach(session)
        return session

    def _settle(self, slots: Sequence[Slot], results: Mapping[str, str] = MappingProxyType({})) -> None:
        """Answer what is open of a reply, in the order of the message: with the host's results, or in its name."""
        messages: list[Message] = []
        slots = [slot for slot in slots if slot.result is None]
        for slot in slots:
            text = results.get(slot.host_id, NO_RESULT if slot.is_foreign else None)
            if text is not None:
                messages.append({"role": "tool", "tool_call_id": slot.call.id, "content": text})
            slot.is_delivered = True
        play = {slot.call.id: None for slot in slots if not slot.is_sent and not slot.is_foreign}
        answers = self._chat.settle(messages, play=play)
        for slot in slots:
            slot.result = answers.get(slot.call.id)

    async def _ask(self, session: AgentSession) -> Reply | None:
        """Return the model's next reply; None when the episode is over, as it is when a player has left."""
        try:
            return await session.aask(self._send)
        except PlayerLeftError:
            return None

    async def _send(self, prompt: Prompt) -> Reply:
        """Ask the model. Where it gives no reply the episode ends, and the host is told so whenever it asks."""
        try:
            if isinstance(self.player, AsyncPlayer):
                reply = await self.player.areply(prompt)
            else:
                reply = await asyncio.to_thread(self._blocking, self.player.reply, prompt)
            return Reply(assistant_message(reply.message), reply.usage)
        except Exception as error:
            assert self._chat.session is not None
            self._chat.session.give_up(error)
            if isinstance(error, PlayerLeftError):
                raise
            problem = f"The model gave no reply, which ends the episode: {error}"
            self._failure = RequestError(500, problem, code="player_failed")
            raise self._failure from error

    @staticmethod
    def _blocking(ask: Callable[[Prompt], Reply], prompt: Prompt) -> Reply:
        try:
            return ask(prompt)
        except StopIteration as error:  # which no coroutine may raise
            raise RuntimeError("The player has no more replies.") from error

    # What the host gets.

    def _pending(
        self, session: AgentSession, names: Mapping[str, str], foreign: Set[str], usage: Usage | None = None
    ) -> PendingReply:
        """Return the latest reply as the host gets it: calls under the host's names and under ids that only we make."""
        assert session.message is not None
        assert session.latest_turn is not None
        slots, calls = [], []
        for position, call in enumerate(session.latest_turn.calls):
            name = call.name if call.name in foreign else names.get(call.name)
            host_id = self._host_id(session.latest_turn.number, position)
            is_sent = name is not None and call.arguments.values is not None
            slots.append(Slot(call, host_id, call.name in foreign, is_sent))
            if is_sent:
                function: Any = {"name": name, "arguments": call.arguments.text or "{}"}
                calls.append(MessageToolCall(id=host_id, type="function", function=function))
        message: Message = {"role": "assistant", "content": session.message["content"]}
        if calls:
            message = {**message, "tool_calls": calls}
        counted = Usage(
            prompt=session.view.tokens if session.view else 0, reply=self.episode.counter.message(session.message)
        )
        return PendingReply(message, usage or counted, slots)

    def _of_record(self, tools: Sequence[ToolSpec]) -> PendingReply | None:
        """Return the latest reply of a session that continues from its record, if the host was sent it."""
        session = self._chat.session
        if session is None or session.message is None:
            return None
        own = {tool.name: tool.name for tool in self.episode.tools}
        pending = self._pending(session, own, {tool.name for tool in tools} - own.keys())
        return pending if pending.sent else None

    def _host_id(self, number: int, position: int) -> str:
        """Return an id that cannot be guessed, is not used twice, and is the same after a restart."""
        digest = hashlib.sha256(f"{self.handle} {number} {position}".encode()).hexdigest()
        return f"call_{digest[:24]}"

    def _last_words(self, tools: HostTools) -> PendingReply:
        message: Message = {"role": "assistant", "content": GAME_IS_OVER}
        if tools.closing is not None:
            message = {**message, "tool_calls": [tools.close(self._host_id(-1, 0), GAME_IS_OVER)]}
        return PendingReply(message, Usage(requests=0))

    def _error(self, text: str) -> ToolResult:
        return ToolResult(text, is_error=True, done=self.episode.done, data={"step": self.episode.progress.steps})

    def _note_ignored(self, request: CompletionRequest) -> None:
        if request.ignored and not self.ignored:
            log.warning(
                "%s: the model sees the game's window only; ignored of the host's requests: %s.",
                self.handle,
                request.ignored,
            )
        self.ignored = request.ignored or self.ignored


class _FromThreads:
    """An episode as the tool functions call it."""

    def __init__(self, episode: WindowEpisode) -> None:
        self._episode = episode

    @property
    def tools(self) -> tuple[ToolSpec, ...]:
        return self._episode.episode.tools

    def call(self, name: str, arguments: Any) -> ToolResult:
        return self._episode.call_from_thread(name, arguments)
