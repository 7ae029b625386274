"""The window of a compactor: it shows what the compactor makes of the conversation, within the cap.

The compactor is asked once for each prompt to play. What it returns takes the place of the history, and is shown with
its oldest turns left out until it fits: whatever it does, no prompt is over its cap, and no result that is too old
shows an observation. A question that it asks is a separate prompt. While nothing is rewritten, the time for a prompt
grows with what it shows, and hardly with the conversation.
"""

from __future__ import annotations

import inspect
from bisect import bisect_left
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from itertools import accumulate, takewhile
from typing import TYPE_CHECKING, Any, TypeAlias

from smartplay_tools.context.base import Window
from smartplay_tools.context.compaction import AsRecorded, Compactor, GivenHistory, Room
from smartplay_tools.context.rewriting import (
    SYSTEM,
    Own,
    Piece,
    Reader,
    RewrittenHistory,
    flat,
    from_record,
    given_form,
    joined,
    length_of,
    on_record,
)
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.tokens import PRIMING, TokenCounter
from smartplay_tools.context.turns import Form, Turn
from smartplay_tools.context.view import Head, Selection, View
from smartplay_tools.context.window_state import WindowState
from smartplay_tools.errors import ContextOverflowError, PromptOverflowError, StrategyError, TranscriptError
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import ResolvedBudget, ToolSpec
from smartplay_tools.types.messages import Message, calls_of, copy_of, pictures_of, text_of

if TYPE_CHECKING:
    from smartplay_tools.types.call_ids import CallIds

Answered: TypeAlias = "Generator[list[Piece], Message | ContextOverflowError | None, list[Piece]]"
"""A compactor that makes a prompt: it yields the messages of questions, and returns those that come back."""

MOST_QUESTIONS = 16
"""The most questions for a prompt, refused ones included."""


class CompactingWindow(Window):
    """A window whose history a compactor rewrites."""

    def __init__(
        self,
        head: Sequence[Message],
        tools: Sequence[ToolSpec],
        budget: ResolvedBudget,
        counter: TokenCounter,
        strategies: Strategies,
        ids: CallIds,
        record: Callable[[Event], None],
    ) -> None:
        """`ids` are those of the conversation, of which calls get one whose id the compactor has made up.

        `record` is called with what the compactor has done.
        """
        super().__init__(head[:1], tools, budget, counter, strategies)
        assert isinstance(strategies.custom, Compactor)
        self._compactor, self._recorded, self._ids = strategies.custom, strategies.recorded_rewritings, ids
        self._is_persistent = getattr(self._compactor, "persistent", True)
        self._history = RewrittenHistory(head[1:])
        self._reader = Reader(self._history, lambda: ids.take([""], self._state.turns)[0])
        self._sums = [0]
        """The tokens of the messages before each number, as they are shown now."""
        self._count(0)
        self._making: Generator[View, Message | None, View] | None = None
        """Makes the next prompt to play, and waits for the replies to questions."""
        self._reply: Message | None = None
        """The reply to the latest question, until the compactor has it."""
        self._played: tuple[Head, Sequence[Form], int] | None = None
        """The latest prompt to play: its head, the messages after it, its tokens."""
        self._record = record

    def _begin(self, state: WindowState) -> None:
        self._state = state

    def append(self, turn: Turn) -> None:
        """Add a complete turn."""
        self._state = self._after(turn, self._state)
        first = len(self._history.now)
        self._history.append(turn)
        self._count(min(first, self._history.age(self._state.oldest, self._state.pictures)))

    def _count(self, first: int) -> None:
        """Count the messages from a number on."""
        sizes = [form.tokens(self._counter) for form in self._history.now[first:]]
        self._sums[first:] = accumulate(sizes, initial=self._sums[first])

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

    def answer(self, reply_text: str) -> Event:
        """Take the reply to the latest question."""
        self._reply = {"role": "assistant", "content": reply_text}
        return {}

    def close(self) -> None:
        """End the compactor, which may wait for a reply that never comes."""
        if self._making is not None:
            self._making.close()

    def _make(self) -> Generator[View, Message | None, View]:
        """Yield the questions of the compactor that are sent; return the prompt to play."""
        cap, head = self.budget.prompt_tokens, self._state.head.tokens
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
                facts = {"turn": self._state.turns, "tokens": question.tokens, "reply": None, **question.facts}
                self._record({"event": "question", **facts})
        finally:
            if running is not None:
                with suppress(Exception):  # nobody is left to hear what it raises while it is closed
                    running.close()
        raise StrategyError(f"It asks more than {MOST_QUESTIONS} questions for one prompt.")

    def _run(self) -> Answered:
        """Call the compactor: yield the messages of its questions, take the answers, return what comes back."""
        history, reader, cap, last = self._history, self._reader, self.budget.prompt_tokens, self._played
        given: list[Piece] = list(history.pieces) if self._is_persistent else [range(len(history.now))]

        def copies() -> list[Message]:
            return [copy_of(given_form(form.message)) for form in history.forms(given)]

        messages = GivenHistory(length=sum(map(length_of, given)), copies=copies)
        room = Room(
            None if cap is None else cap - self._state.head.tokens,
            cap if self.budget.question_tokens is None else self.budget.question_tokens,
            None if last is None else last[2],
            lambda messages: self._tokens(history.forms(joined(reader.read(messages, flat(given))))),
        )

        def pieces(made: Any) -> list[Piece]:
            return given if made is messages and messages.is_untouched else reader.pieces(made, flat(given))

        made = self._compactor.compact(messages, room)
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
        was = is_question, self._history.pieces if messages is None else from_record(messages)
        if made is not None and (made[0] or is_question) and made != was:
            turn = self._state.turns
            raise TranscriptError(f"Before turn {turn} the compactor does not ask the question that is on record.")
        self._ids.reserve(call["id"] for own in was[1] if isinstance(own, Own) for call in calls_of(own.message))
        return was

    def _question(self, pieces: list[Piece]) -> View:
        forms = self._history.forms(pieces)
        tools = self._tools if any(calls_of(form.message) for form in forms) else ()
        return View(
            tools=tools,
            tokens=PRIMING + self._tokens(forms) + (self._tools_tokens if tools else 0),
            shown_steps=0,
            dropped_turns=0,
            prefix_tokens=0,
            selection=self._selection([]),
            forms=forms,
            turns=self._index.turns,
            purpose="compaction",
            facts={"messages": on_record(pieces)},
        )

    def _to_play(self, pieces: list[Piece]) -> View:
        """Return the prompt that shows what came back, as far as it fits, and record both."""
        history, cap, head = self._history, self.budget.prompt_tokens, self._state.head.tokens
        messages = None if pieces == history.pieces else on_record(pieces)
        lead = list(takewhile(lambda form: form.message["role"] != "assistant", history.walk(pieces)))
        length, total = sum(map(length_of, pieces)), head + self._task(lead) + sum(map(self._size, pieces))
        is_over = cap is not None and total > cap
        fitting: tuple[int, int, int] | None = (0, length - len(lead), total - head)
        if cap is not None and is_over:
            fitting = self._fitting(pieces, lead, cap - head)
        event: Event = {"event": "rewrite", "turn": self._state.turns, "messages": messages, "tokens": total}
        event |= {"over": is_over, "shown": None, "task": False, "blind": False}
        if fitting is None:
            history.take(event)
            self._record(event)
            raise PromptOverflowError("The newest turn does not fit beside system message and tools.")
        lost, kept, tokens = fitting
        rows = [range(lost, len(lead)), range(length - kept, length)]
        if rows[0].stop == rows[1].start:
            rows = [range(lost, length)]
        event["shown"] = [[row.start, row.stop - 1] for row in rows if row]
        event["task"] = bool(self._task(lead[lost:]))
        history.take(event)
        view = self._shown(head + tokens)
        event["blind"] = not self._is_seen(view.forms[1:])
        self._record(event)
        return view

    def _fitting(self, pieces: Sequence[Piece], lead: Sequence[Form], room: int) -> tuple[int, int, int] | None:
        """Return how many of the messages before the first reply leave, how many of the turns' stay, and the tokens.

        The oldest turns leave first, the newest never; then the messages before the first reply. None if even that
        does not fit.
        """
        before, kept, tokens = self._task(lead) + self._tokens(lead), 0, 0
        for messages, size in self._beginnings(pieces):
            if kept and before + size > room:
                break
            kept, tokens = messages, size
        for lost in range(len(lead) + bool(kept)):
            if (needs := self._task(lead[lost:]) + self._tokens(lead[lost:]) + tokens) <= room:
                return lost, kept, needs
        return None

    def _beginnings(self, pieces: Sequence[Piece]) -> Iterator[tuple[int, int]]:
        """Yield the replies that a prompt can begin with, newest first: the messages from there on, their tokens."""
        passed, tokens, starts = 0, 0, self._history.starts
        for piece in reversed(pieces):
            if isinstance(piece, range):
                first, stop = (bisect_left(starts, number) for number in (piece.start, piece.stop))
                for start in reversed(starts[first:stop]):
                    yield passed + piece.stop - start, tokens + self._size(range(start, piece.stop))
            passed, tokens = passed + length_of(piece), tokens + self._size(piece)
            if isinstance(piece, Own) and piece.message["role"] == "assistant":
                yield passed, tokens

    def _task(self, lead: Sequence[Form]) -> int:
        """The tokens of the task, where it stands between these messages and the turns; 0 where it does not.

        It does where no user's message is among those before the first reply: all others are system messages.
        """
        if any(form.message["role"] not in SYSTEM for form in lead):
            return 0
        return self._history.now[0].tokens(self._counter)

    def _size(self, piece: Piece) -> int:
        """The tokens of messages as they are shown now."""
        if isinstance(piece, Own):
            return self._tokens(self._history.forms([piece]))
        return self._sums[piece.stop] - self._sums[piece.start]

    def _tokens(self, forms: Iterable[Form]) -> int:
        return sum([form.tokens(self._counter) for form in forms])

    def _shown(self, tokens: int) -> View:
        """The prompt that shows what the history shows, which has so many tokens."""
        history, head, played, prefix = self._history, self._state.head, self._played, 0
        forms = history.forms(history.shown)
        if played is not None:
            prefix = self._prefix(played[0], played[1], head, forms, tokens - head.tokens, is_equal=True)
        selection = self._selection([history.turns_of(row) for row in history.shown if isinstance(row, range)])
        self._played = head, forms, tokens
        return View(
            tools=self._tools,
            tokens=tokens,
            shown_steps=len({form.step for form in forms} - {None}),
            dropped_turns=self._state.turns - len(selection),
            prefix_tokens=prefix,
            selection=selection,
            forms=[*head.forms, *forms],
            turns=self._index.turns,
            text_tokens=sum(self._size(piece) for piece in history.shown if isinstance(piece, Own)),
        )

    def _is_seen(self, forms: Sequence[Form]) -> bool:
        """Whether messages show the newest observation, or have its words or its picture; True without one."""
        state = self._state
        if state.newest is None or any(form.step == state.step for form in reversed(forms)):
            return True
        [*_, newest] = [item for item in state.index.turns[state.newest].items if item.observation_step == state.step]
        words, pictures = newest.observation_words, [part["sha256"] for part in pictures_of(newest.message)]
        return any(
            (words and words in text_of(form.message))
            or any(part["sha256"] in pictures for part in pictures_of(form.message))
            for form in forms
        )

    def _selection(self, turns: Sequence[range]) -> Selection:
        """The selection that names turns of which a prompt shows messages."""
        state = self._state
        *others, run = turns if turns and turns[-1].stop == state.turns else [*turns, range(state.turns, state.turns)]
        pinned = {turn for each in others for turn in each if turn not in run}
        chosen = Selection(tuple(sorted(pinned)), run.start, state.last, state.oldest, first_whole=state.first_whole)
        chosen.pictures = state.pictures
        return chosen
