"""BaseConversation: the part that all protocols share - which prompt is next, and what a reply costs.

`prompt` checks the budgets before the model is called; a reply is validated, recorded and charged before anything is
played. The protocol decides what a prompt shows and what a reply does: tool calls in `AgentSession` and
`Conversation`, the paper's two questions in `PaperConversation`. A conversation never calls a model; the caller
sends the prompts and receives the replies.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from smartplay_tools.context.prefix import common_beginning
from smartplay_tools.context.turns import Form, Turn, TurnBuilder, with_ids
from smartplay_tools.context.view import View
from smartplay_tools.episode.config import ProtocolName
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import (
    InvalidArgumentError,
    PlayerLeftError,
    PromptOverflowError,
    PromptRefusedError,
    StrategyError,
    name_of,
)
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import EndReason, EpisodeResult, Prompt, Reply, SampledTokens, ToolSpec, Usage
from smartplay_tools.types.call_ids import CallIds
from smartplay_tools.types.messages import Call, Message, assistant_message, calls_of, pictures_of, read_calls
from smartplay_tools.types.pictures import NO_PICTURES, Picture

if TYPE_CHECKING:
    from smartplay_tools.costs.spending import Spending

T = TypeVar("T")

LEAST_REPLY: Mapping[str, int] = {"episode_cost": 40}
"""The tokens of a reply with a call and a few words, for which a prompt is worth its money."""

message_of: Callable[[Form], Message] = attrgetter("message")


@dataclass(slots=True)
class CheckedReply:
    """A reply in canonical form; replies are validated and normalised here, and nowhere else after it."""

    message: Message
    usage: dict[str, Any] | None
    """What the provider charged, as plain data."""
    sampled: dict[str, Any] | None = None
    """The tokens that the model drew, as plain data."""

    @classmethod
    def of(cls, reply: AnyReply) -> CheckedReply:
        """Return a copy of a reply as the conversation keeps it; `InvalidArgumentError` if it is not a reply."""
        match reply:
            case CheckedReply():
                return reply
            case Reply():
                message, sampled = assistant_message(reply.message), checked_tokens(reply.sampled)
                return cls(message, checked_usage(reply.usage, message), sampled)
        message = assistant_message(reply)
        return cls(message, checked_usage(None, message))

    def event(self, name: str, turn: int, **facts: Any) -> Event:
        """Return the event that records the reply."""
        sampled = {} if self.sampled is None else {"sampled": self.sampled}
        return {"event": name, "turn": turn, **facts, "message": self.message, **sampled}


AnyReply = Mapping[str, Any] | Reply | CheckedReply
"""A reply as `receive` takes it: an assistant message in chat form, a `Reply`, or one that has been checked."""


@dataclass(slots=True)
class Pending:
    """The prompt that waits for a reply."""

    view: View
    max_tokens: int | None
    prompt: Callable[[], Prompt]
    """Returns a new `Prompt` at every call, so that a caller may change the messages of each."""

    def cost(self, reply: int) -> dict[str, Any]:
        """Our count of the prompt and its reply, as fields of a `usage` event."""
        return {
            "prompt": self.view.tokens,
            "reply": reply,
            "prefix": self.view.prefix_tokens,
            "overrun": self.max_tokens is not None and reply > self.max_tokens,
            **({"texts": self.view.text_tokens} if self.view.text_tokens else {}),
        }


def check_episode(episode: object) -> None:
    """Raise an `InvalidArgumentError` unless an object is an episode."""
    if not isinstance(episode, Episode):
        raise InvalidArgumentError(
            f'{name_of(episode)} is not an episode; pass one, as in Episode("Hanoi3Disk-v0", seed=1).'
        )


class BaseConversation(ABC):
    """An episode as an exchange of prompts and replies, until there is no further prompt."""

    protocol: ProtocolName

    def __init__(
        self,
        episode: Episode,
        *,
        player: str | None,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        **facts: Any,
    ) -> None:
        """`facts` are further fields of the `head` event, from which prompts are rebuilt."""
        if episode.config.context != "window":
            raise InvalidArgumentError(
                'A conversation decides what the model sees; make the episode with context="window".'
            )
        self.episode = episode
        self._ledger = episode.ledger
        self._builder = TurnBuilder(episode.words, compacts=episode.ledger.strategies.compacts)
        self._ids = CallIds()
        self._view: View | None = None
        self._shown_before: Sequence[Form] = ()
        self._pending: Pending | None = None
        self._is_warm = False
        self._pictures: dict[str, Picture] = {}
        """The pictures that a later view may show, by their sha256, the newest last."""
        episode.begin(player=player, protocol=self.protocol)
        self._cache_key = episode.config.key
        self.spending = self._new_spending()
        """What the episode has cost, where its budget has a cap on that."""
        self._record_head(head, tools, **facts)

    def _record_head(self, head: Sequence[Message], tools: Sequence[ToolSpec], **facts: Any) -> None:
        self._ids.reserve(call["id"] for message in head for call in calls_of(message))
        schemas = [tool.to_json() for tool in tools]
        self._ledger.record({"event": "head", "messages": list(head), "tools": schemas, **facts})

    @abstractmethod
    def _next_view(self) -> View:
        """Return what the next prompt shows; `PromptOverflowError` if its pinned parts do not fit."""

    @abstractmethod
    def _shown(self, view: View) -> dict[str, Any]:
        """Return the fields of the `view` event from which the prompt is rebuilt, and the prompt's sha256."""

    @abstractmethod
    def open_turn(self, reply: CheckedReply) -> tuple[Call, ...]:
        """Record and charge a reply and open its turn, and return its calls; nothing is played.

        `receive` begins with it, and a record that is replayed has the rest in events of its own.
        """

    @abstractmethod
    def _complete_turn(self) -> None:
        """Answer the calls of the latest reply that are still open; its turn is then complete."""

    @property
    def turns(self) -> Sequence[Turn]:
        """Every turn so far, the latest included."""
        turns = self._builder.turns
        latest = self._builder.latest
        return turns if latest is None or (turns and turns[-1] is latest) else [*turns, latest]

    @property
    def latest_turn(self) -> Turn | None:
        """The turn of the latest reply; None before the first."""
        return self._builder.latest

    @property
    def view(self) -> View | None:
        """What the latest prompt showed; None before the first."""
        return self._view

    @property
    def pictures(self) -> Mapping[str, Picture]:
        """The pictures of the latest turn, and of earlier ones that a later prompt may show, by their sha256."""
        return MappingProxyType(self._pictures)

    @property
    def awaits_reply(self) -> bool:
        """Whether a prompt waits for its reply; after a summary this is still so, for the prompt to play that is due.

        While this is so, nothing can be added and the head cannot be changed.
        """
        if self._pending is not None:
            return True
        return self._view is not None and self._view.purpose != "play" and not self.episode.done

    @property
    def result(self) -> EpisodeResult | None:
        """The episode's result, once it is over."""
        return self.episode.result

    def prompt(self) -> Prompt | None:
        """Return the next prompt, or None when the episode is over; a spent budget ends the episode here.

        Where the budget has `summary_tokens`, a prompt may ask for a summary (`Prompt.purpose`), and where it has a
        compactor, for the answer to a question. It is answered with `receive`, as any other; that reply is not a turn,
        and the prompt to play comes later.

        Two calls without a reply in between return the same prompt. The messages are copies, which you may change.
        """
        with self.episode.lock:
            pending = self._prepare()
            return None if pending is None else pending.prompt()

    def _prepare(self) -> Pending | None:
        """Return what the next prompt shows, decided once until its reply; None when the episode is over."""
        episode = self.episode
        if self._pending is None and episode.result is None:
            self._complete_turn()
            self._pending = None if episode.done else self._next_prompt()
        self._ledger.finish_if_over()
        return None if episode.done else self._pending

    async def aprompt(self) -> Prompt | None:
        """Return the next prompt as `prompt` does; where that may be slow, in a thread instead of the event loop."""
        return await self._away(self.prompt)

    def fail(self, error: Exception) -> None:
        """Note that an attempt at a reply has failed, where the host may try again.

        If the episode is closed before there is a reply, it ends as `player_error` with this error, not as `closed`.
        """
        self._ledger.if_closed = ("player_error", error, None)

    def give_up(self, error: Exception) -> None:
        """End the episode because its player gives no reply; what the error's `usage` says is counted, if it has one.

        A `PlayerLeftError` ends it as `closed`. A `PromptRefusedError` after the first reply ends it as `host`: the
        result of a model that cannot go on. Any other error ends it as `player_error`.
        """
        usage = getattr(error, "usage", None)
        if isinstance(usage, Usage):
            self.spend(usage)
        if isinstance(error, PlayerLeftError):
            self.episode.end("closed")
        elif isinstance(error, PromptRefusedError) and self.episode.stats.turns:
            self.episode.end("host", detail=str(error))
        else:
            self.episode.end("player_error", error)

    def halt(self, detail: str) -> None:
        """Note that the host has stopped for its own limit, where it may go on later.

        If the episode is closed before there is a reply, it ends as `host` with this detail, not as `closed`.
        """
        self._ledger.if_closed = ("host", None, detail)

    def spend(self, usage: Usage) -> None:
        """Count what the provider charged for attempts at a reply that never came."""
        provider = checked_usage(usage, {"role": "assistant", "content": ""})
        is_question = self._pending is not None and self._pending.view.purpose == "compaction"
        asked = {"purpose": "compaction"} if is_question else {}  # another player may answer, at another price
        self._ledger.record({"event": "usage", "turn": self.episode.stats.turns, **asked, "provider": provider})

    def _record_reply(self, reply: CheckedReply, pending: Pending | None) -> tuple[Call, ...]:
        """Record and charge the reply to a prompt, and return its calls; nothing is played."""
        number = self.episode.stats.turns
        if number != len(self._builder.turns) and not self.episode.done:
            raise InvalidArgumentError("The episode was called directly; only its conversation may call it.")
        sent = [call["id"] for call in calls_of(reply.message)]
        ids = self._ids.take(sent, number)
        calls = read_calls(reply.message, ids)
        tokens = self.episode.counter.message(reply.message, [call.arguments.canonical for call in calls])
        message = reply.event("message", number, by="player")
        if ids != sent:
            message["ids"] = ids
        events = [message]
        if pending is not None:
            cost = self._charged(pending, with_ids(reply.message, ids), tokens)
            events.append({"event": "usage", "turn": number, **cost, "provider": reply.usage})
        self._ledger.record(*events)
        self._pending, self._ledger.if_closed = None, None
        self._builder.open(number, reply.message, calls, tokens)
        return calls

    def _next_prompt(self) -> Pending | None:
        try:
            view = self._next_view()
        except PromptOverflowError:
            self.episode.end("prompt_tokens")
            return None
        except StrategyError as error:
            self.episode.end("strategy_error", error.__cause__ or error)
            return None
        limits = self._left(view)
        for spent, most in limits.items():
            if most < (self.episode.budget.reply_tokens or LEAST_REPLY.get(spent, 1)):
                self.episode.end(spent)
                return None
        longest = min(*limits.values(), self.episode.budget.reply_tokens or math.inf, math.inf)
        max_tokens = None if longest == math.inf else int(longest)
        self._view = view
        if self._ledger.is_recording:
            self._record_view(view, max_tokens)
        if self._ledger.on_view is not None:
            self._ledger.on_view(view.tokens, max_tokens or 0)
        prefix = common_beginning(view.forms, self._shown_before, is_equal=True)
        self._shown_before = view.forms
        messages = tuple(map(message_of, view.forms))
        prompt = partial(
            Prompt,
            messages,
            tools=view.tools,
            max_tokens=max_tokens,
            prefix_messages=prefix,
            purpose=view.purpose,
            cache_key=self._cache_key,
            pictures=self._shown_pictures(view),
            version=self.episode.words.name,
            tokens=view.tokens,
        )
        return Pending(view, max_tokens, prompt)

    def _shown_pictures(self, view: View) -> Mapping[str, Picture]:
        """The pictures in a view, by their sha256."""
        if not self._pictures:
            return NO_PICTURES
        kept = self._pictures
        while view.purpose == "play" and len(kept) > self._most_pictures:
            del kept[next(iter(kept))]
        named = [part["sha256"] for form in view.forms for part in pictures_of(form.message)]
        return {sha256: kept[sha256] for sha256 in named}

    def _keep_picture(self, picture: Picture) -> None:
        """Keep a picture for the views that may show it."""
        self._pictures.pop(picture.sha256, None)
        self._pictures[picture.sha256] = picture

    @cached_property
    def _most_pictures(self) -> float:
        """How many pictures a view can show: no more than the history has or the cap can hold."""
        budget = self.episode.budget
        if self._ledger.strategies.compacts:  # it may show any picture again
            return math.inf
        limits = [math.inf if budget.history is None else budget.history + 1, budget.newest_pictures or math.inf]
        if budget.prompt_tokens is not None and not budget.strategies:  # a strategy may go back to any turn
            each = self.episode.counter.image(*self.episode.game.picture_shape)
            limits.append(budget.prompt_tokens // max(1, each) + 1)
        return min(limits)

    def _left(self, view: View) -> dict[EndReason, float]:
        """The most tokens that the reply to a prompt may have, by the field of the budget that is spent after them."""
        budget, spent = self.episode.budget, self.episode.stats.tokens
        left: dict[EndReason, float] = {}
        if budget.episode_tokens is not None:
            left["episode_tokens"] = budget.episode_tokens - spent.prompt - spent.reply - view.tokens
        if self.spending is not None:
            left["episode_cost"] = self.spending.take(view)
        return left

    def _new_spending(self) -> Spending | None:
        budget = self.episode.budget
        if budget.episode_cost is None:
            return None
        from smartplay_tools.costs.cached import marks_of
        from smartplay_tools.costs.spending import Spending
        from smartplay_tools.providers.cost_rules import NO_CACHE, cost_rule

        marks = marks_of(self.episode.config.player_options)
        return Spending(budget.episode_cost, cost_rule(budget.cost_rule or NO_CACHE), self.episode.counter, marks)

    def _charged(self, pending: Pending, message: Message, tokens: int) -> dict[str, Any]:
        """Charge a prompt and its reply, as later prompts show it, and return the fields of the `usage` event."""
        cost = pending.cost(tokens)
        if self.spending is None:
            return cost
        return {**cost, "spent": self.spending.charge(message, tokens, pending.view.purpose)}

    def _record_view(self, view: View, max_tokens: int | None) -> None:
        self._ledger.write(
            {
                "event": "view",
                "turn": self.episode.stats.turns,
                "tokens": view.tokens,
                "max_tokens": max_tokens,
                "prefix_tokens": view.prefix_tokens,
                "shown_steps": view.shown_steps,
                "dropped_turns": view.dropped_turns,
                **self._shown(view),
            }
        )

    async def _away(self, function: Callable[[], T]) -> T:
        """Run a function of this conversation without blocking the event loop for long.

        A step of most games takes microseconds, less than the switch to a thread. A thread is used only the first
        time, when the vocabulary may have to be loaded, for games whose steps are slow, and for compactors.
        """
        if self._is_warm and not (self.episode.game.is_slow or self._ledger.strategies.compacts):
            return function()
        result = await self._ledger.queue.run_to_end(function)
        self._is_warm = True
        return result


def checked_usage(usage: Usage | None, message: Message) -> dict[str, Any] | None:
    """Return the usage of a reply as plain data; `InvalidArgumentError` if it is neither a `Usage` nor None.

    It says that the provider has managed the context if the reply contains a compaction.
    """
    if usage is not None and not isinstance(usage, Usage):
        raise InvalidArgumentError(f"The usage of a reply is a `Usage` or None, not {type(usage).__name__}.")
    if (usage is None or not usage.edits) and _holds_compaction(message.get("provider_items")):
        usage = (usage or Usage()).model_copy(update={"managed": 1, "edits": 1})
    return None if usage is None else usage.model_dump()


def _holds_compaction(value: Any) -> bool:
    """Whether there is a compaction in data, as the provider or a framework names it; arguments are the model's."""
    if isinstance(value, Mapping):
        kinds = value.get("type"), value.get("part_kind")
        said = (inner for name, inner in value.items() if name not in ("input", "arguments", "args"))
        return "compaction" in kinds or any(map(_holds_compaction, said))
    return isinstance(value, list) and any(map(_holds_compaction, value))


def checked_tokens(sampled: SampledTokens | None) -> dict[str, Any] | None:
    """Return sampled tokens as plain data; `InvalidArgumentError` if they are neither `SampledTokens` nor None."""
    if sampled is not None and not isinstance(sampled, SampledTokens):
        raise InvalidArgumentError(f"`sampled` is a `SampledTokens` or None, not {type(sampled).__name__}.")
    return None if sampled is None else sampled.model_dump(mode="json")
