"""ToolConversation: turns of tool calls in a context window, the base class of `Conversation` and `AgentSession`.

It has the code that every adapter would otherwise repeat: unique call ids, results in the order of the calls, replies
without a call, other tools of the host, and the end. The two subclasses decide when a call is played.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from smartplay_tools.context.prompts.history import sent_head
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.choices import Strategy
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import View
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.conversation.base import BaseConversation, CheckedReply, Pending
from smartplay_tools.episode import budgets
from smartplay_tools.episode.config import ProtocolName
from smartplay_tools.episode.episode import Episode
from smartplay_tools.episode.stats import UNANSWERED
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.hashing import prompt_sha256, tools_bytes
from smartplay_tools.types import Progress, ToolResult, ToolSpec
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import Call, Message, head_messages, host_message, text_of
from smartplay_tools.types.result import UNUSUAL_ENDS

IDLE_REPLIES = 3
"""The number of replies in a row without a tool call that ends an episode."""


class ToolConversation(BaseConversation):
    """What `Conversation` and `AgentSession` share: turns of tool calls in a context window.

    The arguments are those of `AgentSession`, without `summaries` and `pictures`.
    """

    protocol: ProtocolName = "tools"

    def __init__(
        self,
        episode: Episode,
        *,
        player: str | None = None,
        head: Sequence[Mapping[str, Any]] = (),
        foreign_tools: Sequence[ToolSpec] = (),
    ) -> None:
        whole_head, tools = self._use_head(episode, head, foreign_tools)
        strategies = episode.ledger.strategies
        self._has_strategies = bool(episode.budget.strategies)
        self._idle_in_a_row = 0
        self._prompt_tokens: int | None = None
        """The tokens of the prompt that the latest reply answers; None if it answers none."""
        self._results: dict[int, ToolResult] = {}
        self._edits: dict[int, str] = {}
        facts: dict[str, Any] = {"compacts": True} if strategies.compacts else {}
        aged_task = episode.ledger.session.aged_task
        if aged_task is not None:
            facts["aged_task"] = text_of(aged_task)
        super().__init__(episode, player=player, head=whole_head, tools=tools, **facts)
        # A compactor may also rewrite what stands between the system message and the first reply.
        always = 1 if strategies.compacts else len(whole_head)
        given = tools, episode.budget, episode.counter, strategies
        self._window = ContextWindow(whole_head[:always], *given, lead=whole_head[always:], aged_task=aged_task)
        if isinstance(strategies.custom, Strategy):
            from smartplay_tools.context.choosing import choosing

            self._window.follow(choosing(self._window, strategies.custom))
        elif strategies.compacts:
            self._rewrite(strategies)

    def _rewrite(self, strategies: Strategies) -> None:
        """Have a compactor make the prompts of the window."""
        from smartplay_tools.context.compacting import Compacting
        from smartplay_tools.context.compaction import Compactor

        window, compactor = self._window, strategies.custom
        assert isinstance(compactor, Compactor)
        compacting = Compacting(
            window,
            compactor if strategies.calls_compactor else None,
            recorded=strategies.recorded_rewritings,
            ids=self._ids,
            record=self._ledger.record,
        )
        window.follow(compacting.make, by_words=True)
        self._ledger.at_end = window.close

    def _use_head(
        self, episode: Episode, head: Sequence[Mapping[str, Any]], foreign_tools: Sequence[ToolSpec]
    ) -> tuple[list[Message], tuple[ToolSpec, ...]]:
        """Take note of the host's messages and tools; return the whole head and all tools."""
        if clash := {tool.name for tool in foreign_tools} & {tool.name for tool in episode.tools}:
            raise InvalidArgumentError(f"The game's own tools are named {', '.join(sorted(clash))}; rename yours.")
        host_head, tools = sent_head(head_messages(head), episode.words.version), (*episode.tools, *foreign_tools)
        whole_head = [*episode.head, *host_head]
        if episode.budget.prompt_tokens is not None:
            budgets.check_head(episode.budget, episode.counter.prompt(whole_head, tools), episode.ledger.strategies)
        self._foreign, self._tools_bytes = {tool.name for tool in foreign_tools}, tools_bytes(tools)
        self.host_head: Sequence[Message] = host_head
        """The host's messages in every prompt, after the system and task messages."""
        self.foreign_tools = tuple(foreign_tools)
        """The other tools of the host's agent."""
        return whole_head, tools

    def change_head(
        self, head: Sequence[Mapping[str, Any]], foreign_tools: Sequence[ToolSpec], *, keeps_first_view: bool = True
    ) -> None:
        """Replace the host's messages and its other tools from the next prompt on; the record says from which.

        Hosts change instructions and tools during a run: a prompt that depends on the state, an agent that hands over
        to another. Nothing happens if both are what they were. Only for records without the turn of a changed head,
        `keeps_first_view` is False: their prefix of the second prompt was counted as if the first had that head.
        """
        with self.episode.lock:
            if self.episode.result is not None:
                return
            asked = sent_head(head_messages(head), self.episode.words.version), tuple(foreign_tools)
            if asked == (list(self.host_head), self.foreign_tools):
                return
            if self._pending is not None or self._foreign_waiting():
                raise InvalidArgumentError(
                    "Change the head between a reply, with the results of its foreign calls, and the next prompt."
                )
            if self._ledger.strategies.asking is not None:
                raise InvalidArgumentError(
                    "Where turns are summarised or rewritten, the head of an episode cannot change."
                )
            whole_head, tools = self._use_head(self.episode, head, foreign_tools)
            turn = self.episode.stats.turns
            self._window.change_head(whole_head, tools, begins=turn == 0 or not keeps_first_view)
            self._record_head(whole_head, tools, **({"since": turn} if keeps_first_view else {}))

    @property
    def progress(self) -> Progress:
        """The state of the episode: score, reward, steps and, once it is over, the reason."""
        return self.episode.progress

    @property
    def message(self) -> Message | None:
        """The latest reply with the call ids of the conversation; None before the first."""
        turn = self.latest_turn
        return None if turn is None else turn.assistant

    @property
    def open_calls(self) -> tuple[Call, ...]:
        """The game's own calls of the latest reply that are not answered yet, in the order of the message."""
        waiting, calls = self._builder.waiting, self._builder.calls
        return tuple([calls[at] for at in waiting if calls[at].name not in self._foreign]) if waiting else ()

    def open_turn(self, reply: CheckedReply) -> tuple[Call, ...]:
        """Record and charge a reply and open its turn, and return its calls; nothing is played.

        The reply to a prompt for a summary opens no turn and has no calls that could be played.
        """
        with self.episode.lock:
            pending = self._prepare()
            if pending is not None and pending.view.purpose != "play":
                self._take_words(pending, reply)
                return ()
            calls = self._record_reply(reply, pending)
            self._prompt_tokens = None if pending is None else pending.view.tokens
            if pending is not None:
                self._ledger.strategies.answers(pending.view)
            self._results, self._edits = {}, {}
            self._idle_in_a_row = 0 if calls else self._idle_in_a_row + 1
            if not calls:
                self._answer_idle_reply(reply.usage or {})
            return calls

    def _take_words(self, pending: Pending, reply: CheckedReply) -> None:
        """Record and charge the reply to a prompt for words, a summary or the answer to a question."""
        turn, view = self.episode.stats.turns, pending.view
        facts = self._window.answer(text_of(reply.message))
        if view.purpose == "summary":
            event = {**reply.event("summary", turn, covers=facts.pop("covers")), **facts}
        else:
            event = {**reply.event("question", turn, tokens=view.tokens), "reply": reply.message}
        cost = self._charged(pending, reply.message, self.episode.counter.message(reply.message))
        self._ledger.record(
            event, {"event": "usage", "turn": turn, "purpose": view.purpose, **cost, "provider": reply.usage}
        )
        self._pending, self._ledger.if_closed = None, None

    def add(self, message: Mapping[str, Any]) -> None:
        """Add a user message, or the result of a foreign tool, after the latest reply and before the next prompt.

        A result for an open call of the game refuses that call: the host has answered in the game's place. After the
        end of the episode there is no next prompt, and nothing is added.
        """
        clean = host_message(message)
        with self.episode.lock:
            if self.episode.result is not None:
                return
            if not self._builder.is_open:
                raise InvalidArgumentError(
                    "Add messages between a reply and the next prompt; earlier ones belong in `head`."
                )
            if clean["role"] == "tool":
                position = self._waiting(clean["tool_call_id"])
                if self._builder.calls[position].name not in self._foreign:
                    self.answer_at(position, refusal=text_of(clean))
                    return
                clean["tool_call_id"] = self._builder.calls[position].id
                self._add(clean, "host", position)
            elif clean["role"] != "user":
                raise InvalidArgumentError("After the first reply a host adds user messages and tool results only.")
            elif waiting := self._foreign_waiting():
                raise InvalidArgumentError(f"The foreign calls {waiting} need their results before a user message.")
            else:
                self._add(clean, "host", None)

    def _next_view(self) -> View:
        return self._window.view()

    def _shown(self, view: View) -> dict[str, Any]:
        chosen = view.selection
        encoded = self._tools_bytes if view.tools else tools_bytes(())
        sha256 = prompt_sha256(Form.lines(view.forms), encoded)
        if not self._has_strategies:
            return {"turns": chosen.ranges, "masked": view.masked_results, "sha256": sha256}
        # What is masked follows from these; a list of it would grow with the window.
        why = {"oldest": chosen.oldest, **self._ledger.strategies.recorded(chosen), **view.facts}
        return {"turns": chosen.ranges, "purpose": view.purpose, **why, "summary": view.summaries, "sha256": sha256}

    def _complete_turn(self) -> None:
        if self._builder.waiting:
            if (waiting := self._foreign_waiting()) and not self.episode.done:
                raise InvalidArgumentError(f"The foreign calls {waiting} have no result yet: `add` them.")
            for call in self.open_calls:
                self._settle(call)
        self._builder.close()
        for turn in self._builder.turns[len(self._window.turns) :]:
            self._window.append(turn)

    @abstractmethod
    def _settle(self, call: Call) -> None:
        """Answer a call that is still open when the next prompt is asked for."""

    def answer_at(
        self, position: int, *, refusal: str | None = None, edited: str | None = None, key: str = ""
    ) -> ToolResult:
        """Answer the call at a position: with the host's text if there is a `refusal`, with arguments `edited` by it.

        A call of a foreign tool is answered here if no tool has run: its arguments are not an object, the tool is no
        longer offered, or the host has left the call open. The host's results are for `add`. `key` is the transport's
        idempotency key.

        A call is not played after a later one of its message, or observations would not be shown in their order. Such a
        call can only be refused; playing it raises an `InvalidArgumentError`.
        """
        if position in self._results:
            return self._results[position]
        calls = self._builder.calls
        call = calls[position]
        is_foreign = call.name in self._foreign
        answered = self._answered() if self._results else []
        if refusal is None and not is_foreign and answered and position < max(answered):
            raise InvalidArgumentError(
                f"The call {call.id} comes before one that has been answered: answer the calls of a message in their "
                "order, or refuse the earlier one."
            )
        if edited is not None:
            self._edits[position] = edited
        arguments = call.arguments
        if position in self._edits and refusal is None:
            arguments = read(self._edits[position])
        may_act = (
            not answered
            or self.episode.config.batch == "all"
            or "act" not in [calls[at].name for at in answered if at < position]
        )
        result = self._ledger.answer(
            self._builder.number,
            position,
            call.name,
            arguments,
            may_act=may_act,
            host="refused" if refusal is not None else "edited" if arguments is not call.arguments else None,
            refusal=refusal,
            is_foreign=is_foreign,
            key=key,
            prompt_tokens=self._prompt_tokens,
        )
        if arguments is not call.arguments:
            self._builder.edit(position, arguments.text)
        self._builder.add_result(position, result.text, result.data, is_error=result.is_error)
        if result.picture is not None:
            self._keep_picture(result.picture)
        if not self._builder.waiting:
            self._ledger.complete_turn()
            if self.episode.done:
                result = replace(result, done=True)
        elif not self.open_calls:
            self._ledger.finish_if_over()
        self._results[position] = result
        return result

    def _answered(self) -> list[int]:
        """The positions of the message's own calls that the game answered before it was over."""
        calls, foreign = self._builder.calls, self._foreign
        return [
            at
            for at, result in self._results.items()
            if calls[at].name not in foreign and result.data.get("mistake") not in UNANSWERED
        ]

    def _own(self, call_id: str) -> int:
        """The position of a call of the latest reply that this library answers."""
        for position, call in enumerate(self._builder.calls):
            if call.id == call_id:
                if call.name in self._foreign and position not in self._results:
                    raise InvalidArgumentError(
                        f"{call_id} is a call of {call.name}, not of the game: `add` its result."
                    )
                return position
        raise InvalidArgumentError(f"The latest reply has no call with the id {call_id!r}.")

    def _waiting(self, call_id: str) -> int:
        """The first call without a result that has this id, be it the conversation's or the model's."""
        waiting, calls = self._builder.waiting, self._builder.calls
        by_id = [at for at in waiting if calls[at].id == call_id]
        sent = [at for at in waiting if calls[at].sent_id == call_id]
        # If a model gave several calls the same id, a result belongs to the foreign ones first.
        sent.sort(key=lambda at: calls[at].name not in self._foreign)
        for position in [*by_id, *sent]:
            return position
        raise InvalidArgumentError(f"No call with the id {call_id!r} waits for a result.")

    def _foreign_waiting(self) -> str:
        calls = self._builder.calls
        return ", ".join(calls[at].id for at in self._builder.waiting if calls[at].name in self._foreign)

    def _add(self, message: Message, by: str, position: int | None) -> None:
        event: Event = {"event": "message", "turn": self._builder.number, "by": by, "message": message}
        if position is not None:
            event["position"] = position
        self._ledger.record(event)
        self._builder.add(message, position)

    def _answer_idle_reply(self, usage: Mapping[str, Any]) -> None:
        self._add({"role": "user", "content": self.episode.words("idle")}, "library", None)
        if self._idle_in_a_row == IDLE_REPLIES:
            why = next((words for name, words in UNUSUAL_ENDS.items() if usage.get(name)), None)
            self.episode.end("no_tool_call", detail=None if why is None else f"The last reply was {why}.")
        self._ledger.complete_turn()
