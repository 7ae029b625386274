"""Conversation: chat messages in, chat messages out, under a budget. It does no I/O; `play` and `aplay` drive it.

There is one loop, and it is this one. `prompt` checks the budgets before the model is called and says what the model
may see; `receive` takes what the model said, charges it, has the episode answer its calls and makes a turn of it.
Whoever owns an event loop, a framework or a network drives the same two methods.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from smartplay_tools import prompts
from smartplay_tools.context import ContextWindow, View
from smartplay_tools.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError
from smartplay_tools.messages import Message, assistant_message, calls_of, copy_of
from smartplay_tools.records import TOOL_NAMES, EpisodeResult, Prompt, ToolCall, ToolResult, ToolSpec, Usage
from smartplay_tools.transcript import message_bytes, prompt_sha256, tools_bytes
from smartplay_tools.turns import Item, Turn, Turns

IDLE_REPLIES = 3
"""So many replies in a row without a tool call end an episode."""


class Conversation:
    """An episode as a chat.

    Arguments:
        episode: a fresh episode whose context is "window".
        player: the player's name, for the record.
        head: messages that the host wants before the first reply, after the system and task messages.
        foreign_tools: other tools of the host's agent. They are counted and shown; their calls are left to the host,
            which gives their results to `add`.
    """

    def __init__(
        self,
        episode: Episode,
        *,
        player: str | None = None,
        head: Sequence[Message] = (),
        foreign_tools: Sequence[ToolSpec] = (),
    ) -> None:
        if episode.context != "window":
            raise InvalidArgumentError(
                'A conversation decides what the model sees; make the episode with context="window".'
            )
        if clash := {tool.name for tool in foreign_tools} & set(TOOL_NAMES):
            raise InvalidArgumentError(f"The game's own tools are named {', '.join(sorted(clash))}; rename yours.")
        self.episode = episode
        self._foreign = {tool.name for tool in foreign_tools}
        self._tools = (*episode.tools, *foreign_tools)
        self._tools_bytes = tools_bytes(self._tools)
        head = [*episode.head, *head]
        self._window = ContextWindow(head, self._tools, episode.budget, episode.counter)
        self._turns = Turns()
        self._draft: Turn | None = None
        self._step = 0
        self._manual: str | None = None
        self._idle_in_a_row = 0
        self._view: View | None = None
        self._pending: Prompt | None = None
        episode.begin(player=player)
        schemas = [{"name": t.name, "description": t.description, "parameters": t.parameters} for t in self._tools]
        episode.log("head", messages=head, tools=schemas)

    @property
    def turns(self) -> Turns:
        """Every turn so far."""
        return self._turns if self._draft is None else Turns([*self._turns, self._draft])

    @property
    def latest_turn(self) -> Turn | None:
        """The turn of the latest reply; None before the first."""
        return self._draft or (self._turns[-1] if self._turns else None)

    @property
    def view(self) -> View | None:
        """What the latest prompt showed; None before the first."""
        return self._view

    @property
    def result(self) -> EpisodeResult | None:
        """The episode's result, once it is over."""
        return self.episode.result

    # What the model is sent.

    def prompt(self) -> Prompt | None:
        """Return the next prompt, or None when the episode is over; a budget that is spent ends it here.

        Asked twice, it gives the same prompt twice. The messages are copies: do with them what you like.
        """
        if self._pending is None and not self.episode.done:
            self._close_turn()
            self._pending = self._next_prompt()
        if self._pending is None or self.episode.done:
            return None
        return replace(self._pending, messages=[copy_of(message) for message in self._pending.messages])

    def _next_prompt(self) -> Prompt | None:
        try:
            view = self._window.view(self._turns)
        except PromptOverflowError:
            self.episode.end("prompt_tokens")
            return None
        max_tokens = self._max_tokens(view.tokens)
        if max_tokens is not None and max_tokens < max(1, self.episode.budget.reply_tokens or 1):
            self.episode.end("episode_tokens")
            return None
        self._view = view
        self._log_view(view, max_tokens)
        return Prompt(view.messages, view.tools, max_tokens)

    def _max_tokens(self, prompt_tokens: int) -> int | None:
        budget, spent = self.episode.budget, self.episode.tally.tokens
        if budget.episode_tokens is None:
            return budget.reply_tokens
        left = budget.episode_tokens - spent.prompt - spent.reply - prompt_tokens
        return left if budget.reply_tokens is None else min(left, budget.reply_tokens)

    def _log_view(self, view: View, max_tokens: int | None) -> None:
        if not self.episode.recording:
            return
        kept = view.kept
        pinned = [] if kept.pinned is None else [[kept.pinned, kept.pinned]]
        run = [[kept.first, kept.last]] if kept.last >= 0 else []
        self.episode.log(
            "view",
            turn=self.episode.tally.turns,
            turns=pinned + run,
            marked=view.marked_results,
            tokens=view.tokens,
            max_tokens=max_tokens,
            prefix_tokens=view.prefix_tokens,
            shown_steps=view.shown_steps,
            dropped_turns=view.dropped_turns,
            sha256=self._sha256(view),
        )

    def _sha256(self, view: View) -> str:
        messages = [message_bytes(message, ()) for message in self._window.head(self._manual)]
        for index in view.kept:
            messages.extend(self._turns[index].canonical_seen(view.kept.oldest))
        return prompt_sha256(messages, self._tools_bytes)

    # What the model said.

    def receive(self, message: Mapping[str, Any], usage: Usage | None = None) -> list[ToolResult]:
        """Take the reply to the latest prompt: charge it, answer its calls, and return their results in order.

        `message` is an assistant message in chat form; anything else is a ValueError. The provider's `usage` is
        recorded beside our count. A reply that comes after the end is recorded, and its calls are refused.
        """
        assistant = assistant_message(message)
        prompt = self.prompt()
        self._close_turn()
        number = self.episode.tally.turns
        if number != len(self._turns):
            raise InvalidArgumentError("The episode was called past its conversation, which alone may call it.")
        self.episode.log("message", turn=number, by="player", message=assistant)
        if prompt is not None:
            self._charge(number, assistant, prompt, usage)
        self._pending = None
        functions = [call["function"] for call in calls_of(assistant)]
        results = self.episode.call_batch(
            [
                None
                if function["name"] in self._foreign
                else ToolCall(function["name"], function["arguments"], f"{number}.{position}")
                for position, function in enumerate(functions)
            ]
        )
        self._draft = Turn(number, assistant, (), self._step, self._manual)
        self._add_results(assistant, results)
        self._idle_in_a_row = 0 if functions else self._idle_in_a_row + 1
        if not functions:
            self._answer_idle_reply()
        return results

    def add(self, message: Message) -> None:
        """Put a user message, or the result of a foreign tool, after the latest reply, before the next prompt."""
        if self._draft is None:
            raise InvalidArgumentError(
                "Add messages between a reply and the next prompt; earlier ones belong into `head`."
            )
        position = None
        if message["role"] == "tool":
            call_id = message.get("tool_call_id", "")
            position = self._unanswered().get(call_id)
            if position is None:
                raise InvalidArgumentError(f"No call with the id {call_id!r} waits for a result.")
        self._append(Item(message, self._step, position=position), by="host")

    def _charge(self, number: int, assistant: Message, prompt: Prompt, usage: Usage | None) -> None:
        assert self._view is not None
        reply = self.episode.counter.message(assistant)
        overrun = prompt.max_tokens is not None and reply > prompt.max_tokens
        counts = {"prompt": self._view.tokens, "reply": reply, "prefix": self._view.prefix_tokens}
        self.episode.tally.charge(**counts, overrun=overrun, usage=usage)
        provider = None if usage is None else usage.model_dump()
        self.episode.log("usage", turn=number, **counts, overrun=overrun, provider=provider)

    def _add_results(self, assistant: Message, results: list[ToolResult]) -> None:
        answers = iter(results)
        for position, call in enumerate(calls_of(assistant)):
            if call["function"]["name"] in self._foreign:
                continue
            result = next(answers)
            observation = result.data.get("observation")
            is_manual = bool(result.data.get("manual"))
            if is_manual:
                self._manual = result.text
            if observation is not None:
                self._step = max(self._step, observation)
            text = prompts.MANUAL_IS_ABOVE if is_manual else result.text
            message: Message = {"role": "tool", "content": text, "tool_call_id": call["id"]}
            # Not logged: the `call` event holds it.
            self._append(Item(message, self._step, observation, position), by=None)

    def _answer_idle_reply(self) -> None:
        self.episode.tally.idle_replies += 1
        self._append(Item({"role": "user", "content": prompts.text("idle")}, self._step), by="library")
        if self._idle_in_a_row == IDLE_REPLIES:
            self.episode.end("no_tool_call")

    def _append(self, item: Item, by: str | None) -> None:
        assert self._draft is not None
        self._draft = replace(self._draft, items=(*self._draft.items, item), manual=self._manual)
        if by is not None:
            self.episode.log("message", turn=self._draft.number, by=by, message=item.message)

    def _unanswered(self) -> dict[str, int]:
        """Calls of the latest reply that wait for a result: id -> position."""
        if self._draft is None:
            return {}
        answered = {item.position for item in self._draft.items}
        calls = enumerate(calls_of(self._draft.assistant))
        return {call["id"]: position for position, call in calls if position not in answered}

    def _close_turn(self) -> None:
        if waiting := self._unanswered():
            raise InvalidArgumentError(f"The foreign calls {', '.join(waiting)} have no result yet: `add` them.")
        if self._draft is not None:
            self._turns = self._turns.add(self._draft)
            self._draft = None
