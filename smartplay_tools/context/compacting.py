"""The window of a compactor: it shows what the compactor makes of the conversation, within the cap.

The compactor is asked once for each prompt to play. What it returns takes the place of the history, and is shown with
its oldest turns left out until it fits: whatever it does, no prompt is over its cap, and no result that is too old
shows an observation. A question that it asks is a prompt of its own. While nothing is rewritten, the time for a prompt
grows with what it shows, and hardly with the conversation.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from typing import Any, Protocol

from smartplay_tools.context.compaction import Compactor, GivenHistory, Room
from smartplay_tools.context.prefix import common_head
from smartplay_tools.context.rewriting import (
    SYSTEM,
    NumberedMessages,
    Own,
    Piece,
    Place,
    Reader,
    flat,
    from_record,
    given_form,
    on_record,
    with_task,
)
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.custom import AsRecorded
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import Selection, View, ranges_of
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.context.window_state import Contents, WindowState
from smartplay_tools.errors import ContextOverflowError, PromptOverflowError, StrategyError, TranscriptError
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message, calls_of, copy_of, pictures_of, text_of

MOST_QUESTIONS = 16
"""The most questions for a prompt, refused ones included."""


class Ids(Protocol):
    """The call ids of a conversation."""

    def take(self, sent: Sequence[str], turn: int) -> list[str]:
        """Return an id for every call of a turn."""
        ...

    def reserve(self, ids: Iterable[str]) -> None:
        """Take ids that calls have already."""
        ...


@dataclass(frozen=True)
class Made:
    """What a compactor does next: it asks a question, or returns messages."""

    is_question: bool
    pieces: list[Piece]


class Running:
    """A compactor while it makes one prompt."""

    def __init__(
        self, compactor: Compactor, given: Sequence[Piece], reader: Reader, room: Callable[[Running], Room]
    ) -> None:
        self._compactor, self._given, self._reader = compactor, given, reader
        shown, length = reader.messages.shown, sum(map(_length, given))
        self._history = GivenHistory(length, lambda: [copy_of(given_form(shown(place))) for place in flat(given)])
        self._room = room(self)
        self._questions: Generator[Any, Any, Any] | None = None

    @cached_property
    def places(self) -> list[Place]:
        """The messages that it is given, one by one."""
        return flat(self._given)

    def go_on(self, answer: Message | ContextOverflowError | None) -> Made:
        """Go on to the next question, or to the end; `answer` is what the latest question is answered with."""
        try:
            return self._next(answer)
        except StrategyError:
            raise
        except Exception as error:  # whatever the compactor does
            raise StrategyError("The compactor has failed.") from error

    def _next(self, answer: Message | ContextOverflowError | None) -> Made:
        if answer is None:
            made = self._compactor.compact(self._history, self._room)
            if not inspect.isgenerator(made):
                return self._read(made, is_question=False)
            self._questions = made
        assert self._questions is not None
        try:
            if isinstance(answer, ContextOverflowError):
                asked = self._questions.throw(answer)
            else:
                asked = self._questions.send(answer)
        except StopIteration as end:
            return self._read(end.value, is_question=False)
        return self._read(asked, is_question=True)

    def _read(self, made: Any, *, is_question: bool) -> Made:
        if made is self._history and self._history.is_untouched:
            return Made(is_question, list(self._given))
        return Made(is_question, self._reader.pieces(made, self.places))

    def close(self) -> None:
        """End the generator, which may wait for an answer; nobody is left to hear what it raises then."""
        if self._questions is not None:
            with suppress(Exception):
                self._questions.close()


class CompactingWindow(ContextWindow):
    """A window whose history a compactor rewrites."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies,
        ids: Ids,
    ) -> None:
        """`ids` are those of the conversation, of which calls get one whose id the compactor has made up."""
        super().__init__(head[:1], tools, budget, counter, strategies)
        assert isinstance(strategies.custom, Compactor)
        self._compactor, self._recorded, self._ids = strategies.custom, strategies.recorded_rewritings, ids
        self._is_persistent = getattr(self._compactor, "persistent", True)
        self._messages = NumberedMessages(head[1:])
        self._reader = Reader(self._messages, lambda: ids.take([""], self._now.state.turns)[0])
        self._sizes = [counter.message(message) for message in head[1:]]
        """The tokens of every message as it is shown now."""
        self._aged = self._unpictured = 0
        """The turns before these are masked whole, and have all their pictures left out."""
        self._history: list[Piece] = [range(len(self._messages))]
        """What came back last, and the messages since."""
        self._making: Generator[View, Message | None, View] | None = None
        """Makes the next prompt to play, and waits for the replies to questions."""
        self._reply: Message | None = None
        """The reply to the latest question, until the compactor has it."""
        self._places: Sequence[Place] = ()
        """What the latest view shows, after its head."""
        self._played: tuple[WindowState, View] | None = None
        """The latest prompt to play."""
        self._events: list[Event] = []

    def append(self, turn: Turn) -> None:
        """Add a complete turn."""
        before, state = self._now.state, self._after(turn)
        self._now = Contents(state, _selection(state, ()), None)
        first, whole = len(self._sizes), self._index.whole
        results = [self._counter.message(item.message) for item in turn.items]
        self._sizes += (whole[-1] - whole[-2] - sum(results), *results)
        self._messages.append(turn)
        if (state.oldest, state.pictures) != (before.oldest, before.pictures):
            self._age(state)
        last = self._history[-1]
        if isinstance(last, range) and last.stop == first:
            self._history[-1] = range(last.start, len(self._sizes))
        else:
            self._history.append(range(first, len(self._sizes)))

    def _age(self, state: WindowState) -> None:
        """Count again what is masked from now on, or loses its picture."""
        self._messages.oldest, self._messages.pictures = state.oldest, state.pictures
        changed = {*range(self._aged, state.boundary + 1), *range(self._unpictured, state.pictured + 1)}
        for index in changed.intersection(range(state.turns)):
            for number in self._messages.numbers(index):
                self._sizes[number] = self._counter.message(self._messages.shown(number))
        self._aged, self._unpictured = state.boundary, state.pictured

    def view(self) -> View:
        """Return the next question of the compactor, or the next prompt to play.

        `PromptOverflowError` if system message, tools and the newest turn do not fit; `StrategyError` if the compactor
        fails, with its exception as the cause, or returns what cannot be sent.
        """
        making = self._making = self._making or self._make()
        reply, self._reply = self._reply, None
        try:
            return making.send(reply)
        except StopIteration as end:
            self._making = None
            view: View = end.value
            return view

    def answer(self, reply_text: str) -> None:
        """Take the text of the reply to the latest question."""
        self._reply = {"role": "assistant", "content": reply_text}

    def close(self) -> None:
        """End the compactor, which may wait for a reply that never comes."""
        if self._making is not None:
            self._making.close()

    def taken_events(self) -> list[Event]:
        """Return what has happened since this was last called, for the record."""
        events, self._events = self._events, []
        return events

    def canonical(self, view: View) -> list[bytes]:
        """Return the canonical JSON of the latest view's messages, of which the prompt's sha256 is made."""
        head = [] if view.asks_for_summary else self._now.state.head.canonical
        return [*head, *map(self._messages.line, self._places)]

    def _make(self) -> Generator[View, Message | None, View]:
        cap, head = self.budget.prompt_tokens, self._now.state.head.tokens
        if cap is not None and head > cap:
            raise PromptOverflowError(f"System message and tools take {head} tokens.")
        running = None
        if not isinstance(self._compactor, AsRecorded):
            given = list(self._history) if self._is_persistent else [range(len(self._messages))]
            running = Running(self._compactor, given, self._reader, self._room)
        try:
            pieces = yield from self._ask(running)
        finally:
            if running is not None:
                running.close()
        return self._to_play(pieces)

    def _room(self, running: Running) -> Room:
        cap, last = self.budget.prompt_tokens, self._played
        return Room(
            None if cap is None else cap - self._now.state.head.tokens,
            self._question_cap,
            None if last is None else last[1].tokens,
            lambda messages: self._reader.count(messages, running.places, self._tokens),
        )

    @property
    def _question_cap(self) -> int | None:
        return self.budget.prompt_tokens if self.budget.question_tokens is None else self.budget.question_tokens

    def _ask(self, running: Running | None) -> Generator[View, Message | None, list[Piece]]:
        """Yield the questions of the compactor that are sent; return what comes back."""
        answer: Message | ContextOverflowError | None = None
        for asked in range(MOST_QUESTIONS + 1):
            made = self._next(running, answer)
            if not made.is_question:
                return made.pieces
            if asked == MOST_QUESTIONS:
                break
            question, cap = self._question(made.pieces), self._question_cap
            if cap is None or question.tokens <= cap:
                answer = yield question
                continue
            answer = ContextOverflowError(f"The question has {question.tokens} tokens, and its cap is {cap}.")
            turn, facts = self._now.state.turns, question.facts
            self._events.append({"event": "question", "turn": turn, "tokens": question.tokens, "reply": None, **facts})
        raise StrategyError(f"It asks more than {MOST_QUESTIONS} questions for one prompt.")

    def _next(self, running: Running | None, answer: Message | ContextOverflowError | None) -> Made:
        """Return what the compactor does next; what is on record counts, as far as the record goes."""
        made = None if running is None else running.go_on(answer)
        if not self._recorded:
            if made is None:
                raise StrategyError("The record has no more rewritings.")
            return made
        is_question, messages = self._recorded.popleft()
        was = Made(is_question, list(self._history) if messages is None else from_record(messages))
        if made is not None and (made.is_question or is_question) and made != was:
            turn = self._now.state.turns
            raise TranscriptError(f"Before turn {turn} the compactor does not ask the question that is on record.")
        self._ids.reserve(call["id"] for own in was.pieces if isinstance(own, Own) for call in calls_of(own.message))
        return was

    def _question(self, pieces: list[Piece]) -> View:
        state, places = self._now.state, flat(pieces)
        messages = tuple(map(self._messages.shown, places))
        has_calls = any(calls_of(message) for message in messages)
        tokens = PRIMING + sum(map(self._tokens, places)) + (self._tools_tokens if has_calls else 0)
        self._places = places
        return View(
            tools=self._tools if has_calls else (),
            tokens=tokens,
            shown_steps=0,
            dropped_turns=0,
            prefix_tokens=0,
            selection=_selection(state, ()),
            shown=messages,
            turns=self._index.turns,
            purpose="compaction",
            facts={"messages": on_record(pieces)},
        )

    def _to_play(self, pieces: list[Piece]) -> View:
        """Return the prompt that shows what came back, as far as it fits, and note both for the record."""
        state, cap, head = self._now.state, self.budget.prompt_tokens, self._now.state.head.tokens
        messages = None if pieces == self._history else on_record(pieces)
        self._history = pieces
        lead = list(takewhile(lambda place: self._messages.role(place) != "assistant", _forward(pieces)))
        total = head + self._front(lead) + sum(map(self._piece_tokens, pieces))
        is_over = cap is not None and total > cap
        event: Event = {"event": "rewrite", "turn": state.turns, "messages": messages, "tokens": total, "over": is_over}
        length, lost, turns = sum(map(_length, pieces)), 0, list[Place]()
        if cap is None or not is_over:
            turns = [*_forward(pieces)][len(lead) :]
        elif (fitting := self._fitting(pieces, lead, cap - head)) is not None:
            lost, turns = fitting
        else:
            self._events.append({**event, "shown": None, "task": False, "blind": False})
            raise PromptOverflowError("The newest turn does not fit beside system message and tools.")
        shown = ranges_of([*range(lost, len(lead)), *range(length - len(turns), length)])
        places, has_task = [*lead[lost:], *turns], bool(self._front(lead[lost:]))
        self._places = with_task(places, self._messages.role) if has_task else places
        view, is_blind = self._seen()
        self._events.append({**event, "shown": shown, "task": has_task, "blind": is_blind})
        return view

    def _fitting(self, pieces: Sequence[Piece], lead: Sequence[Place], room: int) -> tuple[int, list[Place]] | None:
        """Return how many of the messages before the first reply leave, and the messages of the turns that stay.

        The oldest turns leave first, but for the newest; then what stands before the first reply. None if even that
        does not fit.
        """
        turns, turn, tokens, own = list[Place](), list[Place](), 0, 0
        before = self._front(lead) + sum(map(self._tokens, lead))
        for place in _backward(pieces):
            turn.append(place)
            own += self._tokens(place)
            if turns and before + tokens + own > room:
                break
            if self._messages.role(place) == "assistant":
                turns, turn, tokens, own = turns + turn, [], tokens + own, 0
        for lost in range(len(lead) + bool(turns)):
            if self._front(lead[lost:]) + sum(map(self._tokens, lead[lost:])) + tokens <= room:
                return lost, turns[::-1]
        return None

    def _front(self, lead: Sequence[Place]) -> int:
        """The tokens of the task, where it stands in front of these messages and the turns; 0 where it does not."""
        first = next((role for role in map(self._messages.role, lead) if role not in SYSTEM), None)
        return 0 if first == "user" else self._sizes[0]

    def _tokens(self, place: Place) -> int:
        return self._counter.message(self._messages.shown(place)) if isinstance(place, Own) else self._sizes[place]

    def _piece_tokens(self, piece: Piece) -> int:
        return self._tokens(piece) if isinstance(piece, Own) else sum(self._sizes[piece.start : piece.stop])

    def _seen(self) -> tuple[View, bool]:
        """The prompt that shows the places, and whether it neither shows nor tells the newest observation."""
        state, shown = self._now.state, list(map(self._messages.shown, self._places))
        sizes = list(map(self._tokens, self._places))
        prefix = 0
        if self._played is not None:
            was, before = self._played
            prefix, is_same = common_head(was.head, state.head, self._tools_tokens, self._counter)
            if is_same:
                pairs = zip(sizes, shown, before.shown[len(state.head.messages) :], strict=False)
                prefix += sum(tokens for tokens, _, _ in takewhile(lambda each: each[1] == each[2], pairs))
        visible: set[int] = set()
        turns: set[int] = set()
        for place, message in zip(self._places, shown, strict=True):
            if isinstance(place, Own) or (turn := self._messages.turn_of(place)) is None:
                continue
            turns.add(turn)
            item = self._messages.item(place)
            if item is not None and item.observation_step is not None and not item.is_masked(message):
                visible.add(item.observation_step)
        view = View(
            tools=self._tools,
            tokens=state.head.tokens + sum(sizes),
            shown_steps=len(visible),
            dropped_turns=state.turns - len(turns),
            prefix_tokens=prefix,
            selection=_selection(state, turns),
            shown=(*state.head.messages, *shown),
            turns=self._index.turns,
            visible=visible,
        )
        self._played = state, view
        return view, state.step not in visible and not self._is_told(shown)

    def _is_told(self, shown: Sequence[Message]) -> bool:
        """Whether the words or the picture of the newest observation stand in a message; True without one."""
        state = self._now.state
        if state.newest is None:
            return True
        [*_, newest] = [item for item in state.index.turns[state.newest].items if item.observation_step == state.step]
        words, pictures = newest.observation_words, [part["sha256"] for part in pictures_of(newest.message)]
        return any(
            (words and words in text_of(message)) or any(part["sha256"] in pictures for part in pictures_of(message))
            for message in shown
        )


def _length(piece: Piece) -> int:
    return 1 if isinstance(piece, Own) else len(piece)


def _forward(pieces: Iterable[Piece]) -> Iterator[Place]:
    for piece in pieces:
        yield from (piece,) if isinstance(piece, Own) else piece


def _backward(pieces: Sequence[Piece]) -> Iterator[Place]:
    for piece in reversed(pieces):
        yield from (piece,) if isinstance(piece, Own) else reversed(piece)


def _selection(state: WindowState, turns: Iterable[int]) -> Selection:
    """Return the selection that names turns of which a prompt shows messages."""
    chosen = Selection(tuple(sorted(turns)), state.last + 1, state.last, state.oldest, is_chosen=True)
    chosen.pictures = state.pictures
    return chosen
