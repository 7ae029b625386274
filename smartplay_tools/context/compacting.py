"""The window of a compactor: it shows what the compactor makes of the conversation, within the cap.

The compactor is asked once for each prompt to play. What it returns takes the place of the history, and is shown with
its oldest turns left out until it fits: whatever it does, no prompt is over its cap, and no result that is too old
shows an observation. A question that it asks is a prompt of its own. While nothing is rewritten, the time for a prompt
grows with what it shows, and hardly with the conversation.
"""

from __future__ import annotations

import inspect
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from itertools import takewhile
from typing import TYPE_CHECKING, Any, TypeAlias

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

if TYPE_CHECKING:
    from smartplay_tools.conversation.ids import CallIds

Answered: TypeAlias = "Generator[list[Piece], Message | ContextOverflowError | None, list[Piece]]"
"""A compactor that makes a prompt: it yields the messages of questions, and returns those that come back."""

MOST_QUESTIONS = 16
"""The most questions for a prompt, refused ones included."""


class CompactingWindow(ContextWindow):
    """A window whose history a compactor rewrites."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies,
        ids: CallIds,
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
        """Yield the questions of the compactor that are sent; return the prompt to play."""
        cap, head = self.budget.prompt_tokens, self._now.state.head.tokens
        if cap is not None and head > cap:
            raise PromptOverflowError(f"System message and tools take {head} tokens.")
        running = None if isinstance(self._compactor, AsRecorded) else self._run()
        most = cap if self.budget.question_tokens is None else self.budget.question_tokens
        answer: Message | ContextOverflowError | None = None
        try:
            for asked in range(MOST_QUESTIONS + 1):
                is_question, pieces = self._next(running, answer)
                if not is_question:
                    return self._to_play(pieces)
                if asked == MOST_QUESTIONS:
                    break
                question = self._question(pieces)
                if most is None or question.tokens <= most:
                    answer = yield question
                    continue
                answer = ContextOverflowError(f"The question has {question.tokens} tokens, and its cap is {most}.")
                facts = {"turn": self._now.state.turns, "tokens": question.tokens, "reply": None, **question.facts}
                self._events.append({"event": "question", **facts})
        finally:
            if running is not None:
                with suppress(Exception):  # nobody is left to hear what it raises while it is closed
                    running.close()
        raise StrategyError(f"It asks more than {MOST_QUESTIONS} questions for one prompt.")

    def _run(self) -> Answered:
        """Call the compactor: yield the messages of its questions, take the answers, return what comes back."""
        given = list(self._history) if self._is_persistent else [range(len(self._messages))]
        shown, reader, cap, last = self._messages.shown, self._reader, self.budget.prompt_tokens, self._played
        history = GivenHistory(
            length=sum(map(_length, given)), copies=lambda: [copy_of(given_form(shown(place))) for place in flat(given)]
        )
        room = Room(
            None if cap is None else cap - self._now.state.head.tokens,
            cap if self.budget.question_tokens is None else self.budget.question_tokens,
            None if last is None else last[1].tokens,
            lambda messages: reader.count(messages, flat(given), self._tokens),
        )

        def pieces(made: Any) -> list[Piece]:
            return given if made is history and history.is_untouched else reader.pieces(made, flat(given))

        made = self._compactor.compact(history, room)
        if not inspect.isgenerator(made):
            return pieces(made)
        with closing(made):
            answer: Message | ContextOverflowError | None = None
            while True:
                try:
                    is_refused = isinstance(answer, ContextOverflowError)
                    asked = made.throw(answer) if is_refused else made.send(answer)
                except StopIteration as end:
                    return pieces(end.value)
                answer = yield pieces(asked)

    def _next(
        self, running: Answered | None, answer: Message | ContextOverflowError | None
    ) -> tuple[bool, list[Piece]]:
        """Return whether the compactor asks next, and the messages; what is on record counts, as far as it goes."""
        try:
            made = None if running is None else (True, running.send(answer))
        except StopIteration as end:
            made = False, end.value
        except StrategyError:
            raise
        except Exception as error:  # whatever the compactor does
            raise StrategyError("The compactor has failed.") from error
        if not self._recorded:
            if made is None:
                raise StrategyError("The record has no more rewritings.")
            return made
        is_question, messages = self._recorded.popleft()
        was = is_question, self._history if messages is None else from_record(messages)
        if made is not None and (made[0] or is_question) and made != was:
            turn = self._now.state.turns
            raise TranscriptError(f"Before turn {turn} the compactor does not ask the question that is on record.")
        self._ids.reserve(call["id"] for own in was[1] if isinstance(own, Own) for call in calls_of(own.message))
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
        self._history = list(pieces)
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
            text_tokens=sum(size for size, place in zip(sizes, self._places, strict=True) if isinstance(place, Own)),
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
