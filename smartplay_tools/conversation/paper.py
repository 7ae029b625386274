"""The paper's protocol: free text, two questions per step, and the name of an action searched in the answer.

There are no tools. The first prompt of a step has system messages with manual, history and current observation, and
asks what would be best; the second repeats them with the model's answer and asks it to choose. The first action named
in the choice is played. If it names none, the game's first action is played, as in the original, and counted
(`fallback_actions`). Everything else is as in a `Conversation`: the same players, budgets, records and replays.

    prompt 1   system, manual, history, observation, question 1              -> thoughts
    prompt 2   system, manual, history, observation, question 1, thoughts, question 2   -> choice -> act

The texts are equal to the original's byte for byte. A prompt that does not fit its cap loses the oldest steps of its
history.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from functools import partial
from itertools import takewhile
from typing import Any

from smartplay_tools.context.tokens import PRIMING, truncation
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Selection, View
from smartplay_tools.conversation.base import AnyReply, BaseConversation, CheckedReply
from smartplay_tools.episode import budgets
from smartplay_tools.episode.config import ProtocolName
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.games.base import history_text
from smartplay_tools.transcript.hashing import message_bytes, prompt_sha256, tools_bytes
from smartplay_tools.types import ToolResult
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import Call, Message, text_of

SYSTEM = "You’re a player trying to play the game."
OBSERVATION = "current step observation: "
QUESTION = "What is the best action to take? Let's think step by step, "
CHOICE = "Choose the best executable action from the list of all actions. Write the exact chosen action."


def prompt_messages(
    manual: str | None, observations: Sequence[str], first: int, thoughts: str | None = None
) -> list[Message]:
    """Return the messages of a prompt in the original's layout.

    `observations` are those of the whole episode, the current one last; the history begins at step `first`. With the
    model's `thoughts`, its answer to the first question, the prompt asks the second.
    """
    *past, current = observations
    system = [SYSTEM, *([] if manual is None else [manual])]
    if first < len(past):
        system.append(history_text([(step, past[step]) for step in range(first, len(past))]))
    system.append(OBSERVATION + current)
    messages: list[Message] = [{"role": "system", "content": text} for text in system]
    messages.append({"role": "user", "content": QUESTION})
    if thoughts is not None:
        messages.append({"role": "assistant", "content": thoughts})
        messages.append({"role": "user", "content": CHOICE})
    return messages


def chosen_action(answer: str, actions: Sequence[str]) -> int | None:
    """Return the action whose name occurs first in the answer, ignoring case; None if it names none."""
    answer = answer.lower()
    places = ((answer.find(name.lower()), index) for index, name in enumerate(actions))
    _, index = min((place for place in places if place[0] >= 0), default=(0, None))
    return index


class PaperConversation(BaseConversation):
    """An episode in the paper's protocol. Every prompt contains the manual, except with `manual="none"`."""

    protocol: ProtocolName = "paper"

    def __init__(self, episode: Episode, *, player: str | None = None) -> None:
        which = {"context": episode.config.context, "protocol": self.protocol, "observation": "text"}
        budgets.check_strategies(episode.budget, episode.spec, **which)
        self._counter = episode.counter
        self._manual = None if episode.config.manual == "none" else episode.manual_text
        first = [*episode.game.before_reset, episode.game.observation]
        cap, cut_text = episode.budget.result_tokens, episode.ledger.session.cut
        self._observations = [cut_text(text, cap, truncation.cut_end) for text in first]
        """The observations so far, indexed by the original's count of steps; results of actions come last."""
        before_reset = len(episode.game.before_reset)
        self._thoughts: str | None = None
        """The answer to the first question, while the second is open."""
        self._choice: str | None = None
        """The answer to the second question, until its action is played."""
        self._latest: list[Message] = []
        if episode.budget.prompt_tokens is not None:
            budgets.check_head(episode.budget, self._tokens(self._messages(before_reset)))
        head = prompt_messages(self._manual, [""], 0)[: 1 if self._manual is None else 2]
        cut = sum(shown != text for shown, text in zip(self._observations, first, strict=True))
        if episode.config.manual == "tool":  # a pinned manual is counted already
            cut += self._manual != episode.game.manual
        *before, observation = self._observations
        facts = {"before": before, "observation": observation, "cut_results": cut}
        super().__init__(episode, player=player, head=head, tools=(), **facts)

    def receive(self, reply: AnyReply) -> list[ToolResult]:
        """Take the answer to the latest question: thoughts, or a choice, which is played and whose result is returned.

        What is not a reply raises `InvalidArgumentError` and changes nothing.
        """
        checked = CheckedReply.of(reply)
        with self.episode.lock:
            self.open_turn(checked)
            return self.settle()

    async def areceive(self, reply: AnyReply) -> list[ToolResult]:
        """Take an answer as `receive` does; where that may be slow, in a thread instead of the event loop."""
        return await self._away(partial(self.receive, CheckedReply.of(reply)))

    def open_turn(self, reply: CheckedReply) -> tuple[Call, ...]:
        """Record and charge an answer; the action that it chooses is not played yet."""
        with self.episode.lock:
            calls = self._record_reply(reply, self._prepare())
            answer = text_of(reply.message)
            if self._thoughts is None:
                self._thoughts = answer
            else:
                self._choice = answer
            return calls

    def settle(self) -> list[ToolResult]:
        """Play the action that was chosen and not played yet, if there is one."""
        answer, self._choice = self._choice, None
        return [] if answer is None else [self._choose(answer)]

    def _choose(self, answer: str) -> ToolResult:
        """Play the action that an answer names, or the first one."""
        self._thoughts, turn = None, self._builder.latest
        assert turn is not None
        actions = self.episode.game.actions
        chosen = chosen_action(answer, actions)
        action, is_fallback = actions[chosen or 0], chosen is None
        self._ledger.record({"event": "choice", "turn": turn.number, "action": action, "fallback": is_fallback})
        result = self._ledger.answer(turn.number, 0, "act", read({"action": action}))
        self._ledger.finish_if_over()
        self._observations.append(result.text)
        self._builder.add({"role": "system", "content": result.text}, None)
        return result

    def _complete_turn(self) -> None:
        self.settle()
        self._builder.close()

    def _next_view(self) -> View:
        step = len(self._observations) - 1
        history = self.episode.budget.history
        oldest = 0 if history is None else max(0, step - history)
        first = self._first_that_fits(oldest, step)
        messages = self._messages(first)
        same = takewhile(lambda pair: pair[0] == pair[1], zip(messages, self._latest, strict=False))
        prefix = sum(self._counter.message(message) for message, _ in same)
        self._latest = messages
        turns = len(self._builder.turns)
        return View(
            tools=(),
            tokens=self._tokens(messages),
            shown_steps=step - first + 1,
            dropped_turns=first - oldest,
            prefix_tokens=prefix,
            selection=Selection([range(turns, turns)], oldest=first),
            forms=[Form(message) for message in messages],
        )

    def _first_that_fits(self, oldest: int, step: int) -> int:
        """Return the first step of the longest history that fits into the prompt; `step` for an empty history."""
        cap = self.episode.budget.prompt_tokens
        if cap is None:
            return oldest
        fits = range(oldest, step + 1)
        first = oldest + bisect_left(fits, x=True, key=lambda at: self._tokens(self._messages(at)) <= cap)
        if first > step:
            raise PromptOverflowError("Manual, observation and question alone do not fit.")
        return first

    def _messages(self, first: int) -> list[Message]:
        return prompt_messages(self._manual, self._observations, first, self._thoughts)

    def _tokens(self, messages: Sequence[Message]) -> int:
        return self._counter.messages(messages) + PRIMING

    def _shown(self, view: View) -> dict[str, Any]:
        first, step = view.selection.oldest, len(self._observations) - 1
        question = 1 if self._thoughts is None else 2
        messages = [form.message for form in view.forms]
        return {"question": question, "step": step, "first": first, "sha256": messages_sha256(messages)}


def messages_sha256(messages: Sequence[Message]) -> str:
    """Return the sha256 of a prompt with these messages."""
    return prompt_sha256([message_bytes(message, ()) for message in messages], tools_bytes(()))
