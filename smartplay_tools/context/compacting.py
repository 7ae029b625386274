"""The rule of a compactor: a prompt shows what it makes of the conversation, as far as that fits the cap.

The compactor is asked once for each prompt to play. What it returns takes the place of the history, and is shown with
its oldest turns left out until it fits: whatever it does, no prompt is over its cap, and no result that is too old
shows an observation. A question that it asks is a separate prompt. While nothing is rewritten, the time for a prompt
grows with what it shows, and hardly with the conversation.
"""

from __future__ import annotations

import inspect
from bisect import bisect_left
from collections import deque
from collections.abc import Awaitable, Callable, Generator, Iterable, Sequence
from contextlib import closing, suppress
from functools import partial
from itertools import takewhile
from typing import Any, TypeAlias

from smartplay_tools.context.compaction import Compactor, GivenHistory, Room, asked
from smartplay_tools.context.rewriting import (
    SYSTEM,
    Rewriting,
    check_list,
    flat,
    from_record,
    joined,
    length_of,
    on_record,
)
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Piece, Selection, View
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.errors import ContextOverflowError, PromptOverflowError, StrategyError, TranscriptError
from smartplay_tools.transcript.events import Event
from smartplay_tools.types.call_ids import CallIds
from smartplay_tools.types.messages import Message, calls_of, pictures_of, text_of

Answered: TypeAlias = "Generator[list[Piece], Message | ContextOverflowError | None, list[Piece]]"
"""A compactor that makes a prompt: it yields the messages of questions, and returns those that come back."""

Recorded: TypeAlias = "deque[tuple[bool, list[Any] | None]]"
"""What a compactor did next, as far as it is not played yet: whether it asked a question, and the messages."""

MOST_QUESTIONS = 16
"""The most questions for a prompt, refused ones included, of a conversation that has no more messages than this."""


def _awaited(made: Awaitable[Any], ask: object) -> Awaitable[Any]:
    """Return what an asynchronous method, which cannot ask, has begun."""
    return made


class Compacting:
    """The rule of a window whose history a compactor rewrites."""

    def __init__(
        self,
        window: ContextWindow,
        compactor: Compactor | None,
        *,
        ids: CallIds | None = None,
        recorded: Recorded | None = None,
        record: Callable[[Event], object] = dict,
    ) -> None:
        """`compactor` is None where all that it did is `recorded`.

        `ids` are those of the conversation, of which calls get one whose id the compactor has made up. `record` is
        called with what the compactor has done.
        """
        self._window, self._compactor, self._recorded = window, compactor, deque() if recorded is None else recorded
        self._ids, self._record = ids or CallIds(), record
        self._is_persistent = getattr(compactor, "persistent", True)
        self._history = Rewriting(
            window,
            lambda: self._ids.take([""], len(window.turns))[0],
            reads_thoughts=getattr(compactor, "reads_thoughts", False),
        )
        self._played: int | None = None
        """The tokens of the latest prompt to play."""

    def make(self) -> Generator[View, Message | None, Selection]:
        """Yield the questions of the compactor that are sent; return what the prompt to play shows.

        `PromptOverflowError` if system message, tools and the newest turn do not fit; `StrategyError` if the compactor
        fails, with its exception as the cause, or returns what cannot be sent.
        """
        cap, head = self._window.budget.prompt_tokens, self._window.head_tokens
        if cap is not None and head > cap:
            raise PromptOverflowError(f"System message and tools take {head} tokens.")
        running = None if self._compactor is None else self._run(self._compactor)
        most = self._most_for_questions
        answer: Message | ContextOverflowError | None = None
        try:
            most_asked = max(MOST_QUESTIONS, len(self._window.now))
            for number in range(most_asked + 1):
                is_question, pieces = self._next(running, answer)
                if not is_question:
                    return self._to_play(pieces)
                if number == most_asked:
                    break
                facts: Event = {"messages": on_record(pieces)}
                question = self._window.question(self._history.selection(pieces), facts)
                if most is None or question.tokens <= most:
                    answer = yield question
                    continue
                answer = ContextOverflowError(f"The question has {question.tokens} tokens, and its cap is {most}.")
                facts = {"turn": len(self._window.turns), "tokens": question.tokens, "reply": None, **facts}
                self._record({"event": "question", **facts})
        finally:
            if running is not None:
                with suppress(Exception):  # nobody is left to hear what it raises while it is closed
                    running.close()
        raise StrategyError(f"It asks more than {most_asked} questions for one prompt.")

    @property
    def _most_for_questions(self) -> int | None:
        budget = self._window.budget
        return budget.prompt_tokens if budget.question_tokens is None else budget.question_tokens

    def _run(self, compactor: Compactor) -> Answered:
        """Call the compactor: yield the messages of its questions, take the answers, return what comes back."""
        window, history, cap = self._window, self._history, self._window.budget.prompt_tokens
        given: list[Piece] = list(history.pieces) if self._is_persistent else [range(len(window.now))]

        messages = GivenHistory(length=sum(map(length_of, given)), copies=lambda: history.given(given))
        room = Room(
            None if cap is None else cap - window.head_tokens,
            self._most_for_questions,
            self._played,
            lambda messages: self._tokens(history.walk(joined(history.read(messages, flat(given))))),
            window.head_tokens,
        )

        def pieces(made: Any, *, is_question: bool = False) -> list[Piece]:
            if made is messages and messages.is_untouched:
                return given
            check_list(made, is_question=is_question)
            return history.pieces_of(made, flat(given), is_question=is_question)

        made = compactor.compact(messages, room)
        if inspect.isawaitable(made):
            made = asked(partial(_awaited, made))
        if not inspect.isgenerator(made):
            return pieces(made)
        questions: Generator[Any, Any, Any] = made
        with closing(questions):
            answer: Message | ContextOverflowError | None = None
            while True:
                try:
                    if isinstance(answer, ContextOverflowError):
                        question = questions.throw(answer)
                    else:
                        question = questions.send(answer)
                except StopIteration as end:
                    return pieces(end.value)
                answer = yield pieces(question, is_question=True)

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
        asks_now = made is not None and made[0]
        if (
            made is not None
            and (asks_now or is_question)
            and (asks_now, *on_record(made[1]))
            != (
                is_question,
                *on_record(was[1]),
            )
        ):
            turn = len(self._window.turns)
            raise TranscriptError(f"Before turn {turn} the compactor does not ask the question that is on record.")
        own = (piece.message for piece in was[1] if isinstance(piece, Form))
        self._ids.reserve(call["id"] for message in own for call in calls_of(message))
        return was

    def _to_play(self, pieces: list[Piece]) -> Selection:
        """Return what came back, as far as it fits, and record both."""
        window, history, head = self._window, self._history, self._window.head_tokens
        cap = window.budget.prompt_tokens
        messages: list[Any] | None = None
        if pieces != history.pieces and (messages := on_record(pieces)) == on_record(history.pieces):
            messages = None
        lead = list(takewhile(lambda form: form.message["role"] != "assistant", history.walk(pieces)))
        length, total = sum(map(length_of, pieces)), head + self._task(lead) + sum(map(self._size, pieces))
        is_over = cap is not None and total > cap
        fitting: tuple[int, int, int] | None = (0, length - len(lead), total - head)
        if cap is not None and is_over:
            fitting = self._fitting(pieces, lead, cap - head)
        event: Event = {"event": "rewrite", "turn": len(window.turns), "messages": messages, "tokens": total}
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
        chosen = history.selection()
        self._played = head + tokens
        event["blind"] = not self._is_seen(window.forms(chosen))
        self._record(event)
        return chosen

    def _fitting(self, pieces: Sequence[Piece], lead: Sequence[Form], room: int) -> tuple[int, int, int] | None:
        """Return how many of the messages before the first reply leave, how many of the turns' stay, and the tokens.

        The oldest turns leave first, the newest never; then the messages before the first reply. None if even that
        does not fit.
        """
        kept, tokens = self._longest(pieces, room - self._task(lead) - self._tokens(lead))
        for lost in range(len(lead) + bool(kept)):
            if (needs := self._task(lead[lost:]) + self._tokens(lead[lost:]) + tokens) <= room:
                return lost, kept, needs
        return None

    def _longest(self, pieces: Sequence[Piece], room: int) -> tuple[int, int]:
        """Return how many messages the longest end has that a reply begins and that fits, and its tokens.

        If none fits, it is the shortest.
        """
        kept = size = passed = tokens = 0
        starts = self._window.starts

        for piece in reversed(pieces):
            if isinstance(piece, range):
                first, stop = (bisect_left(starts, number) for number in (piece.start, piece.stop))
                fits = partial(self._fits, stop=piece.stop, room=room - tokens)
                begin = bisect_left(starts, x=True, lo=first, hi=stop, key=fits)
                if first < stop and (begin < stop or not kept):
                    end = range(starts[min(begin, stop - 1)], piece.stop)
                    kept, size = passed + len(end), tokens + self._window.tokens(end)
                if begin > first:
                    break
            passed, tokens = passed + length_of(piece), tokens + self._size(piece)
            if isinstance(piece, Form) and piece.message["role"] == "assistant":
                if kept and tokens > room:
                    break
                kept, size = passed, tokens
        return kept, size

    def _fits(self, start: int, *, stop: int, room: int) -> bool:
        return self._window.tokens(range(start, stop)) <= room

    def _task(self, lead: Sequence[Form]) -> int:
        """The tokens of the task, where it stands between these messages and the turns; 0 where it does not.

        It does where no user's message is among those before the first reply: all others are system messages.
        """
        if any(form.message["role"] not in SYSTEM for form in lead):
            return 0
        return self._window.now[0].tokens(self._window.counter)

    def _size(self, piece: Piece) -> int:
        """The tokens of messages as they are shown now."""
        return self._tokens(self._history.walk([piece])) if isinstance(piece, Form) else self._window.tokens(piece)

    def _tokens(self, forms: Iterable[Form]) -> int:
        return sum([form.tokens(self._window.counter) for form in forms])

    def _is_seen(self, forms: Sequence[Form]) -> bool:
        """Whether messages show the newest observation, or have its words or its picture; True without one."""
        window = self._window
        if window.newest is None or any(form.step == window.turns[-1].step for form in reversed(forms)):
            return True
        shown = window.turns[window.newest]
        [*_, newest] = [item for item in shown.items if item.observation_step == shown.step]
        words, pictures = newest.observation_words, [part["sha256"] for part in pictures_of(newest.message)]
        return any(
            (words and words in text_of(form.message))
            or any(part["sha256"] in pictures for part in pictures_of(form.message))
            for form in forms
        )
