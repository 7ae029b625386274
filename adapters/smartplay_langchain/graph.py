"""GraphSession: connects the messages in the state of a LangGraph graph with the `AgentSession` of one episode.

The state keeps all messages, and the session decides which of them the model sees. `ask` calls a model with the window
and returns the messages for the state; the `tools`, in a tool node with the session's `wrap_tool_call`, play the calls;
`update` takes over what the graph has added since the latest reply. `SmartPlayMiddleware` does this in an agent of
`create_agent`; a graph of your own has a node that calls `ask` and a tool node.

The state is read from its end to the latest reply, so a turn costs the same at turn 10 and at turn 1,000.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Any

from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage, AnyMessage, BaseMessage, HumanMessage, SystemMessage, ToolMessage
from langchain_core.tools import BaseTool

from smartplay_langchain.asking import PromptSettings, ToolChoice, Tools, WindowedModel, spec_of
from smartplay_langchain.calls import HELD, OURS, TURN, CallPlayer, after_latest_reply, is_ours
from smartplay_langchain.messages import from_langchain, to_langchain
from smartplay_langchain.toolkit import artifact_of, is_of_a_game
from smartplay_tools import AgentSession, Episode, InvalidArgumentError, Message, ToolResult
from smartplay_tools.conversation import HostChat, HostHistory
from smartplay_tools.players.cache_marks import CacheMarks, checked_marks
from smartplay_tools.types.messages import Call


class GraphSession(CallPlayer):
    """An episode that the model of a LangGraph graph plays.

    Arguments:
        episode: a fresh episode whose context is "window"; or, to go on with an episode from its record, the session
            of `smartplay_tools.resume(record, session=True)`.
        player: the model's name, for the record.
        limit_field: the name of the model's parameter for the cap on a reply.
        summary_tool_choice: the model's `tool_choice` where a summary is asked for, which is written in words: "none",
            as most models spell it, or `{"type": "none"}` for `ChatAnthropic`.
        cache: what is sent for the provider's cache, as for `LangChainPlayer`.
        foreign_tools: other tools of the graph; their calls are left to its tool node.
        pictures: whether the model sees pictures; without it, an episode whose observations are pictures is refused.
    """

    def __init__(
        self,
        episode: Episode | AgentSession,
        *,
        player: str = "langchain",
        limit_field: str = "max_tokens",
        summary_tool_choice: ToolChoice = "none",
        cache: CacheMarks = True,
        foreign_tools: Sequence[BaseTool | dict[str, Any]] = (),
        pictures: bool = False,
    ) -> None:
        super().__init__(HostChat(episode, player=player, not_run="agent_did_not_run", pictures=pictures))
        self._history = HostHistory[BaseMessage](self.episode.counter, lambda message: (message.id, str(message.text)))
        self.prompt_settings = PromptSettings(limit_field, summary_tool_choice, checked_marks(cache))
        self._all_tools = [*self.tools, *foreign_tools]

    def ask(self, model: BaseChatModel, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Call the model with the next prompt and return the messages for the state.

        Where the window owes a summary, the model is called for it first; that reply is taken here and not added to the
        state. When the episode is over, nothing is asked. A reply that the record already has, because the process
        ended before the graph's checkpoint was written, is returned again without calling the model. If the model
        raises, the episode does not change, and you may ask again; a summary that was taken stays. An agent in a tool
        of this one is answered in words.
        """
        if (known := self._without_asking(messages)) is not None:
            return known
        added, windowed = self.update(messages), self.windowed(model, messages)
        windowed.bind_tools(self._all_tools).invoke(messages)
        return [*added, *self._reply_of(windowed)]

    async def aask(self, model: BaseChatModel, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Call the model as `ask` does, without blocking the event loop."""
        if (known := self._without_asking(messages)) is not None:
            return known
        added, windowed = await asyncio.to_thread(self.update, messages), self.windowed(model, messages)
        await windowed.bind_tools(self._all_tools).ainvoke(messages)
        return [*added, *self._reply_of(windowed)]

    def _without_asking(self, messages: Sequence[BaseMessage]) -> list[AnyMessage] | None:
        """Return the notice for a sub-agent, or the recorded reply that the state lacks; None to ask a model."""
        if self.is_asked_by_sub_agent:
            return [AIMessage(self.episode.words("sub_agent"))]
        return self.recorded_reply(messages)

    def _reply_of(self, asked: WindowedModel) -> list[AnyMessage]:
        return [] if asked.is_over else self.receive(asked)

    # The parts of it, for the middleware.

    def recorded_reply(self, messages: Sequence[BaseMessage]) -> list[AnyMessage] | None:
        """Return the latest reply, for a state that does not have it yet although the record does; else None."""
        if self.session is None or self.session.latest_turn is None:
            return None
        if (lacked := self.lacked(messages)) == 0:
            return None
        if lacked != 1:
            raise self.another_state(lacked)
        assert self.session.message is not None
        (reply,) = to_langchain([self.session.message])
        assert isinstance(reply, AIMessage)
        return self._for_state(reply)

    def update(self, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Take over what the graph has added since the latest reply.

        Returns messages for the state: the results of calls that no tool node has answered, because their arguments
        are not JSON or a middleware stopped them, and the results of calls that were held.
        """
        if self.session is None:
            if self.episode.done and self.episode.stats.tool_calls:  # another agent has played it
                raise self.another_state(0)
            return []
        self._history.see(messages)
        with self.episode.lock:
            if self.session.awaits_reply:
                self._chat.refuse_late_words(map(from_langchain, filter(_is_word, messages)))
            elif self.session.latest_turn is not None:
                return self._take(after_latest_reply(messages))
            return []

    def prepare(
        self,
        messages: Sequence[BaseMessage],
        system: Sequence[SystemMessage],
        added: Sequence[BaseMessage],
        tools: Tools,
    ) -> AgentSession:
        """Return the session, ready for its next prompt, given the messages in the state.

        Messages before the first reply are part of every prompt. So are the system texts and the tools, which may
        change from prompt to prompt. `added` are messages for this prompt that are not in the state.
        """
        own = {tool.name for tool in self.episode.tools}
        specs = [spec_of(tool) for tool in tools]
        self.check_names((spec.name, tool) for spec, tool in zip(specs, tools, strict=True))
        if missing := sorted(own - {spec.name for spec in specs}):
            raise InvalidArgumentError(
                f"A middleware has removed {', '.join(missing)}; every request must offer the game's tools."
            )
        foreign = [spec for spec in specs if spec.name not in own]
        head = [*map(from_langchain, system)]
        if self.session is None:
            first = map(from_langchain, (*messages, *added))
            return self._chat.begin(first, system=head, foreign_tools=foreign)
        if not self.session.awaits_reply:  # a prompt that was made stays as it is, however often it is sent
            self._chat.change(system=head, foreign_tools=foreign)
            self._add(added)
        return self.session

    def windowed(self, model: BaseChatModel, messages: Sequence[BaseMessage]) -> WindowedModel:
        """Return what asks the model with the next prompt, given the messages in the state."""
        return WindowedModel(model, messages, partial(self.prepare, messages), self.prompt_settings)

    def receive(self, asked: WindowedModel, reply: AIMessage | None = None) -> list[AnyMessage]:
        """Take the model's reply and return it for the state; `reply` is given if a middleware has changed it.

        Its calls have the ids of the session. A reply without a call is followed by the user message that says so.
        """
        assert asked.reply is not None
        for wasted in asked.discarded:
            if wasted.usage is not None:
                self._session.spend(wasted.usage)
        self.begin_turn()
        calls = self._session.receive(asked.reply)
        return self._for_state(_with_ids(reply or asked.reply.source, calls))

    def _add(self, added: Sequence[BaseMessage]) -> None:
        """Add a middleware's messages for this prompt."""
        for message in added:
            if not isinstance(message, HumanMessage):
                raise InvalidArgumentError(
                    f"A middleware added a message of the type {message.type!r} to the prompt during the game; only "
                    "user and system messages can be added."
                )
            if self._session.latest_turn is not None:
                self._session.add(from_langchain(message))

    def _for_state(self, reply: AIMessage) -> list[AnyMessage]:
        turn = self._session.latest_turn
        assert turn is not None
        marked = reply.model_copy(update={"response_metadata": {**reply.response_metadata, TURN: turn.number}})
        if turn.calls:
            return [marked]
        return [marked, HumanMessage(str(turn.items[0].message["content"]), id=f"{OURS}{turn.number}.idle")]

    def _take(self, since: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Take over results in the order of their calls, then user messages; returns messages for the state."""
        turn = self._session.latest_turn
        assert turn is not None
        results = {message.tool_call_id: message for message in since if isinstance(message, ToolMessage)}
        ours = {call_id: message for call_id, message in results.items() if is_ours(message)}
        play = {call_id: (message.artifact or {}).get("arguments") for call_id, message in ours.items()}
        others = [message for call_id, message in results.items() if call_id not in ours]
        # A tool node without `wrap_tool_call` may have run the tools of a toolkit.
        self.check_names((str(message.name), message) for message in others if is_of_a_game(message))
        theirs = map(from_langchain, others)
        answers = self._chat.settle(theirs, play=play)
        changed: list[AnyMessage] = []
        notes: list[Message] = []
        for call in turn.calls:
            if call.id in ours:
                message, answer = ours[call.id], self._session.answer(call.id)
                if HELD in message.text:
                    text = message.text.replace(HELD, answer.text)
                    message = self._message(call.id, call.name, text, artifact_of(answer))
                    changed.append(message)
                if note := _note(call, message, answer):
                    notes.append({"role": "user", "content": note})
            elif call.id not in results and (made := answers.get(call.id)) is not None:
                changed.append(self._message(call.id, call.name, made.text, artifact_of(made)))
        self._chat.hear([*notes, *map(from_langchain, filter(_is_word, since))])
        return changed


def _is_word(message: BaseMessage) -> bool:
    return isinstance(message, HumanMessage) and not (message.id or "").startswith(OURS)


def _note(call: Call, message: ToolMessage, answer: ToolResult) -> str:
    """Return what a middleware has written around the game's answer, for the model to read."""
    text = message.text
    if answer.text not in text:
        raise InvalidArgumentError(
            f"A middleware has changed the result of {call.name} ({call.id}). The game's results are recorded as they "
            "are; it may add text to them, or answer the call in the game's place."
        )
    return text.replace(answer.text, "", 1).strip()


def _with_ids(reply: AIMessage, calls: Sequence[Call]) -> AIMessage:
    """Return a reply whose calls have the ids of the session; it may lack calls, if a middleware removed some."""
    ids: dict[str, list[str]] = {}
    for call in calls:
        ids.setdefault(call.sent_id, []).append(call.id)

    def renamed(call: Any) -> Any:
        left = ids.get(call["id"] or "")
        return {**call, "id": left.pop(0)} if left else call

    update = {name: [renamed(call) for call in getattr(reply, name)] for name in ("tool_calls", "invalid_tool_calls")}
    return reply.model_copy(update=update)
