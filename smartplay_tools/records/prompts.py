"""Rebuilds every prompt exactly, from a transcript alone and without running a game.

A `view` event says which turns a prompt showed and which results were masked; `head`, `message`, `call` and `summary`
events contain the texts. The sha256 in the `view` event verifies the rebuilt prompt.

`WholeConversation` is every message of an episode, as if there had been no window. In the record of a window, the
manual that a model has read is in the head of every later prompt, and the result that read it refers to it there; in a
whole conversation the manual is that result. The record of an episode whose host managed the context has calls and
answers only: its conversation has a message for each turn of calls, and the head is that of a new episode of the same
config. The words that the host's model said with its calls are in no record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, NamedTuple

from smartplay_tools.context.choosing import text_message
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.rewriting import Rewriting
from smartplay_tools.context.strategies.summaries import summaries_of
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.turns import Turn, TurnBuilder
from smartplay_tools.context.view import Head, Selection, numbers_in, with_manual
from smartplay_tools.conversation import paper
from smartplay_tools.conversation.ids import CallIds
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.episode.tools import schema
from smartplay_tools.transcript.events import CallEvent, ErrorLocation, Event, concerns_summary, purpose_of
from smartplay_tools.transcript.hashing import head_bytes, prompt_sha256, tools_bytes
from smartplay_tools.types import Prompt, ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message, calls_of, pictures_of, read_calls, text_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture


@dataclass(frozen=True)
class SentPrompt:
    """A prompt as it was sent."""

    turn: int
    """The turn that it led to."""
    prompt: Prompt
    recorded_sha256: str
    sha256: str
    """The sha256 of the rebuilt prompt; it differs from the recorded one only if the transcript was changed."""


def sent_prompts(
    events: Sequence[Event], turns: Sequence[Turn] | None = None, *, pictures: Mapping[str, Picture] = NO_PICTURES
) -> Iterator[SentPrompt]:
    """Yield every prompt of a transcript, in order; `turns` are its `recorded_turns`, if they are known already.

    A record has no pictures, so prompts only name them; with `pictures` (`recorded_pictures`) they have them, too.
    """
    head = next((event for event in events if event["event"] == "head"), None)
    if head is None:
        return
    if events[0]["config"].get("protocol") == "paper":
        yield from _prompts_of_the_paper(events)
        return
    rebuilder = Rebuilder(events, recorded_turns(events) if turns is None else turns, pictures)
    with ErrorLocation() as at:
        for at.number, at.event in enumerate(events, start=1):
            if at.event["event"] == "head":
                rebuilder.use_head(at.event)
            if at.event["event"] == "rewrite":
                rebuilder.use_rewriting(at.event)
            if at.event["event"] == "view":
                yield rebuilder.rebuild(at.event)


def _prompts_of_the_paper(events: Sequence[Event]) -> Iterator[SentPrompt]:
    observations: list[str] = []
    manual, thoughts = None, None
    for event in events:
        match event["event"]:
            case "head":
                manual = next((text_of(message) for message in event["messages"][1:]), None)
                observations += [*event["before"], event["observation"]]
            case "message":
                answer = text_of(event["message"])
                thoughts = answer if thoughts is None else None
            case "call":
                observations.append(event["text"])
            case "view":
                messages = paper.prompt_messages(manual, observations, event["first"], thoughts)
                prompt = Prompt(messages, (), event["max_tokens"])
                yield SentPrompt(event["turn"], prompt, event["sha256"], paper.messages_sha256(messages))


def recorded_turns(events: Sequence[Event]) -> list[Turn]:
    """Return the turns of a transcript, the last one as far as it goes."""
    if not events or events[0]["event"] != "start":
        return []
    with ErrorLocation() as at:
        at.number, at.event = 1, events[0]
        builder = TurnBuilder(Wording.recorded(at.event), compacts=is_compacted(events))
        for at.number, at.event in enumerate(events, start=1):
            builder.apply(at.event)
    builder.close()
    return builder.turns


def is_compacted(events: Sequence[Event]) -> bool:
    """Return whether a compactor rewrote the history of a transcript."""
    head = next((event for event in events if event["event"] == "head"), None)
    return head is not None and bool(head.get("compacts"))


class PromptParts(NamedTuple):
    """The parts of a prompt, in their order."""

    head: Head
    before: Sequence[Message]
    """The summary, if one is shown."""
    front: int
    """How many of the turns stand before the summary: first turns that stay."""
    ranges: Sequence[Sequence[int]]
    """The turns, as ranges of their numbers, first and last included."""
    masks: Callable[[Turn], int] | None
    """Returns the oldest observation that is shown of a turn; None if all are shown."""
    words: int
    """Replies of turns older than this step are bare."""
    pictures: int
    """How many of the first pictures are left out."""
    texts: Mapping[int, Message]
    """The texts of a custom strategy, by the turn before which each stands."""
    after: Sequence[Message]
    """The question for a summary, if the prompt asks for one."""

    @property
    def is_whole(self) -> bool:
        """Whether there are only turns between head and question, and these whole."""
        return self.masks is None and not (self.words or self.pictures or self.before or self.texts)

    def seen(self, turns: Sequence[Turn]) -> Iterator[tuple[Turn, int, bool]]:
        """Yield each of the turns with the oldest observation that is shown of it, and whether its reply is bare."""
        for first, last in self.ranges:
            for turn in turns[first : last + 1]:
                yield turn, 0 if self.masks is None else self.masks(turn), turn.step < self.words


class Rebuilder:
    """Rebuilds the prompts of one record; parts that several prompts share are encoded once."""

    def __init__(
        self, events: Sequence[Event], turns: Sequence[Turn], pictures: Mapping[str, Picture] = NO_PICTURES
    ) -> None:
        self._turns, self._pictures = turns, pictures
        self._summaries = [event["text"] for event in events if event["event"] == "summary"]
        words = Wording.recorded(events[0])
        self._version = words.version
        self._rewriting: Rewriting | None = None
        # What a prompt says does not depend on how it is counted.
        self._form = summaries_of(ResolvedBudget(**events[0]["budget"]), shared_counter("approximate"), words)

    def use_head(self, head: Event) -> None:
        """Rebuild the following prompts with another head and its tools."""
        self._head: list[Message] = head["messages"]
        self._tools = tuple(ToolSpec(**tool) for tool in head["tools"])
        self._tools_bytes = tools_bytes(self._tools)
        self._heads: dict[str | None, Head] = {}
        if head.get("compacts"):
            self._rewriting = Rewriting(self._head[1:])
            self._head = self._head[:1]

    def use_rewriting(self, event: Event) -> None:
        """Rebuild the next prompt to play with what a compactor has returned."""
        assert self._rewriting is not None
        self._rewriting.take(event, self._turns)

    def rebuild(self, view: Event) -> SentPrompt:
        """Return the prompt that a view shows."""
        if self._rewriting is not None:
            return self._rebuilt(view, self._rewriting)
        shown = self.shown(view)
        messages, lines = [*shown.head.messages], shown.head.canonical.copy()
        for place, (turn, oldest, bare) in enumerate(shown.seen(self._turns)):
            if place == shown.front:
                messages.extend(shown.before)
                lines += map(head_bytes, shown.before)
            if turn.number in shown.texts:
                messages.append(shown.texts[turn.number])
                lines.append(head_bytes(shown.texts[turn.number]))
            messages.extend(turn.seen(oldest, bare=bare, pictures=shown.pictures))
            lines.extend(turn.canonical_seen(oldest, bare=bare, pictures=shown.pictures))
        messages += shown.after
        lines += map(head_bytes, shown.after)
        return self._sent(view, messages, lines, self._tools, self._tools_bytes)

    def _rebuilt(self, view: Event, rewriting: Rewriting) -> SentPrompt:
        """The prompt of a compactor's rewriting, or of its question."""
        shown = rewriting.shown(view, self._turns)
        if not concerns_summary(view):
            head = self._head_of(self._turns[view["turn"] - 1].manual if view["turn"] else None)
            messages, lines = [*head.messages, *shown[0]], [*head.canonical, *shown[1]]
            return self._sent(view, messages, lines, self._tools, self._tools_bytes)
        tools = self._tools if any(calls_of(message) for message in shown[0]) else ()
        return self._sent(view, *shown, tools, self._tools_bytes if tools else tools_bytes(()))

    def _sent(
        self, view: Event, messages: list[Message], lines: list[bytes], tools: tuple[ToolSpec, ...], encoded: bytes
    ) -> SentPrompt:
        named = [part["sha256"] for message in messages for part in pictures_of(message)] if self._pictures else []
        shown_pictures = {sha256: self._pictures[sha256] for sha256 in named}
        cap, asked = view["max_tokens"], purpose_of(view)
        prompt = Prompt(messages, tools, cap, purpose=asked, pictures=shown_pictures, version=self._version)
        return SentPrompt(view["turn"], prompt, view["sha256"], prompt_sha256(lines, encoded))

    def shown(self, view: Event) -> PromptParts:
        """Return the parts of the prompt that a view shows."""
        is_summary = concerns_summary(view)
        seen_turns = view["turn"] - is_summary
        before: list[Message] = []
        if self._form is not None and view["summary"] and (text := self._summaries[view["summary"] - 1]):
            before.append(self._form.show(text).message)
        return PromptParts(
            self._head_of(self._turns[seen_turns - 1].manual if seen_turns else None),
            before,
            sum([last < view["anchors"] for _, last in view["turns"][:-1]]) if "anchors" in view else 0,
            view["turns"],
            self._masks(view),
            view.get("words", 0),
            view.get("pictures", 0),
            {turn: text_message(text) for turn, text in view["texts"]} if "texts" in view else {},
            [self._form.question] if self._form is not None and is_summary else [],
        )

    def _masks(self, view: Event) -> Callable[[Turn], int] | None:
        """Return a function of the oldest observation that a view shows of a turn; None if it shows all."""
        if "oldest" in view:
            masked = frozenset(numbers_in(view.get("hidden", ())))
            return Selection((), 0, -1, view["oldest"], view["notes"], masked=masked).oldest_of
        if not view["masked"]:
            return None
        results = {(turn, item) for turn, item in view["masked"]}
        return lambda turn: _boundary(turn, results)

    def _head_of(self, manual: str | None) -> Head:
        if manual not in self._heads:
            messages = self._head if manual is None else with_manual(self._head, manual)
            self._heads[manual] = Head(tuple(messages), 0)
        return self._heads[manual]


def _boundary(turn: Turn, masked: set[tuple[int, int]]) -> int:
    """The observation below which a turn's results were masked."""
    steps = [item.date for at, item in enumerate(turn.items) if (turn.number, at) in masked]
    return max((step for step in steps if step is not None), default=-1) + 1


@dataclass(frozen=True)
class WholeConversation:
    """The head, the tools and the turns of an episode."""

    head: Sequence[Message]
    """The messages before the first reply."""
    tools: list[dict[str, Any]]
    """The tools, each a function of chat completions."""
    turns: Sequence[Turn]
    """The turns, each manual that was read in its place."""

    @property
    def messages(self) -> list[Message]:
        """All messages, in their order."""
        return [*self.head, *(message for turn in self.turns for message in turn.messages)]


def whole_conversation(
    head: Sequence[Message], tools: list[dict[str, Any]], turns: Sequence[Turn], calls: Sequence[CallEvent]
) -> WholeConversation:
    """Return the conversation of a head, its tools and the turns; `calls` say which results were the manual."""
    read = {(call["turn"], call["position"]) for call in calls if call["data"].get("manual")}
    return WholeConversation(head, tools, [_with_manual(turn, read) for turn in turns])


def conversation_of_host(config: EpisodeConfig, calls: Sequence[CallEvent]) -> WholeConversation:
    """Return the conversation of an episode whose host managed the context, from its calls."""
    with Episode.from_config(config) as episode:
        tools = [{"type": "function", "function": schema(tool, "json")} for tool in episode.tools]
        head = episode.head
    calls = _renumbered(calls)
    return whole_conversation(head, tools, _turns_of_a_host(calls, Wording.of(config.prompts)), calls)


def _with_manual(turn: Turn, read: set[tuple[int, int]]) -> Turn:
    """The turn whose results that read the manual are the manual."""
    if turn.manual is None or not any(number == turn.number for number, _ in read):
        return turn
    items = (
        replace(item, message={**item.message, "content": turn.manual})
        if (turn.number, item.position) in read
        else item
        for item in turn.items
    )
    return replace(turn, items=tuple(items))


def _renumbered(calls: Sequence[CallEvent]) -> Sequence[CallEvent]:
    """The calls with their place among those of their turn that were played: a repeated call is not recorded."""
    turns = (list(group) for _, group in groupby(calls, key=lambda call: call["turn"]))
    return [{**call, "position": at} for own in turns for at, call in enumerate(own)]


def _turns_of_a_host(calls: Sequence[CallEvent], words: Wording) -> Sequence[Turn]:
    builder, ids = TurnBuilder(words), CallIds()
    for number, group in groupby(calls, key=lambda call: call["turn"]):
        own = list(group)
        taken = ids.take([""] * len(own), number)
        message = _asking(own, taken)
        builder.open(number, message, read_calls(message, taken))
        for call in own:
            builder.add_result(call["position"], call["text"], call["data"])
    builder.close()
    return builder.turns


def _asking(calls: Sequence[CallEvent], ids: Sequence[str]) -> Message:
    """The message of a model that makes these calls."""
    return {
        "role": "assistant",
        "content": None,
        "tool_calls": [
            {
                "id": call_id,
                "type": "function",
                "function": {"name": call["name"], "arguments": call["arguments"] or "{}"},
            }
            for call, call_id in zip(calls, ids, strict=True)
        ],
    }
