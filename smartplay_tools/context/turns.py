"""Turns: the units of a conversation, each of which a window keeps or drops as a whole.

A turn is one assistant message and everything up to the next one: the results of all its calls, user messages, other
tools' results. Because only whole turns are dropped, every call in a prompt has its result and every result its call.
Time is counted in steps of the game. An item's step is the number of the newest observation that had been shown when
the item was made, so steps never decrease from turn to turn.

`TurnBuilder` makes turns from events, in a live conversation and wherever a record is read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from smartplay_tools.context.prompts.history import sent_reply
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.transcript.hashing import head_bytes, message_bytes
from smartplay_tools.types import NOTES_TOOL
from smartplay_tools.types.messages import (
    THOUGHT_PLACES,
    Call,
    Message,
    calls_of,
    copy_of,
    pictures_of,
    read_calls,
    reasoning_of,
    text_of,
)
from smartplay_tools.types.pictures import picture_part

BROUGHT_BACK = frozenset({"recalled", "page"})
"""The data by which a result is known to bring observations back: a key for each tool that does so."""


class Form:
    """One form of a message, as prompts show it. Its canonical JSON and its tokens are made once.

    Every form of a message of a turn is one object, so two prompts show the same message if they have the same form.
    """

    __slots__ = ("_arguments", "_counter", "_line", "_position", "_tokens", "_turn", "message", "step")

    def __init__(
        self,
        message: Message,
        turn: int | None = None,
        *,
        arguments: Sequence[str] | None = None,
        position: int | None = None,
        step: int | None = None,
    ) -> None:
        """`turn` is the number of its turn; None for a message of no turn, whose calls keep their ids.

        `arguments` are those of its calls in canonical form, if they have been read. `position` is that of the call
        whose result it is.
        """
        self.message = message
        """It must not be changed."""
        self.step = step
        """The observation that it shows; None if it shows none."""
        self._turn, self._position, self._arguments = turn, position, arguments
        self._counter: TokenCounter | None = None
        self._line: bytes | None = None
        self._tokens = 0

    @staticmethod
    def lines(forms: Sequence[Form]) -> list[bytes]:
        """Return the canonical JSON of messages, of which a prompt's sha256 is made; ids are `<turn>.<position>`."""
        return [form._line or form._encoded() for form in forms]

    def _encoded(self) -> bytes:
        if self._turn is None:
            self._line = head_bytes(self.message)
        else:
            positions = range(len(calls_of(self.message))) if self._position is None else [self._position]
            ids = [f"{self._turn}.{position}" for position in positions]
            self._line = message_bytes(self.message, ids, self._arguments or ())
        return self._line

    @property
    def is_result(self) -> bool:
        """Whether it is the result of a call."""
        return self.message["role"] == "tool"

    def tokens(self, counter: TokenCounter) -> int:
        """Return the budget tokens of the message."""
        if self._counter is not counter:
            self.is_counted(counter, counter.message(self.message, self._arguments))
        return self._tokens

    def is_counted(self, counter: TokenCounter, tokens: int) -> None:
        """Take note of the tokens that a counter has counted."""
        self._tokens, self._counter = tokens, counter  # in this order: another thread may read between the two


@dataclass
class Item:
    """A message that follows the assistant's in its turn. It is not changed once it is made."""

    message: Message
    step: int
    """The index of the newest observation shown so far, this item's own included; 0 before the first."""
    observation_step: int | None = None
    """The index of the observation that it shows; None for manual, errors, user messages and other tools' results."""
    position: int | None = None
    """The position of the call that it answers; None if it is not a tool result."""
    brings_back: bool = False
    """Whether it is the answer of a tool of memory that brings observations back."""
    is_error: bool = False
    """Whether it says that the game, or a tool, has refused the call."""
    reward: float | None = None
    """The reward of the step that the call has played; None if it played none."""
    words: Wording = field(kw_only=True, repr=False, compare=False)
    """What replaces it once it is too old."""

    @property
    def date(self) -> int | None:
        """The step by which it ages: that of the observation it shows, or that at which it brought others back."""
        return self.step if self.brings_back else self.observation_step

    @cached_property
    def masked(self) -> Message:
        """The message that replaces this one once it is too old to be shown."""
        masked = self.message.copy()
        masked["content"] = self.words("observation_left")
        return masked

    @property
    def observation_words(self) -> str:
        """Its words; empty if it has only a picture."""
        text = text_of(self.message)
        return "" if text.startswith(self.words("picture_shown")) else text

    @cached_property
    def elided(self) -> Message:
        """The message that replaces this one once its picture is elided: its words, or the marker without any."""
        text = self.observation_words
        if not text:
            return self.masked
        elided = self.message.copy()
        elided["content"] = text
        return elided


@dataclass
class Turn:
    """An assistant message and its items: the results in the order of its calls, then everything else.

    A turn is not changed once it is made. It is not a frozen class, because those take three times as long to make.
    """

    number: int
    assistant: Message
    """Its call ids are those of the conversation."""
    items: tuple[Item, ...]
    made_at: int
    """The step at which the message was made, for a turn without items."""
    manual: str | None = None
    """What is part of the head from then on: the manual, if it has been read; with a compactor the newest notes."""
    calls: tuple[Call, ...] = field(default_factory=tuple)
    """The parsed calls of the message; by default they are parsed from it."""
    notes: int | None = None
    """The newest turn with notes, this one included; None while there are no notes."""
    first_picture: int = 0
    """How many pictures the turns before it have."""
    reply_tokens: int | None = field(default=None, repr=False, compare=False)
    """The budget tokens of the assistant message as prompts hold it, where they have been counted."""
    sent: Message | None = field(default=None, repr=False)
    """The message as prompts hold it, if that differs from what the model said: see `context.prompts.history`."""
    shown: Message = field(init=False, repr=False, compare=False)
    """The message as prompts hold it."""
    arguments: tuple[str, ...] = field(init=False, repr=False, compare=False)
    """The arguments of its calls as prompts hold them, in canonical form."""
    step: int = field(init=False, repr=False, compare=False)
    """The step of its newest item."""
    shows: tuple[int, ...] = field(init=False, repr=False, compare=False)
    """The observations that its results show, in their order; the last is its step."""
    dates: tuple[int, ...] = field(init=False, repr=False, compare=False)
    """The dates of the results that age, in their order; the last is its step."""
    whole: tuple[Form, ...] = field(init=False, repr=False, compare=False)
    """All its messages, with no observation masked."""

    def __post_init__(self) -> None:
        if not self.calls and calls_of(self.assistant):
            ids = [call.get("id", "") for call in calls_of(self.assistant)]
            self.calls = read_calls(self.assistant, ids)
        if self.sent is None:
            self.shown = self.assistant
            self.arguments = tuple([call.arguments.canonical for call in self.calls])
        else:
            self.shown = self.sent
            self.arguments = tuple([call.arguments.sent_canonical for call in self.calls])
        step, shows, dates, whole = self.made_at, [], [], [Form(self.shown, self.number, arguments=self.arguments)]
        for item in self.items:
            step = max(step, item.step)
            whole.append(self._form(item, item.message, item.observation_step))
            if item.observation_step is not None:
                shows.append(item.observation_step)
            if (date := item.date) is not None:
                dates.append(date)
        self.step, self.shows, self.dates, self.whole = step, tuple(shows), tuple(dates), tuple(whole)

    @cached_property
    def pictured(self) -> tuple[int, ...]:
        """The indices of the items with a picture."""
        return tuple([at for at, item in enumerate(self.items) if pictures_of(item.message)])

    @property
    def pictures_so_far(self) -> int:
        """How many pictures there are up to its end."""
        return self.first_picture + len(self.pictured)

    @property
    def tools(self) -> tuple[str, ...]:
        """The names of the tools that it calls, in the order of its calls."""
        return tuple([call.name for call in self.calls])

    @property
    def errors(self) -> int:
        """How many of its calls were refused."""
        return sum(item.is_error for item in self.items)

    @property
    def rewards(self) -> tuple[float, ...]:
        """The rewards of the steps that it has played, in their order."""
        return tuple([item.reward for item in self.items if item.reward is not None])

    @property
    def messages(self) -> list[Message]:
        """All its messages, unmasked."""
        return [form.message for form in self.whole]

    @cached_property
    def masked(self) -> tuple[Form, ...]:
        """All its messages, with every observation masked."""
        dated = [self._form(item, item.masked) if item.date is not None else None for item in self.items]
        return tuple([form or whole for form, whole in zip([None, *dated], self.whole, strict=True)])

    @cached_property
    def elided(self) -> tuple[Form, ...]:
        """All its messages without their pictures; one that has no words is masked."""
        forms = list(self.whole)
        for at in self.pictured:
            item = self.items[at]
            is_empty = item.elided is item.masked
            forms[at + 1] = self.masked[at + 1] if is_empty else self._form(item, item.elided, item.observation_step)
        return tuple(forms)

    def _form(self, item: Item, message: Message, step: int | None = None) -> Form:
        return Form(message, self.number, position=item.position, step=step)

    @cached_property
    def is_wordy(self) -> bool:
        """Whether the reply has calls, and words, reasoning or items of its provider with them."""
        reply = self.shown
        return bool(self.calls) and bool(text_of(reply) or reasoning_of(reply) or reply.get("provider_items"))

    @cached_property
    def trimmed(self) -> Form:
        """The reply with its calls alone: what is shown of it once its words are too old."""
        kept: Message = {"role": "assistant", "content": None}
        if name := self.shown.get("name"):
            kept["name"] = name
        kept["tool_calls"] = self.shown["tool_calls"]
        return Form(kept, self.number, arguments=self.arguments)

    @cached_property
    def thoughtless(self) -> Form | None:
        """The reply without its thoughts; None if it has none, or nothing else."""
        kept: Any = {name: value for name, value in self.shown.items() if name not in THOUGHT_PLACES}
        return None if len(kept) == len(self.shown) or not (kept["content"] or self.calls) else Form(kept)

    def masked_items(self, oldest: int, elided: int = 0) -> list[int]:
        """Return the indices of the items shown as the marker: they are old, or only a picture that is elided."""
        old: list[int] = []
        if not self.is_young(oldest):
            old = [at for at, item in enumerate(self.items) if (date := item.date) is not None and date < oldest]
        if elided and (without := self.elided_items(elided)):
            empty = {at for at in without if self.items[at].elided is self.items[at].masked}
            return sorted(empty.union(old))
        return old

    def is_young(self, oldest: int) -> bool:
        """Whether none of its results is older than `oldest`."""
        return not self.dates or oldest <= self.dates[0]

    def elided_items(self, elided: int) -> Sequence[int]:
        """Return the indices of the items whose picture is elided where the first `elided` of all are."""
        return self.pictured[: max(0, elided - self.first_picture)]

    def seen(self, oldest: int, *, trimmed_before: int = 0, elided: int = 0) -> tuple[Form, ...]:
        """Return its messages, each at its level.

        Observations older than `oldest` are masked, the reply of a turn older than `trimmed_before` is trimmed, and
        the first `elided` pictures of the conversation are elided.
        """
        forms = self._results(oldest, elided)
        if self.step < trimmed_before and self.is_wordy:
            return (self.trimmed, *forms[1:])
        return forms

    def _results(self, oldest: int, elided: int) -> tuple[Form, ...]:
        """Its messages with a whole reply."""
        without = self.elided_items(elided) if elided else ()
        if not without and self.is_young(oldest):
            return self.whole
        if oldest > self.step:
            return self.masked
        forms = list(self.whole)
        for at in without:
            forms[at + 1] = self.elided[at + 1]
        for at in self.masked_items(oldest):
            forms[at + 1] = self.masked[at + 1]
        return tuple(forms)


class TurnBuilder:
    """Makes turns from events, one event after the other."""

    def __init__(self, words: Wording, *, compacts: bool = False) -> None:
        """`words` are those of the episode; `compacts` says that a compactor rewrites its history.

        A manual that was read is then the result of its call, and the notes are a part of the head.
        """
        self._compacts = compacts
        self._words = words
        self.turns: list[Turn] = []
        """The turns that are complete."""
        self.step = 0
        """The newest observation shown so far."""
        self.manual: str | None = None
        """The manual, once it has been read; with a compactor the newest notes, under the name of their tool."""
        self.notes: int | None = None
        """The newest turn with notes."""
        self.number = -1
        """The number of the latest turn, -1 before the first."""
        self.is_open = False
        """Whether the latest turn can still be added to."""
        self.calls: tuple[Call, ...] = ()
        """The calls of the latest turn."""
        self.waiting: tuple[int, ...] = ()
        """The positions of the open turn's calls that have no result yet."""
        self._assistant: Message = {"role": "assistant", "content": None}
        self._sent: Message | None = None
        self._made_at = 0
        self._results: dict[int, Item] = {}
        self._others: list[Item] = []
        self._made: list[Turn] = []
        """The open turn as it is now, once it has been asked for. Hosts ask from other threads than the one that
        answers a call: a change replaces the list, so that what was made of the state before is never read again."""
        self._reply_tokens: int | None = None
        self._pictures = self._first_picture = 0
        """How many pictures there are so far, and how many there are before the latest turn."""

    def apply(self, event: Mapping[str, Any]) -> None:
        """Take an event of a record; kinds that make no turn are ignored."""
        match event["event"]:
            case "message" if event["by"] == "player":
                message = event["message"]
                ids = event.get("ids") or [call["id"] for call in calls_of(message)]
                self.open(event["turn"], message, read_calls(message, ids))
            case "message":
                self.add(event["message"], event.get("position"))
            case "call" if self.is_open:
                if event.get("host") == "edited":
                    self.edit(event["position"], event["arguments"])
                self.add_result(event["position"], event["text"], event["data"], is_error=event["is_error"])

    def open(self, number: int, message: Message, calls: Sequence[Call], tokens: int | None = None) -> None:
        """Begin a turn with a reply, of `tokens` if they are known; the turn before is complete."""
        self.close()
        self.number, self.is_open, self.calls = number, True, tuple(calls)
        self._assistant, self._made_at = with_ids(message, [call.id for call in calls]), self.step
        self._sent = sent_reply(self._assistant, self.calls, self._words.version)
        self.waiting = tuple(range(len(calls)))
        self._reply_tokens, self._results, self._others = tokens, {}, []
        self._first_picture, self._made = self._pictures, []

    def edit(self, position: int, arguments: str) -> None:
        """Replace the arguments of a call, as a host may before it is played."""
        edited = copy_of(self._assistant)
        edited["tool_calls"][position]["function"]["arguments"] = arguments
        self._assistant = edited
        self.calls = read_calls(edited, [call.id for call in self.calls])
        self._sent = sent_reply(edited, self.calls, self._words.version)
        self._reply_tokens, self._made = None, []

    def add_result(self, position: int, text: str, data: Mapping[str, Any], *, is_error: bool = False) -> None:
        """Add the game's answer to a call."""
        if data.get("manual") and not self._compacts:
            self.manual, text = text, self._words("manual_is_above")
        if "notes" in data:
            self.notes = self.number if data["notes"] == "kept" else None
            if self._compacts:
                noted = (self.calls[position].arguments.values or {}).get("text")
                self.manual = None if self.notes is None else f"{NOTES_TOOL}:\n{noted}"
        observation = data.get("observation_step")
        if observation is not None:
            self.step = max(self.step, observation)
        content: str | list[dict[str, Any]] = text
        if (picture := data.get("picture")) is not None:
            content = [{"type": "text", "text": text}, picture_part(picture)]
            self._pictures += 1
        message: Message = {"role": "tool", "content": content, "tool_call_id": self.calls[position].id}
        is_back = not data.keys().isdisjoint(BROUGHT_BACK)
        item = Item(
            message,
            self.step,
            observation,
            position,
            is_back,
            is_error=is_error,
            reward=data.get("reward"),
            words=self._words,
        )
        self._answer(position, item)

    def add(self, message: Message, position: int | None) -> None:
        """Add a message of the host or the library; with a `position`, the result of a foreign tool's call."""
        item = Item(message, self.step, position=position, words=self._words)
        if position is not None:
            self._answer(position, item)
        else:
            self._others.append(item)
            self._made = []

    def _answer(self, position: int, item: Item) -> None:
        self._results[position] = item
        self.waiting = tuple([at for at in self.waiting if at != position])
        self._made = []

    def close(self) -> None:
        """Complete the open turn."""
        if self.is_open and (latest := self.latest) is not None:
            self.turns.append(latest)
            self.is_open, self.waiting = False, ()

    @property
    def latest(self) -> Turn | None:
        """The open turn as it is now, or else the last one; None before the first."""
        if not self.is_open:
            return self.turns[-1] if self.turns else None
        made = self._made
        if not made:
            items = (*[self._results[at] for at in sorted(self._results)], *self._others)
            tokens = self._reply_tokens if self._sent is None else None  # counted as the model said it
            facts = self._made_at, self.manual, self.calls, self.notes, self._first_picture, tokens, self._sent
            made.append(Turn(self.number, self._assistant, items, *facts))
        return made[0]


def with_ids(message: Message, ids: list[str]) -> Message:
    """Return a message whose calls have these ids; the message itself if they have them already."""
    calls = calls_of(message)
    if [call["id"] for call in calls] == ids:
        return message
    changed = message.copy()
    changed["tool_calls"] = [{**call, "id": call_id} for call, call_id in zip(calls, ids, strict=True)]
    return changed
