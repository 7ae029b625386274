"""Rebuilds every prompt exactly, from a transcript alone and without running a game.

A `view` event says which turns a prompt showed and which results were masked; `head`, `message`, `call` and `summary`
events contain the texts. The sha256 in the `view` event verifies the rebuilt prompt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from smartplay_tools.context.choosing import text_message
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.rewriting import Rewriting, from_record
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.tokens.counter import shared_counter
from smartplay_tools.context.turns import Form, Turn, TurnBuilder
from smartplay_tools.context.view import Selection, numbers_in
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.conversation import paper
from smartplay_tools.records.faults import record_named
from smartplay_tools.transcript.events import Event, purpose_of
from smartplay_tools.transcript.hashing import prompt_sha256, tools_bytes
from smartplay_tools.types import Prompt, ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message, pictures_of, text_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture

T = TypeVar("T")


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
    yield from rebuilder.each(rebuilder.rebuild)


def rewritten_prompts(
    events: Sequence[Event], turns: Sequence[Turn]
) -> Iterator[tuple[Event, ContextWindow, Selection]]:
    """Yield every prompt to play whose messages a compactor has rewritten: its view, the messages, what it shows."""
    if is_compacted(events):
        rebuilder = Rebuilder(events, turns)
        for view, chosen in rebuilder.each(lambda view: (view, rebuilder.reach(view))):
            if purpose_of(view) == "play":
                yield view, rebuilder.window, chosen


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
    with record_named() as at:
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


def selection_of(view: Mapping[str, Any], turns: Sequence[Turn]) -> Selection:
    """Return the selection of turns that a `view` event describes, without the messages."""
    rows = [range(first, last + 1) for first, last in view["turns"] or [(0, -1)]]
    masked = frozenset(numbers_in(view.get("hidden", ())))
    trimmed_before, elided = (view.get(name, 0) for name in ("words", "pictures"))
    return Selection(rows, (), oldest_of(view, turns), trimmed_before, elided, masked, pinned_in(view))


def pinned_in(view: Mapping[str, Any]) -> int | None:
    """Return the turn that a strategy had pinned in a prompt, by whichever name it has in the record."""
    pinned: int | None = view["notes"] if view.get("notes") is not None else view.get("pinned")
    return pinned


def oldest_of(view: Mapping[str, Any], turns: Sequence[Turn]) -> int:
    """Return the observation before which a prompt masked every other."""
    if "oldest" in view:
        oldest: int = view["oldest"]
        return oldest
    dates = (turns[turn].items[item].date for turn, item in view.get("masked", ()))
    return max((date for date in dates if date is not None), default=-1) + 1


class Rebuilder:
    """Rebuilds the prompts of one record from its events, in their order. What prompts share is made once."""

    def __init__(
        self, events: Sequence[Event], turns: Sequence[Turn], pictures: Mapping[str, Picture] = NO_PICTURES
    ) -> None:
        self._events, self._turns, self._pictures = events, turns, pictures
        self._summaries = [event["text"] for event in events if event["event"] == "summary"]
        words = Wording.recorded(events[0])
        self._version, self._budget = words.version, ResolvedBudget(**events[0]["budget"])
        self._counter = shared_counter("approximate")  # what a prompt says does not depend on how it is counted
        self._strategies = Strategies(self._budget, self._counter, words)
        self._window: ContextWindow | None = None
        self._oldest = 0
        """The oldest observation that is not too old, whatever a prompt shows."""
        self._rewriting: Rewriting | None = None
        """With a compactor: what it has made of the messages."""

    @property
    def window(self) -> ContextWindow:
        """The window whose messages are those of the latest prompt."""
        if self._window is None:
            raise ValueError("it comes before the head of a conversation")
        return self._window

    def each(self, make: Callable[[Event], T]) -> Iterator[T]:
        """Yield what is made of each view, in their order; an error names its event."""
        with record_named() as at:
            for at.number, at.event in enumerate(self._events, start=1):
                self._take(at.event)
                if at.event["event"] == "view":
                    yield make(at.event)

    def _take(self, event: Event) -> None:
        """Take the next event; a `head` and a `rewrite` event change what the following prompts show."""
        if event["event"] == "head":
            tools = tuple(ToolSpec(**tool) for tool in event["tools"])
            self._tools_bytes = tools_bytes(tools)
            if self._window is not None:
                self._window.change_head(event["messages"], tools)
                return
            always = 1 if event.get("compacts") else len(event["messages"])
            head, lead = event["messages"][:always], event["messages"][always:]
            aged: Message | None = {"role": "user", "content": event["aged_task"]} if "aged_task" in event else None
            given = self._budget, self._counter, self._strategies
            self._window = ContextWindow(head, tools, *given, lead=lead, aged_task=aged)
            self._rewriting = Rewriting(self._window) if event.get("compacts") else None
        elif event["event"] == "rewrite" and self._rewriting is not None:
            self._add(event["turn"])
            self._rewriting.take(event)

    def rebuild(self, view: Event) -> SentPrompt:
        """Return the prompt that a view shows."""
        tools, forms = self.parts(view)
        messages = [form.message for form in forms]
        named = [part["sha256"] for message in messages for part in pictures_of(message)] if self._pictures else []
        shown_pictures = {sha256: self._pictures[sha256] for sha256 in named}
        cap, asked = view["max_tokens"], purpose_of(view)
        prompt = Prompt(messages, tools, cap, purpose=asked, pictures=shown_pictures, version=self._version)
        encoded = self._tools_bytes if tools else tools_bytes(())
        return SentPrompt(view["turn"], prompt, view["sha256"], prompt_sha256(Form.lines(forms), encoded))

    def parts(self, view: Event) -> tuple[tuple[ToolSpec, ...], list[Form]]:
        """Return the tools and the messages of the prompt that a view shows."""
        chosen, window = self.reach(view), self.window
        forms = window.forms(chosen)
        if purpose_of(view) == "compaction":
            return window.tools_beside(forms), forms
        return window.tools, [*window.head, *forms]

    def reach(self, view: Event) -> Selection:
        """Give the messages the levels that they had in the prompt of a view; return what it shows."""
        asked, window, form = purpose_of(view), self.window, self._strategies.summaries
        seen = view["turn"] - (asked == "summary")
        self._add(seen)
        window.use_head(self._turns[seen - 1].manual if seen else None, self._oldest)
        chosen = selection_of(view, self._turns)
        window.age(chosen.oldest, chosen.trimmed_before, chosen.elided)
        if self._rewriting is not None:
            pieces = from_record(view["messages"]) if asked == "compaction" else None
            return self._rewriting.selection(pieces)
        texts = {turn: Form(text_message(text)) for turn, text in view.get("texts", ())}
        if form is not None and view["summary"] and (text := self._summaries[view["summary"] - 1]):
            anchors = view.get("anchors", 0)
            front = next((row.start for row in chosen.turns if row.start >= anchors), chosen.turns[-1].start)
            texts[front] = form.show(text).form
        pieces = window.pieces(chosen.turns, texts)
        if form is not None and form.question is not None and asked == "summary":
            pieces.append(form.question)
        return replace(chosen, pieces=pieces)

    def _add(self, stop: int) -> None:
        """Add the turns up to before one."""
        for turn in self._turns[len(self.window.turns) : stop]:
            self.window.add(turn)
            self._oldest = self._strategies.ageing.oldest(turn.step, self._budget.history, self._oldest)
