"""AgentSession and Conversation: an episode as a chat, for the agent of a host and for a loop of your own.

In an `AgentSession` the host's framework runs the tool calls one by one. There are two phases, because a host may
stop, edit or reject a call between the reply and its execution: `receive` charges a reply and opens its turn without
playing, `answer` plays one call. A `Conversation` plays all calls of a reply at once.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from smartplay_tools.conversation.base import AnyReply, CheckedReply, check_episode
from smartplay_tools.conversation.tool_calls import ToolConversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, PromptRefusedError
from smartplay_tools.types import Prompt, Reply, ToolResult, ToolSpec
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import Call

R = TypeVar("R", bound=Reply)


class AgentSession(ToolConversation):
    """An episode as a chat whose calls are answered one by one, by the framework of the host's agent.

    Arguments:
        episode: a fresh episode whose context is "window".
        player: the player's name, for the record.
        head: messages that the host wants before the first reply, after the system and task messages.
        foreign_tools: other tools of the host's agent. They are counted and shown; their calls are left to the host,
            which gives their results to `add`.
        summaries: whether the host makes another model call where a prompt asks for a summary
            (`Prompt.purpose`). Without it, a budget that asks for summaries is refused.
        pictures: whether the host gives its model the pictures of results (`ToolResult.picture`) and of prompts
            (`Prompt.pictures`). Without it, an episode whose observations are pictures is refused.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        player: str | None = None,
        head: Sequence[Mapping[str, Any]] = (),
        foreign_tools: Sequence[ToolSpec] = (),
        summaries: bool = False,
        pictures: bool = False,
    ) -> None:
        check_episode(episode)
        if not pictures:
            episode.refuse_pictures("This host", has_option=True)
        if (asking := episode.ledger.strategies.asking) is not None and not summaries:
            raise InvalidArgumentError(
                f"{asking} takes additional model calls, which this host does not make; leave it out here."
            )
        super().__init__(episode, player=player, head=head, foreign_tools=foreign_tools)

    def receive(self, reply: AnyReply) -> tuple[Call, ...]:
        """Take the reply to the latest prompt: validate, record and charge it, and return its calls (`Call`).

        The reply to a prompt for a summary is not a turn and returns no calls.

        `reply` is an assistant message in chat form or a `Reply`, whose usage is recorded next to our count; anything
        else raises `InvalidArgumentError` and changes nothing. A reply without a call is answered at once.
        """
        return self.open_turn(CheckedReply.of(reply))

    def ask(self, send: Callable[[Prompt], R]) -> R | None:
        """Return the reply to the next prompt to play, for `receive`; None when the episode is over.

        `send` sends a prompt to the model. Where a summary is owed, it is called with the prompt for that first, and
        the summary is taken here; it stays if a later call of `send` raises. What `send` raises is noted (`fail`); a
        `PromptRefusedError` ends the episode.
        """
        while (prompt := self.prompt()) is not None:
            try:
                reply = send(prompt)
            except PromptRefusedError as error:
                self.give_up(error)
                return None
            except Exception as error:
                self.fail(error)
                raise
            if prompt.purpose == "play":
                return reply
            self.receive(reply)
        return None

    async def aask(self, send: Callable[[Prompt], Awaitable[R]]) -> R | None:
        """Return the reply to the next prompt to play as `ask` does, without blocking the event loop for long."""
        while (prompt := await self.aprompt()) is not None:
            try:
                reply = await send(prompt)
            except PromptRefusedError as error:
                self.give_up(error)
                return None
            except Exception as error:
                self.fail(error)
                raise
            if prompt.purpose == "play":
                return reply
            await self.areceive(reply)
        return None

    def edit(self, call_id: str, arguments: Any) -> None:
        """Replace the arguments of an open call before it is played; the record contains both versions."""
        with self.episode.lock:
            position = self._own(call_id)
            if position in self._results:
                raise InvalidArgumentError(f"The call {call_id} has been played; it can no longer be changed.")
            self._edits[position] = read(arguments).text

    def refuse(self, call_id: str, text: str) -> ToolResult:
        """Refuse an open call: its result is the host's text, and the record says that the host refused it."""
        with self.episode.lock:
            return self.answer_at(self._own(call_id), refusal=text)

    def answer(self, call_id: str, arguments: Any = None, *, earlier: bool = True, key: str = "") -> ToolResult:
        """Play one call and return its result; a call that is already answered returns the same result again.

        Calls are played in the order of the message: earlier calls that are still open are played first, as the model
        sent them. With `earlier=False` they stay open, for a host that has refused them and says so later; they can
        then only be refused. Calls of tools that do not exist are answered, too, because no host runs them.
        `arguments` that differ from the model's have the effect of `edit`. `key` is the transport's idempotency key,
        for the record.
        """
        with self.episode.lock:
            position = self._own(call_id)
            current = self._edits.get(position, self._builder.calls[position].arguments.text)
            if arguments is not None and read(arguments).canonical != read(current).canonical:
                self.edit(call_id, arguments)
            kept = self._foreign if earlier else self._foreign | {tool.name for tool in self.episode.tools}
            for before in () if position in self._results else self._builder.waiting:
                if before < position and self._builder.calls[before].name not in kept:
                    self.answer_at(before)
            return self.answer_at(position, key=key)

    async def areceive(self, reply: AnyReply) -> tuple[Call, ...]:
        """Take a reply as `receive` does, without blocking the event loop for long."""
        return await self._away(partial(self.receive, CheckedReply.of(reply)))

    async def aanswer(self, call_id: str, arguments: Any = None, *, earlier: bool = True, key: str = "") -> ToolResult:
        """Play one call as `answer` does; where that may be slow, in a thread instead of the event loop."""
        return await self._away(lambda: self.answer(call_id, arguments, earlier=earlier, key=key))

    def _settle(self, call: Call) -> None:
        """Answer a call that is still open when the next prompt is asked for."""
        self.refuse(call.id, self.episode.words("not_run"))


class Conversation(ToolConversation):
    """An episode as a chat: `prompt` says what to send, `receive` takes the reply and plays all its calls.

    `play` and `aplay` are loops over these two methods, and you can write your own. The arguments are those of
    `AgentSession`, without `summaries` and `pictures`.
    """

    def receive(self, reply: AnyReply) -> list[ToolResult]:
        """Take the reply to the latest prompt: charge it, play its calls, and return the results in order.

        The reply to a prompt for a summary is not a turn: none of its calls is played, and there are no results.
        `reply` is an assistant message in chat form or a `Reply`; anything else raises `InvalidArgumentError` and
        changes nothing. The provider's usage is recorded next to our count, and the tokens that the model drew beside
        the message. Calls after the end of the game are refused.
        """
        checked = CheckedReply.of(reply)
        with self.episode.lock:
            calls = self.open_turn(checked)
            return [self.answer_at(at) for at, call in enumerate(calls) if call.name not in self._foreign]

    async def areceive(self, reply: AnyReply) -> list[ToolResult]:
        """Take a reply as `receive` does, without blocking the event loop for long."""
        return await self._away(partial(self.receive, CheckedReply.of(reply)))

    def _settle(self, call: Call) -> None:
        # Only in a resumed record: the episode was interrupted before all calls of the reply were played.
        self.answer_at(self._own(call.id))
