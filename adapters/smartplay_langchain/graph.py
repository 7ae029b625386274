"""GraphSession: connects the messages in the state of a LangGraph graph with the `AgentSession` of one episode.

The state keeps all messages, and the session decides which of them the model sees. `ask` calls a model with the window
and returns the messages for the state; the `tools`, in a tool node with the session's `wrap_tool_call`, play the calls;
`update` takes over what the graph has added since the latest reply. `SmartPlayMiddleware` does this in an agent of
`create_agent`; a graph of your own has a node that calls `ask` and a tool node.

The state is read from its end to the latest reply, so a turn costs the same at turn 10 and at turn 1,000.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from langchain_core.language_models import BaseChatModel
from langchain_core.messages import AIMessage, AnyMessage, BaseMessage, HumanMessage, SystemMessage, ToolMessage
from langchain_core.tools import BaseTool

from smartplay_langchain.asking import Asked, Bound, PromptSettings, ToolChoice, Tools, asend, bind, send, spec_of
from smartplay_langchain.calls import (
    HELD,
    OURS,
    TURN,
    CallPlayer,
    after_latest_reply,
    another_state,
    artifact_of,
    asked_for,
    is_ours,
)
from smartplay_langchain.messages import from_langchain, to_langchain, usage_of
from smartplay_tools import AgentSession, Episode, InvalidArgumentError, Message, Prompt, ToolResult
from smartplay_tools.messages import Call

NOT_RUN = "Error: The agent did not run this call."
"""The answer to a call that the graph left open."""


class GraphSession(CallPlayer):
    """An episode that the model of a LangGraph graph plays.

    Arguments:
        episode: a fresh episode whose context is "window"; or, to go on with an episode from its record, the session
            of `smartplay_tools.resume(record, session=True)`.
        player: the model's name, for the record.
        limit_field: the name of the model's parameter for the cap on a reply.
        summary_tool_choice: the model's `tool_choice` where a summary is asked for, which is written in words: "none",
            as most models spell it, or `{"type": "none"}` for `ChatAnthropic`.
        foreign_tools: other tools of the graph; their calls are left to its tool node.
    """

    def __init__(
        self,
        episode: Episode | AgentSession,
        *,
        player: str = "langchain",
        limit_field: str = "max_tokens",
        summary_tool_choice: ToolChoice = "none",
        foreign_tools: Sequence[BaseTool | dict[str, Any]] = (),
    ) -> None:
        super().__init__(episode)
        self.prompt_settings = PromptSettings(limit_field, summary_tool_choice)
        self._player, self._other_tools = player, list(foreign_tools)
        self._first: list[Message] | None = None
        """The host's messages before the first reply, without its system texts."""
        self._taken: set[str] = set()
        """The messages after the latest reply that the session has received."""
        self._recorded: list[str] = []
        """The same in a record that is continued: their texts."""
        if self.session is not None and self.session.latest_turn is not None:
            items = self.session.latest_turn.items
            self._recorded = [str(item.message["content"]) for item in items if item.message["role"] == "user"]

    def ask(self, model: BaseChatModel, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Call the model with the next prompt and return the messages for the state.

        Where the window owes a summary, the model is called for it first; that reply is taken here and not added to the
        state. When the episode is over, nothing is asked. A reply that the record already has, because the process
        ended before the graph's checkpoint was written, is returned again without calling the model. If the model
        raises, the episode does not change, and you may ask again; a summary that was taken stays.
        """
        if (known := self.recorded_reply(messages)) is not None:
            return known
        added, tools = self.update(messages), [*self.tools, *self._other_tools]
        prompt = self.prompt(messages, tools=tools)
        if prompt is None:
            return added
        try:
            reply = send(prompt, self._binding(model, tools), self.summarise)
        except Exception as error:
            self.fail(error)
            raise
        return added if reply is None else [*added, *self.receive(Asked(reply))]

    async def aask(self, model: BaseChatModel, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Call the model as `ask` does, without blocking the event loop."""
        import asyncio

        if (known := self.recorded_reply(messages)) is not None:
            return known
        added, tools = await asyncio.to_thread(self.update, messages), [*self.tools, *self._other_tools]
        prompt = await asyncio.to_thread(self.prompt, messages, tools=tools)
        if prompt is None:
            return added
        try:
            reply = await asend(prompt, self._binding(model, tools), self.summarise)
        except Exception as error:
            self.fail(error)
            raise
        return added if reply is None else [*added, *self.receive(Asked(reply))]

    # The parts of it, for the middleware.

    def recorded_reply(self, messages: Sequence[BaseMessage]) -> list[AnyMessage] | None:
        """Return the latest reply, for a state that does not have it yet although the record does; else None."""
        if self.session is None or self.session.latest_turn is None:
            return None
        if (lacked := self.lacked(messages)) == 0:
            return None
        if lacked != 1:
            raise another_state(lacked)
        said = self.session.message
        assert said is not None
        (reply,) = to_langchain([said])
        assert isinstance(reply, AIMessage)
        return self._for_state(reply)

    def update(self, messages: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Take over what the graph has added since the latest reply.

        Returns messages for the state: the results of calls that no tool node has answered, because their arguments
        are not JSON or a middleware stopped them, and the results of calls that were held.
        """
        if self.session is None or self.session.latest_turn is None:
            return []
        since = after_latest_reply(messages)
        with self.episode.lock:
            if not self.session.awaits_reply:
                return self._take(since)
            if any(map(self._is_new, filter(_is_word, since))):
                raise InvalidArgumentError(
                    "The episode awaits the reply to a recorded prompt. Invoke the graph without new messages, "
                    "and add yours after the reply."
                )
            return []

    def prompt(
        self,
        messages: Sequence[BaseMessage],
        *,
        tools: Sequence[BaseTool | dict[str, Any]],
        system: Sequence[SystemMessage] = (),
        added: Sequence[BaseMessage] = (),
    ) -> Prompt | None:
        """Return the next prompt, given the messages in the state; None when the episode is over.

        Messages before the first reply are part of every prompt. So are the system texts and the tools, which may
        change from prompt to prompt. `added` are messages for this prompt that are not in the state.
        """
        own = {tool.name for tool in self.episode.tools}
        specs = [spec_of(tool) for tool in tools]
        if missing := sorted(own - {spec.name for spec in specs}):
            raise InvalidArgumentError(
                f"A middleware has taken {', '.join(missing)} from the request; the game's tools are in every prompt."
            )
        foreign, head = [spec for spec in specs if spec.name not in own], [*map(from_langchain, system)]
        if self.session is None:
            self._first = [from_langchain(message) for message in (*messages, *added)]
            self.session = AgentSession(
                self.episode,
                player=self._player,
                head=[*head, *self._first],
                foreign_tools=foreign,
                summaries=True,
            )
        elif not self.session.awaits_reply:  # a prompt that was made stays as it is, however often it is sent
            self._change(head, foreign, added)
        return self.session.prompt()

    def summarise(self, reply: AIMessage) -> Prompt | None:
        """Take the reply to a prompt for a summary, and return the next prompt; None when the episode is over."""
        assert self.session is not None
        with self.episode.lock:
            self.session.receive(from_langchain(reply), usage_of(reply))
            return self.session.prompt()

    def receive(self, asked: Asked, reply: AIMessage | None = None) -> list[AnyMessage]:
        """Take the model's reply and return it as it belongs into the state; `reply` if a middleware has changed it.

        Its calls have the ids of the session. A reply without a call is followed by the user message that says so.
        """
        assert self.session is not None
        assert asked.said is not None
        for wasted in asked.discarded:
            if (usage := usage_of(wasted)) is not None:
                self.session.spend(usage)
        self._taken, self._recorded = set(), []
        self.begin_turn()
        calls = self.session.receive(from_langchain(asked.said), usage_of(asked.said))
        return self._for_state(_with_ids(reply or asked.said, calls))

    def fail(self, error: Exception) -> None:
        """Note that the model gave no reply: an episode that is closed now ends as `player_error`."""
        if self.session is not None:
            self.session.fail(error)

    def _change(self, head: list[Message], foreign: Sequence[Any], added: Sequence[BaseMessage]) -> None:
        """Take over a system text and tools that have changed, and messages for this prompt."""
        assert self.session is not None
        if self._first is None:
            recorded = list(self.session.host_head)
            systems = [message["role"] for message in recorded[: len(head)]].count("system")
            self._first = recorded[systems:]
        self.session.change_head([*head, *self._first], foreign)
        for message in added:
            if not isinstance(message, HumanMessage):
                raise InvalidArgumentError(
                    f"A middleware added a message of the type {message.type!r} to the prompt during the game; only "
                    "user and system messages can be added."
                )
            if self.session.latest_turn is not None:
                self.session.add(from_langchain(message))

    def _binding(self, model: BaseChatModel, tools: Tools) -> Bound:
        return lambda prompt: bind(model, tools, self.prompt_settings.of(prompt, model), prompt)

    def _for_state(self, reply: AIMessage) -> list[AnyMessage]:
        assert self.session is not None
        turn = self.session.latest_turn
        assert turn is not None
        marked = reply.model_copy(update={"response_metadata": {**reply.response_metadata, TURN: turn.number}})
        if turn.calls:
            return [marked]
        return [marked, HumanMessage(str(turn.items[0].message["content"]), id=f"{OURS}{turn.number}.idle")]

    def _take(self, since: Sequence[BaseMessage]) -> list[AnyMessage]:
        """Take over results in the order of their calls, then user messages; returns messages for the state."""
        assert self.session is not None
        turn = self.session.latest_turn
        assert turn is not None
        results = {message.tool_call_id: message for message in since if isinstance(message, ToolMessage)}
        answered = {item.position for item in turn.items}
        changed: list[AnyMessage] = []
        words: list[BaseMessage] = []
        for position, call in enumerate(turn.calls):
            message, is_open = results.get(call.id), position not in answered
            if message is None and is_open:
                changed.append(self._close(call))
            elif message is not None and is_open and not is_ours(message):
                self.session.add(from_langchain(message))  # an own call is thereby refused: the host has answered
            elif message is not None and is_ours(message):
                artifact = message.artifact or {}
                answer = self.session.answer(call.id, artifact.get("arguments") if is_open else None)
                if HELD in message.text:
                    message = self._message(
                        asked_for(call), message.text.replace(HELD, answer.text), artifact_of(answer)
                    )
                    changed.append(message)
                if note := _note(call, message, answer):
                    words.append(HumanMessage(note, id=f"note {message.id}"))
        for word in [*words, *filter(_is_word, since)]:
            if self._is_new(word):
                self.session.add(from_langchain(word))
        return changed

    def _close(self, call: Call) -> ToolMessage:
        """Answer a call that no tool node has run: in the game's words if its arguments are not a JSON object."""
        assert self.session is not None
        if not self._is_own(call.id):
            self.session.add({"role": "tool", "tool_call_id": call.id, "content": NOT_RUN})
            return self._message(asked_for(call), NOT_RUN, {"is_error": True})
        broken = call.arguments.values is None
        answer = self.session.answer(call.id) if broken else self.session.refuse(call.id, NOT_RUN)
        return self._message(asked_for(call), answer.text, artifact_of(answer))

    def _is_new(self, message: BaseMessage) -> bool:
        """Whether the session has not received a message yet; asked once for each."""
        key = message.id or str(id(message))
        if key in self._taken:
            return False
        self._taken.add(key)
        if message.text in self._recorded:
            self._recorded.remove(message.text)
            return False
        return True


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
        known = ids.get(call["id"] or "")
        return {**call, "id": known.pop(0)} if known else call

    update = {name: [renamed(call) for call in getattr(reply, name)] for name in ("tool_calls", "invalid_tool_calls")}
    return reply.model_copy(update=update)
