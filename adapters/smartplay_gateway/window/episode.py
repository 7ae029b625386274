"""One episode behind the window endpoint: each turn is played once, whatever a host's agent sends and however often.

There are two ways in. `reply` answers a request for a completion: if the request knows the latest reply, the next turn
begins, and if it does not, the latest reply has not arrived, and is given again. `call` plays a tool call that the
host's agent runs. Both know the calls by the ids and arguments of the latest reply (`PendingReply`), so a request or a
call that is sent twice, late, in another order or while the first is still under way changes nothing and costs nothing.

`FromThreads` makes the calls of an agent whose tools run in threads that are not the server's.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

from smartplay_gateway.window.formats import CompletionRequest, known_by
from smartplay_gateway.window.names import HostTools, Notices, Shown, tell_apart
from smartplay_gateway.window.pending_reply import PendingReply, call_id
from smartplay_gateway.window.side_requests import SideRequests, in_schema
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
from smartplay_tools.context import Turn
from smartplay_tools.conversation import AttachedPlayer, HostChat, HostHistory, check_observation
from smartplay_tools.conversation.loop import reply_of
from smartplay_tools.episode import tool_functions
from smartplay_tools.errors import PlayerLeftError, PromptRefusedError
from smartplay_tools.players import ModelRefusedError
from smartplay_tools.players.wire import RequestError
from smartplay_tools.types.arguments import meaning, read
from smartplay_tools.types.messages import assistant_message


@dataclass(frozen=True)
class FromThreads:
    """The tools of an episode, and a function that plays a call of one."""

    tools: tuple[ToolSpec, ...]
    call: Callable[[str, Any], ToolResult]


SUMMARIES = (
    "A summary asked of this endpoint cost nothing. A summary by another model was a call with at least these tokens, "
    "which you pay for and the budget does not count."
)
"""What the summaries of a host's own messages cost."""

WAS_PLAYED = (
    "Error: This call was played as the model sent it, before its change arrived; what was played cannot be changed. "
    "Call the tool with the model's arguments for its result."
)
"""The answer to a call with other arguments than those with which it was played."""


class WindowEpisode:
    """An episode whose window the endpoint keeps.

    Arguments:
        handle: the episode's handle, from which the call ids are made.
        episode: an episode whose context is "window".
        player: who is asked with the window's prompts.
        session: the session that a record was continued with.
        closing: the name of a tool by which frameworks want a run to be closed, as smolagents does.
        shown: what the model is shown of the host's own messages and tools.
    """

    def __init__(
        self,
        handle: str,
        episode: Episode,
        player: Player | AsyncPlayer,
        *,
        session: AgentSession | None = None,
        closing: str | None = "final_answer",
        shown: Shown | None = None,
    ) -> None:
        self.handle, self.episode, self.player = handle, episode, player
        check_observation(player, episode.config.observation)
        self._chat = HostChat(session or episode, player=player.name, no_result="no_result", pictures=True)
        self._closing, self._is_resumed = closing, session is not None
        self._shown = shown or Shown()
        self._notices = Notices(handle, self._shown)
        self._history = HostHistory[Any](episode.counter, known_by, cost=SUMMARIES)
        self._call_id = partial(call_id, handle)
        self._sent: set[str] = set()
        """The ids of all calls that the host was sent."""
        self._side = SideRequests(handle, episode, lambda body: any(sent in body for sent in self._sent))
        self._tools: Sequence[ToolSpec] = ()
        """Those of the latest request that had some."""
        self._spent = Usage(requests=0)
        """What the replies of this turn have taken."""
        self._loop: asyncio.AbstractEventLoop | None = None
        own = {tool.name: tool.name for tool in episode.tools}
        self._latest = self._of_record(HostTools(own, (), None))
        self._before: PendingReply | None = None
        """The reply before the latest."""
        self._turn: asyncio.Task[PendingReply] | None = None
        self._is_awaited = asyncio.Event()
        """Set while a request waits for the turn; without one, the model is not asked."""
        self._asking, self._calling = asyncio.Lock(), asyncio.Lock()
        self._failure: RequestError | None = None

    @property
    def prompt_tokens(self) -> int:
        """The tokens of the latest prompt; of the first, before there is one."""
        view = self._chat.session.view if self._chat.session is not None else None
        return view.tokens if view else self.episode.counter.prompt(self.episode.head, self.episode.tools)

    async def ready(self) -> Episode:
        """Return the episode."""
        return self.episode

    async def reply(self, request: CompletionRequest, *, is_retry: bool = False) -> PendingReply:
        """Answer a request: the next turn's reply, or the latest again where the request does not know it yet.

        `is_retry` says that the client calls it one. When a request is cancelled, the reply that the model is giving is
        still taken. The model is not asked again before another request comes, which continues the turn.
        """
        request = self._in_full(request)
        tools = self._tell_apart(request)
        if (words := self._side.answer(request, tools, self._call_id(-2, 0))) is not None:
            return words
        self._notices.note(request, tools)
        self._loop = asyncio.get_running_loop()
        async with self._asking:
            if self._turn is not None:
                await self._finish_turn()
            if self._is_resumed:
                self._latest, self._is_resumed = self._of_record(tools, one_call=request.one_call), False
            if self._failure is not None:
                raise self._failure
            if (latest := self._latest) is not None:
                if not self._goes_on_from(latest, request):
                    self._history.begin_again()
                    latest.count_repeat(is_retry=is_retry)
                    return latest
                latest.check_played(request.calls)
                if (rest := await self._rest(latest, request)) is not None:
                    return self._keep(rest)
            if request.messages:
                self._history.see(request.messages)
            self._turn = asyncio.create_task(self._next(request, tools))
            return await self._finish_turn()

    def _tell_apart(self, request: CompletionRequest) -> HostTools:
        only = self._shown.only_game_tools
        return tell_apart(request.tools, self.episode.tools, self._closing, only_game_tools=only)

    def _in_full(self, request: CompletionRequest) -> CompletionRequest:
        """Return a request with the tools of those before it, if it has only what is new."""
        if not request.continues:
            self._tools = request.tools or self._tools
            return request
        if not self._tools:
            raise RequestError(404, "This endpoint does not know the thread: send it whole.", code="thread_not_found")
        return replace(request, tools=self._tools)

    async def call(self, name: str, arguments: Any, call_id: str | None = None) -> ToolResult:
        """Play a call of the latest reply that the host's agent runs; one that is played already is answered again.

        Calls are told apart by the transport's `call_id`, if there is one, then by name and arguments. A call with
        other arguments than the model's is recorded as edited by the host, unless it has been played.
        """
        async with self._calling:
            given, ledger = read(arguments), self.episode.ledger
            if (recorded := ledger.recall(call_id or "", name, given)) is not None:
                return recorded
            slot = self._latest.called(name, arguments, self._before) if self._latest else None
            session = self._chat.session
            if slot is None or session is None:
                return self._error(self.episode.words("not_called"))
            if slot.result is None:
                if not slot.has(arguments):
                    if slot.call not in session.open_calls:  # a later call of the message was run before it
                        return self._error(WAS_PLAYED)
                    slot.edited = meaning(given)
                edited = None if slot.edited is None else arguments
                slot.result = await session.aanswer(slot.call.id, edited, key=call_id or "")
            slot.is_delivered = True
            if call_id:
                ledger.remember(call_id, name, given, slot.result)
            return slot.result

    def functions(self) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
        """Return the tools as plain functions, for an agent in another thread of this process."""
        return tool_functions(FromThreads(self.episode.tools, self.call_from_thread))

    def call_from_thread(self, name: str, arguments: Any) -> ToolResult:
        """Play a call as `call` does, from a thread that is not the server's."""
        if self._loop is None:
            return self._error(self.episode.words("not_called"))
        return asyncio.run_coroutine_threadsafe(self.call(name, arguments), self._loop).result()

    async def stop(self) -> None:
        """Stop the turn under way; its reply is neither played nor recorded."""
        if self._turn is not None:
            self._turn.cancel()
            await asyncio.wait([self._turn])

    async def _finish_turn(self) -> PendingReply:
        """Wait for the turn under way; a cancelled request leaves it to the next."""
        turn = self._turn
        assert turn is not None
        self._is_awaited.set()
        try:
            return await asyncio.shield(turn)
        finally:
            self._is_awaited.clear()
            if turn.done():
                self._turn = None

    def _goes_on_from(self, reply: PendingReply, request: CompletionRequest) -> bool:
        """Whether the request follows a reply, because it has at least one of its calls. Nothing follows the end."""
        return any(request.holds(slot.host_id) for slot in reply.sent)

    # A turn.

    async def _next(self, request: CompletionRequest, tools: HostTools) -> PendingReply:
        """Close the latest turn, ask the model until it makes a call that the host can run, and keep that reply."""
        session = self._chat.session or self._begin(request, tools)
        if self._latest is not None:
            await self._settle(self._latest, request.results)
        self._spent = Usage(requests=0)
        while (reply := await self._ask(session)) is not None:
            await session.areceive(reply)
            assert session.latest_turn is not None
            pending = self._pending(session.latest_turn, self._spent, tools, one_call=request.one_call)
            if pending.sent:
                return self._keep(pending)
            await self._settle(pending)
        return self._keep(self._last_words(request, tools))

    def _keep(self, reply: PendingReply) -> PendingReply:
        """Take note of a reply that the host is sent."""
        self._before, self._latest = self._latest, reply
        self._sent |= {slot.host_id for slot in reply.sent}
        return reply

    async def _rest(self, latest: PendingReply, request: CompletionRequest) -> PendingReply | None:
        """Return the calls that a host is still to be sent, because it takes one at a time; None if there are none."""
        rest = latest.rest(one_call=request.one_call)
        if rest is None or self.episode.done:
            return None
        await self._settle(latest, request.results, latest.end)
        return None if self.episode.done else rest

    def _begin(self, request: CompletionRequest, tools: HostTools) -> AgentSession:
        is_shown = self._shown.system and bool(request.system)
        system: list[Message] = [{"role": "system", "content": request.system}] if is_shown else []
        session = self._chat.begin(system=system, foreign_tools=tools.foreign)
        if isinstance(self.player, AttachedPlayer):
            self.player.attach(session)
        return session

    async def _settle(
        self, reply: PendingReply, results: Mapping[str, Any] = MappingProxyType({}), end: int | None = None
    ) -> None:
        """Answer what is open of a reply, in the order of the message: with the host's results, or in its name.

        `end` is the position of the first call that stays open, by default none.
        """
        async with self._calling:
            if any(slot.result is None for slot in reply.slots[:end]):
                await asyncio.to_thread(self._settle_open, reply, results, end)

    def _settle_open(self, reply: PendingReply, results: Mapping[str, Any], end: int | None) -> None:
        slots, unsent = [slot for slot in reply.slots[:end] if slot.result is None], reply.slots[reply.end :]
        messages: list[Message] = []
        for slot in slots:
            if slot.host_id in results:
                messages.append({"role": "tool", "tool_call_id": slot.call.id, "content": results[slot.host_id]})
            slot.is_delivered = True
        ours = [slot for slot in slots if not slot.is_foreign and (slot.name is None or slot in unsent)]
        play = dict.fromkeys(slot.call.id for slot in ours)
        offered = {slot.call.name for slot in slots if slot.name is not None}
        answers = self._chat.settle(messages, play=play, offered=offered, end=end)
        for slot in slots:
            slot.result = answers.get(slot.call.id)

    async def _ask(self, session: AgentSession) -> Reply | None:
        """Return the model's next reply; None when the episode is over, as where a player has left."""
        try:
            return await session.aask(self._send)
        except PlayerLeftError:
            return None

    async def _send(self, prompt: Prompt) -> Reply:
        """Ask the model. Where it gives no reply the episode ends, and the host is told so whenever it asks.

        A player whose every request is refused ends nothing: with its account in order, the next request asks again.
        """
        await self._is_awaited.wait()
        try:
            reply = await reply_of(self.player, prompt)
            message = assistant_message(reply.message)
        except PromptRefusedError:
            raise
        except Exception as error:
            assert self._chat.session is not None
            if isinstance(error, ModelRefusedError):
                self._chat.session.spend(error.usage)
                raise RequestError(502, str(error), code="player_refused") from error
            self._chat.session.give_up(error)
            if isinstance(error, PlayerLeftError):
                raise
            problem = f"The model gave no reply, which ends the episode: {error}"
            self._failure = RequestError(500, problem, code="player_failed")
            raise self._failure from error
        spent = self._counted(message).replaced_by(reply.usage)
        # The host is always sent a whole reply; clients raise errors where an answer says that it was cut.
        self._spent += spent.model_copy(update={"cut": 0})
        return Reply(message, reply.usage)

    def _counted(self, message: Message) -> Usage:
        """Return our count of a reply and of the prompt it answers."""
        return Usage(prompt=self.prompt_tokens, reply=self.episode.counter.message(message))

    # What the host is sent.

    def _pending(self, turn: Turn, usage: Usage, tools: HostTools, *, one_call: bool = False) -> PendingReply:
        session = self._chat.session
        assert session is not None
        foreign = {tool.name: tools.foreign_names.get(tool.name) for tool in session.foreign_tools}
        return PendingReply.of(turn, usage, own=tools.names, foreign=foreign, call_id=self._call_id, one_call=one_call)

    def _of_record(self, tools: HostTools, *, one_call: bool = False) -> PendingReply | None:
        """Return the latest reply of a session that continues from its record, if the host was sent it."""
        session = self._chat.session
        if session is None or session.latest_turn is None:
            return None
        usage = self._counted(session.latest_turn.assistant)
        pending = self._pending(session.latest_turn, usage, tools, one_call=one_call)
        self._sent |= {slot.host_id for slot in pending.sent}
        return pending if pending.sent else None

    def _last_words(self, request: CompletionRequest, tools: HostTools) -> PendingReply:
        is_over = self.episode.words("game_is_over")
        message: Message = {"role": "assistant", "content": in_schema(request, is_over)}
        if tools.closing is not None:
            message = {**message, "tool_calls": [tools.close(self._call_id(-1, 0), is_over)]}
        return PendingReply(message, self._spent)

    def _error(self, text: str) -> ToolResult:
        return ToolResult(text, is_error=True, done=self.episode.done, data={"step": self.episode.progress.steps})

    def ignored_of(self, request: CompletionRequest) -> str:
        """Say which parts of a request do not reach the model."""
        if self._latest is not None:
            request.ignored.kinds.update(f"edited result of {name}" for name in self._latest.edited(request.results))
        return self._notices.of(request, self._tell_apart(request))

    @property
    def ignored(self) -> str:
        """The parts of the host's requests that have not reached the model."""
        side = [f"{count:,} requests {kind}" for kind, count in self._side.counts.items()]
        return ", ".join(filter(None, [self._notices.latest, *side]))
