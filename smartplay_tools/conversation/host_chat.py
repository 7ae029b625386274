"""HostChat: an episode in the chat of a host that keeps the messages itself.

A LangGraph graph, an agent framework's runner or a client of the window endpoint has a list of all messages, to which
it adds results and further words. An adapter converts the new messages to canonical form; what each of them means
for the episode's session is decided here, in the order of the calls.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from types import MappingProxyType
from typing import Any

from smartplay_tools.conversation.agent_session import AgentSession
from smartplay_tools.conversation.base import check_episode
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import ToolResult, ToolSpec
from smartplay_tools.types.messages import Message, text_of, words_of
from smartplay_tools.visible import logger

log = logger("smartplay_tools.conversation")


class HostChat:
    """The session of an episode, and what the host's list of messages means for it.

    Arguments:
        episode: a fresh episode whose context is "window"; or, to go on with an episode from its record, the session
            of `smartplay_tools.resume(record, session=True)`.
        player: the player's name, for the record; None for a host that names it in `begin`.
        not_run: the name, in `Wording`, of the answer to a call that the host has left open.
        no_result: the same for a call of one of the host's own tools; `not_run` if not given.
        pictures: whether the host gives its model pictures (see `AgentSession`).
    """

    def __init__(
        self,
        episode: Episode | AgentSession,
        *,
        player: str | None,
        not_run: str = "not_run",
        no_result: str | None = None,
        pictures: bool = False,
    ) -> None:
        self.session = episode if isinstance(episode, AgentSession) else None
        """The session; None before the first prompt."""
        self.episode = episode.episode if isinstance(episode, AgentSession) else episode
        self._player, self._pictures = player, pictures
        check_episode(self.episode)
        words = self.episode.words
        self._not_run, self._no_result = words(not_run), words(no_result or not_run)
        if not pictures:
            self.episode.refuse_pictures("This host", has_option=True)
        self._is_told = False
        """Whether it has been logged that results have parts that the model is not shown."""
        self._first: list[Message] | None = None
        """The host's messages before the first reply, without its system texts."""

    def begin(
        self,
        first: Iterable[Message] = (),
        *,
        system: Sequence[Message] = (),
        foreign_tools: Sequence[ToolSpec] = (),
        player: str | None = None,
    ) -> AgentSession:
        """Begin the session with the host's system texts, the messages that it has so far, and its other tools."""
        self._first = list(first)
        self.session = AgentSession(
            self.episode,
            player=self._player or player,
            head=[*system, *self._first],
            foreign_tools=foreign_tools,
            summaries=True,
            pictures=self._pictures,
        )
        return self.session

    def change(self, *, system: Sequence[Message] = (), foreign_tools: Sequence[ToolSpec] = ()) -> None:
        """Take over system texts and tools, which hosts change during a run."""
        session = self._begun
        if session.awaits_reply:
            return  # a prompt that was made stays as it is, however often it is sent
        if self._first is None:
            recorded = list(session.host_head)
            self._first = recorded[[message["role"] for message in recorded[: len(system)]].count("system") :]
        session.change_head([*system, *self._first], foreign_tools)

    def settle(
        self,
        messages: Iterable[Message],
        *,
        play: Mapping[str, Any] = MappingProxyType({}),
        offered: Set[str] | None = None,
        end: int | None = None,
    ) -> dict[str, ToolResult]:
        """Decide the open calls of the latest reply, in their order; return what they are answered with, by call id.

        A call whose id is in `play` is played, with the arguments given there unless they are None. A result among the
        messages is the host's answer; to one of the game's own calls it is a refusal. Of the other calls, those that no
        host can run, because their tool does not exist or their arguments are not an object, are answered here, and the
        rest as not run. A call of a foreign tool whose arguments are not an object is a mistake even if the host has
        answered it: frameworks differ in who does, and only a counted mistake ends a model that repeats it. Results of
        foreign tools that ran are the host's own and not returned; in these, a part without text, such as a picture, is
        replaced by its name, because its tokens cannot be counted.

        `offered` names the foreign tools that the host has for this reply, by default all that the model is shown; a
        call of another one is a mistake. `end` is the position of the first call that stays open, by default none.
        """
        session = self._begun
        turn, answers = session.latest_turn, dict[str, ToolResult]()
        if turn is None or session.awaits_reply:
            return answers
        results = {message["tool_call_id"]: message for message in messages if message["role"] == "tool"}
        foreign = {tool.name for tool in session.foreign_tools}
        runnable = {tool.name for tool in self.episode.tools} | (foreign if offered is None else foreign & offered)
        with self.episode.lock:
            answered = {item.position for item in turn.items}
            for position, call in enumerate(turn.calls[:end]):
                if position in answered:
                    continue
                if call.id in play:
                    answers[call.id] = session.answer(call.id, play[call.id])
                elif call.id in results:
                    said = self._in_words(results[call.id])
                    if call.name in foreign and call.arguments.problem is None:
                        session.add({**results[call.id], "content": said})
                    else:
                        answers[call.id] = session.answer_at(position, refusal=said)
                elif call.name not in runnable or call.arguments.problem is not None:
                    answers[call.id] = session.answer_at(position)
                else:
                    left = self._no_result if call.name in foreign else self._not_run
                    answers[call.id] = session.answer_at(position, refusal=left)
        return answers

    def _in_words(self, result: Message) -> str:
        """Return the text of a host's result, and log once if a part of it has no text."""
        text, kinds = words_of(result["content"])
        if kinds and not self._is_told:
            self._is_told = True
            log.warning(
                "A result of the agent's own tools has parts that the model is not shown, because their tokens cannot "
                "be counted: %s. Each is named in its place.",
                ", ".join(f"{kind} ({count})" for kind, count in kinds.items()),
            )
        return text

    def hear(self, messages: Iterable[Message]) -> None:
        """Add the host's user messages since the latest reply; those that the session has already are left out."""
        if not self._begun.awaits_reply:
            for message in self.unheard(messages):
                self._begun.add(message)

    def unheard(self, messages: Iterable[Message]) -> list[Message]:
        """Return the user messages among these that the session has not received since the latest reply."""
        turn = self._begun.latest_turn
        items = () if turn is None else turn.items if turn.calls else turn.items[1:]  # the first is this library's
        heard = _words_of_user(item.message for item in items)
        new = []
        for message in messages:
            if message["role"] != "user":
                continue
            text = text_of(message)
            if heard[text]:
                heard[text] -= 1
            else:
                new.append(message)
        return new

    def refuse_late_words(self, messages: Iterable[Message]) -> None:
        """Raise an error for user messages that the episode has not received, where the reply to a prompt is to come.

        That prompt stays as it is, and in a host's list these words would come before its reply: they would be lost.
        """
        session = self._begun
        received = [*session.host_head, *(item.message for turn in session.turns for item in turn.items)]
        if _words_of_user(messages) - _words_of_user(received):
            raise InvalidArgumentError(
                "The reply to a prompt on record comes first. Run the agent without new messages, and add yours after "
                "the reply."
            )

    @property
    def _begun(self) -> AgentSession:
        assert self.session is not None, "the session begins with the first prompt"
        return self.session


def _words_of_user(messages: Iterable[Message]) -> Counter[str]:
    return Counter(text_of(message) for message in messages if message["role"] == "user")
