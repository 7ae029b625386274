"""Summaries: what leaves an agent's prompts is summarised by a model, and the summary stands in its place.

Summaries are a chain along the grid: that of everything before one of its units is made of the summary before, and of
what has left since. Each is kept under a digest of all that it covers, so it is asked for once, whatever process asks,
and a conversation whose beginning was edited gets others. Nothing here asks a model: questions are yielded.
"""

from __future__ import annotations

import inspect
import threading
from bisect import bisect_left
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.tokens.counter import TokenCounter
from smartplay_tools.context.tokens.truncation import cut_end
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.counting import SENTENCES, notice_of_cut
from smartplay_tools.manager.forms import MessageForm
from smartplay_tools.manager.memo import Texts
from smartplay_tools.manager.units import Part, Shown, Unit, as_first_shown, digests_of

Question: TypeAlias = tuple[list[dict[str, Any]], int]
"""The messages of a question, and the most tokens that its answer should have."""

SPARE = 64
"""The fewest tokens of a conversation that a question has room for."""


@dataclass(frozen=True)
class Summaries:
    """The strategy that shows a summary of what has left the prompts.

    Arguments:
        tokens: the cap on a summary.
        question_tokens: the cap on every question for one, `prompt_tokens` if not given; what is longer is asked in
            pieces.
    """

    tokens: int
    question_tokens: int | None = None


@dataclass(frozen=True)
class Covered:
    """What a summary is to cover."""

    seed: bytes
    """A digest of what shapes the prompts beside the units: options, head, tools."""
    units: Sequence[Unit]
    """The units that have left, and those that will."""
    ends: Sequence[int]
    """The units before which the summaries of the chain end."""
    form: MessageForm

    def keys(self) -> list[str]:
        """Return the digest of what each summary covers, as hex."""
        digests = digests_of(self.seed, (unit.digest for unit in self.units))
        return [digests[end - 1].hex() for end in self.ends]


class AskError(Exception):
    """A question was not answered, for a reason."""

    def __init__(self, reason: Exception) -> None:
        super().__init__(f"{type(reason).__name__}: {reason}")
        self.reason = reason


class SummaryChain:
    """Makes summaries, and messages that show them."""

    def __init__(self, summaries: Summaries, cap: int | None, counter: TokenCounter, memo: Texts) -> None:
        """`cap` is that of a prompt."""
        self._tokens, self._counter, self._memo = summaries.tokens, counter, memo
        self._most = summaries.question_tokens or cap
        self._lock = threading.Lock()
        """Held while the memo is used, since not every mapping has a `setdefault` of one step."""
        self._frame = f"{SENTENCES['summary']}\n"
        self.reserve = self._size(self._frame) + summaries.tokens
        """The most tokens of a message with a summary."""
        least = PRIMING + self._size(self._question("x", "")[0][0]["content"]) + summaries.tokens + SPARE
        if self._most is not None and self._most < least:
            raise InvalidArgumentError(
                f"A question for a summary of {summaries.tokens} tokens takes {least}, and its cap is {self._most}; "
                "raise question_tokens, or lower the tokens of the summary."
            )

    def shown(self, text: str, form: MessageForm) -> Shown:
        """Return the message that shows a summary."""
        message = {"role": "user", "content": f"{self._frame}{text}"}
        if form.name == "responses":
            message["type"] = "message"
        return Shown(Part(None, message), message, self._size(message["content"]))

    def text(self, covered: Covered) -> Generator[Question, str, str]:
        """Yield the questions of a summary, be sent the answers, and return it; empty if no answer had a word."""
        keys = covered.keys()
        with self._lock:
            texts = ((at, self._memo.get(keys[at])) for at in reversed(range(len(keys))))
            known, text = next(((at, text) for at, text in texts if text is not None), (-1, ""))
        start = covered.ends[known] if known >= 0 else 0
        for key, end in zip(keys[known + 1 :], covered.ends[known + 1 :], strict=True):
            rest = list(_told(covered.units[start:end], covered.form))
            while rest:
                part, rest = self._part(text, rest)
                answer = yield self._question(text, part)
                text = self._cut(read_answer(answer)) or text
            with self._lock:
                text = self._memo.setdefault(key, text)
            start = end
        return text

    def _part(self, before: str, rest: Sequence[str]) -> tuple[str, list[str]]:
        """Return the text that the next question is about, and the texts that remain."""
        if self._most is None:
            return "\n\n".join(rest), []
        total, number = PRIMING + self._size(self._question(before, "")[0][0]["content"]), 0
        while number < len(rest) and total <= self._most:
            total += self._counter.text(rest[number]) + 1
            number += 1
        while number and not self._fits(before, "\n\n".join(rest[:number])):
            number -= 1
        if number:
            return "\n\n".join(rest[:number]), [*rest[number:]]
        first = rest[0]
        length = bisect_left(range(len(first)), x=True, key=lambda n: not self._fits(before, first[: n + 1]))
        if not length:
            raise InvalidArgumentError("No question for a summary fits question_tokens; raise it.")
        return first[:length], [first[length:], *rest[1:]]

    def _fits(self, before: str, part: str) -> bool:
        return PRIMING + self._size(self._question(before, part)[0][0]["content"]) <= (self._most or 0)

    def _question(self, before: str, part: str) -> Question:
        more = SENTENCES["summary_more"] if before else ""
        earlier = SENTENCES["summary_before"].format(text=before) if before else ""
        text = SENTENCES["summary_request"].format(more=more, before=earlier, part=part, tokens=self._tokens)
        return [{"role": "user", "content": text}], self._tokens

    def _cut(self, answer: str) -> str:
        """Return an answer as it can be shown: whole, cut at its end with a notice, or nothing."""
        if not answer.strip():
            return ""
        is_short = self._beside_frame(answer) <= self._tokens
        return answer if is_short else cut_end(answer, self._tokens, self._beside_frame, notice_of_cut)

    def _beside_frame(self, text: str) -> int:
        """The tokens that a text adds to its frame."""
        return self._counter.text(f"{self._frame}{text}") - self._counter.text(self._frame)

    def _size(self, content: str) -> int:
        """The tokens of a user's message."""
        return self._counter.message({"role": "user", "content": content})


def read_answer(answer: object) -> str:
    """Return the text of an answer."""
    if isinstance(answer, str):
        return answer
    if inspect.iscoroutine(answer):
        answer.close()
        raise InvalidArgumentError("This `ask` is asynchronous; make prompts with `await manager.afit(...)`.")
    raise InvalidArgumentError(f"`ask` returns the text of an answer, not {type(answer).__name__}.")


def _told(units: Sequence[Unit], form: MessageForm) -> Iterator[str]:
    """Yield the words, calls and results of units as text, results as they were first shown; thoughts are left out."""
    for part in (part for unit in units for part in unit.parts):
        for said in form.said(as_first_shown(part, form)):
            content = said.content
            words = [content.text, *(f"[{each.get('type')}]" for each in (*content.pictures, *content.closed))]
            if text := " ".join(filter(None, words)):
                yield SENTENCES["said"].format(role=said.role, text=text)
            for name, arguments in said.calls:
                yield SENTENCES["called"].format(role=said.role, name=name, arguments=arguments)
