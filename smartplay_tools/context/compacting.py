"""The window of a compactor: it shows what the compactor makes of the conversation, within the cap.

The compactor is asked once for each prompt to play. What it returns takes the place of the history, and is shown with
its oldest turns left out until it fits: whatever it does, no prompt is over its cap, and no result that is too old
shows an observation. A question that it asks is a separate prompt. While nothing is rewritten, the time for a prompt
grows with what it shows, and hardly with the conversation.
"""

from __future__ import annotations

import inspect
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from itertools import chain, islice, takewhile
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
)
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.strategies.custom import AsRecorded
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import Selection, View
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
        self._history: list[Piece] = [range(len(self._sizes))]
        """What came back last, and the messages since."""
        self._total: int | None = None
        """The tokens of the history, where they are known."""
        self._making: Generator[View, Message | None, View] | None = None
        """Makes the next prompt to play, and waits for the replies to questions."""
        self._reply: Message | None = None
        """The reply to the latest question, until the compactor has it."""
        self._shown: Sequence[Piece] = ()
        """What the latest view shows, after its head."""
        self._played: tuple[WindowState, View] | None = None
        """The latest prompt to play."""
        self._events: list[Event] = []

    def append(self, turn: Turn) -> None:
        """Add a complete turn."""
        state, first, whole = self._after(turn), len(self._sizes), self._index.whole
        self._now = Contents(state, self._now.selection, None)
        results = [self._counter.message(item.message) for item in turn.items]
        self._sizes += (whole[-1] - whole[-2] - sum(results), *results)
        self._messages.append(turn)
        self._total = None if self._total is None else self._total + whole[-1] - whole[-2]
        for numbers in self._messages.age(state.oldest, state.pictures):
            self._total = None
            self._sizes[numbers.start : numbers.stop] = map(self._counter.message, self._messages.shown(numbers))
        last = self._history[-1]
        if isinstance(last, range) and last.stop == first:
            self._history[-1] = range(last.start, len(self._sizes))
        else:
            self._history.append(range(first, len(self._sizes)))

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
        return [*head, *chain.from_iterable(map(self._messages.lines, self._shown))]

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
        given: list[Piece] = list(self._history) if self._is_persistent else [range(len(self._sizes))]
        reader, cap, last = self._reader, self.budget.prompt_tokens, self._played
        history = GivenHistory(
            length=sum(map(_length, given)), copies=lambda: [copy_of(given_form(each)) for each in self._all(given)]
        )
        room = Room(
            None if cap is None else cap - self._now.state.head.tokens,
            cap if self.budget.question_tokens is None else self.budget.question_tokens,
            None if last is None else last[1].tokens,
            lambda messages: sum(chain.from_iterable(map(self._tokens, reader.read(messages, flat(given))))),
        )

        def pieces(made: Any) -> list[Piece]:
            return given if made is history and history.is_untouched else reader.pieces(made, flat(given))

        made = self._compactor.compact(history, room)
        if not inspect.isgenerator(made):
            return pieces(made)
        questions: Generator[Any, Any, Any] = made
        with closing(questions):
            answer: Message | ContextOverflowError | None = None
            while True:
                try:
                    if isinstance(answer, ContextOverflowError):
                        asked = questions.throw(answer)
                    else:
                        asked = questions.send(answer)
                except StopIteration as end:
                    return pieces(end.value)
                answer = yield pieces(asked)

    def _next(
        self, running: Answered | None, answer: Message | ContextOverflowError | None
    ) -> tuple[bool, list[Piece]]:
        """Return whether the compactor asks next, and the messages; recorded ones are used as long as there are any."""
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
        state, messages = self._now.state, tuple(self._all(pieces))
        has_calls = any(calls_of(message) for message in messages)
        tokens = PRIMING + sum(self._sizes_of(pieces)) + (self._tools_tokens if has_calls else 0)
        self._shown = pieces
        return View(
            tools=self._tools if has_calls else (),
            tokens=tokens,
            shown_steps=0,
            dropped_turns=0,
            prefix_tokens=0,
            selection=_selection(state, []),
            shown=messages,
            turns=self._index.turns,
            purpose="compaction",
            facts={"messages": on_record(pieces)},
        )

    def _to_play(self, pieces: list[Piece]) -> View:
        """Return the prompt that shows what came back, as far as it fits, and note both for the record."""
        state, cap, head = self._now.state, self.budget.prompt_tokens, self._now.state.head.tokens
        messages = None if pieces == self._history else on_record(pieces)
        if messages is not None or self._total is None:
            self._total = sum(self._sizes_of(pieces))
        self._history = list(pieces)
        lead = list(takewhile(lambda place: self._messages.role(place) != "assistant", _forward(pieces)))
        length, total = sum(map(_length, pieces)), head + self._task(lead) + self._total
        is_over = cap is not None and total > cap
        event: Event = {"event": "rewrite", "turn": state.turns, "messages": messages, "tokens": total, "over": is_over}
        fitting: tuple[int, int] | None = (0, length - len(lead))
        if cap is not None and is_over:
            fitting = self._fitting(pieces, lead, cap - head)
        if fitting is None:
            self._events.append({**event, "shown": None, "task": False, "blind": False})
            raise PromptOverflowError("The newest turn does not fit beside system message and tools.")
        lost, kept = fitting
        places = [range(lost, len(lead)), range(length - kept, length)]
        has_task = bool(self._task(lead[lost:]))
        front: list[Piece] = [range(1)] if has_task else []
        self._shown = [*_part(pieces, places[0]), *front, *_part(pieces, places[1])]
        view, is_blind = self._seen()
        shown = [[each.start, each.stop - 1] for each in places if each]
        if len(shown) > 1 and shown[0][1] + 1 == shown[1][0]:
            shown = [[shown[0][0], shown[1][1]]]
        self._events.append({**event, "shown": shown, "task": has_task, "blind": is_blind})
        return view

    def _fitting(self, pieces: Sequence[Piece], lead: Sequence[Place], room: int) -> tuple[int, int] | None:
        """Return how many of the messages before the first reply leave, and how many of the turns stay.

        The oldest turns leave first, the newest never; then the messages before the first reply. None if even that
        does not fit.
        """
        lead_sizes = [size for place in lead for size in self._tokens(place)]
        before, kept, tokens, turn = self._task(lead) + sum(lead_sizes), 0, 0, 0
        newest_first = chain.from_iterable(map(self._backward, reversed(pieces)))
        for length, (size, message) in enumerate(newest_first, start=1):
            turn += size
            if kept and before + tokens + turn > room:
                break
            if message["role"] == "assistant":
                kept, tokens, turn = length, tokens + turn, 0
        for lost in range(len(lead) + bool(kept)):
            if self._task(lead[lost:]) + sum(lead_sizes[lost:]) + tokens <= room:
                return lost, kept
        return None

    def _backward(self, piece: Piece) -> Iterable[tuple[int, Message]]:
        """Return tokens and message of every message, the newest first."""
        if isinstance(piece, Own):
            return [(self._tokens(piece)[0], piece.message)]
        later = len(self._sizes) - piece.stop
        return islice(zip(reversed(self._sizes), reversed(self._messages.now), strict=True), later, later + len(piece))

    def _task(self, lead: Sequence[Place]) -> int:
        """The tokens of the task, where it stands between these messages and the turns; 0 where it does not.

        It does where no user's message is among those before the first reply: all others are system messages.
        """
        return 0 if any(self._messages.role(place) not in SYSTEM for place in lead) else self._sizes[0]

    def _tokens(self, place: Place | Piece) -> Sequence[int]:
        """The tokens of messages as they are shown now."""
        if isinstance(place, int):
            return self._sizes[place : place + 1]
        if isinstance(place, Own):
            return [self._counter.message(message) for message in self._messages.shown(place)]
        return self._sizes[place.start : place.stop]

    def _sizes_of(self, pieces: Iterable[Piece]) -> Iterable[int]:
        return chain.from_iterable(map(self._tokens, pieces))

    def _all(self, pieces: Iterable[Piece]) -> Iterable[Message]:
        return chain.from_iterable(map(self._messages.shown, pieces))

    def _seen(self) -> tuple[View, bool]:
        """The prompt that shows the pieces, and whether it neither shows nor tells the newest observation."""
        state, shown, sizes = self._now.state, list(self._all(self._shown)), list(self._sizes_of(self._shown))
        prefix = 0
        if self._played is not None:
            was, before = self._played
            prefix, is_same = common_head(was.head, state.head, self._tools_tokens, self._counter)
            if is_same:
                same = takewhile(
                    lambda pair: pair[0] is pair[1] or pair[0] == pair[1], zip(shown, before.shown[1:], strict=False)
                )
                prefix += sum(sizes[: len([*same])])
        rows = [piece for piece in self._shown if isinstance(piece, range)]
        steps: set[Any] = set().union(*[self._messages.steps[row.start : row.stop] for row in rows])
        visible: set[int] = steps - {None}
        turns = [self._messages.turns_of(row) for row in rows]
        selection = _selection(state, turns)
        view = View(
            tools=self._tools,
            tokens=state.head.tokens + sum(sizes),
            shown_steps=len(visible),
            dropped_turns=state.turns - len(selection),
            prefix_tokens=prefix,
            selection=selection,
            shown=(*state.head.messages, *shown),
            turns=self._index.turns,
            text_tokens=sum(self._sizes_of(piece for piece in self._shown if isinstance(piece, Own))),
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


def _part(pieces: Iterable[Piece], places: range) -> Iterator[Piece]:
    """Yield the messages at places of pieces."""
    start = 0
    for piece in pieces:
        first, stop = max(places.start - start, 0), min(places.stop - start, _length(piece))
        if first < stop:
            yield piece if isinstance(piece, Own) else piece[first:stop]
        start += _length(piece)


def _selection(state: WindowState, turns: Sequence[range]) -> Selection:
    """Return the selection that names turns of which a prompt shows messages."""
    *others, run = turns if turns and turns[-1].stop == state.turns else [*turns, range(state.turns, state.turns)]
    pinned = {turn for each in others for turn in each if turn not in run}
    chosen = Selection(tuple(sorted(pinned)), run.start, state.last, state.oldest)
    chosen.pictures = state.pictures
    return chosen
