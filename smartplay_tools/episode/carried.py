"""Carried stores: what a trial of a run takes over from the trial before it in its chain.

With `Rules.carry` the trials of a cell form chains. What a trial leaves follows from its record, however it ended: its
last result, and the store that `carry` names, such as the newest notes that were accepted. The head of the next trial
ends with a message that shows both, so every prompt of that trial has them. The last result is shown because no prompt
followed it in its own trial: in MESSENGER it has the only reward.

The start event holds what was carried and the digest of the record that it comes from. `check_head` reserves the
longest form of the message from the first trial on, so that no later trial is refused. A store is a function of the
`call` events: to add one, write a class beside its strategy, and add its place to `STORES` and its name to
`types.CarriedStore`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.tokens import TokenCounter, truncation
from smartplay_tools.episode.config import Rules
from smartplay_tools.errors import InvalidArgumentError, TranscriptError, in_one_line
from smartplay_tools.registry import Registry
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import Budget, CarriedStore, ResolvedBudget
from smartplay_tools.types.messages import Message

STORES = Registry(
    "carried store",
    {
        "notes": "smartplay_tools.context.strategies.notes:NotesStore",
        "memory": "smartplay_tools.context.strategies.memory:FilesStore",
    },
)
"""The stores, which an agent keeps with a tool, by the value of `Rules.carry`.

A store has two names: `field`, the field of the budget that offers its tool, and `kept`, the field of `Carried` that
holds it. Its function `after(calls, before, words)` returns what it holds after `call` events; `before` is what it held
at the start, None for nothing.
"""


class Carried(BaseModel):
    """What a trial takes over from the one before it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    record: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    """The digest of the record that it comes from: the `chain` of its last event."""
    result: str | None = None
    """The last result of that trial, as it was given; None if it made no call."""
    notes: str | None = None
    """The notes at its end; None if there were none, or they are not carried."""
    files: Mapping[str, str] | None = None
    """The files of its memory at its end, by their paths; None if there were none, or they are not carried."""

    @classmethod
    def of(cls, start: Event) -> Self | None:
        """Return what a start event carries, None for nothing; `TranscriptError` if it is not valid."""
        if (carried := start.get("carried")) is None:
            return None
        try:
            return cls.model_validate(carried)
        except ValidationError as error:
            raise TranscriptError(f"The record's start event carries nothing valid: {in_one_line(error)}.") from None

    def message(self, counter: TokenCounter, longest: int | None, words: Wording) -> Message:
        """Return the message that ends the head of the trial; `longest` is what `longest_message` gives for it.

        Tokens of joined texts do not add up. Should the whole be longer than its parts, the end of the result is cut.
        """
        whole = _message(words, self.result, self.notes)
        if longest is None or self.result is None or counter.message(whole) <= longest:
            return whole

        def count(result: str) -> int:
            return counter.message(_message(words, result, self.notes))

        return _message(words, truncation.cut_end(self.result, longest, count, words.cut), self.notes)


def longest_message(carry: CarriedStore, budget: ResolvedBudget, counter: TokenCounter, words: Wording) -> int:
    """Return the tokens of the longest message that a trial can find in its head, under a cap on prompts."""
    results = (budget.result_tokens, budget.manual_tokens, budget.recall_tokens)
    longest = max((cap for cap in results if cap is not None), default=0)
    if carry == "memory":
        return counter.message(_message(words, "", None)) + longest
    return counter.message(_message(words, "", "")) + longest + (budget.notes_tokens or 0)


def check_carry(rules: Rules, budget: Budget) -> None:
    """Raise an `InvalidArgumentError` if the store that a run asks to carry is not kept, or cannot be shown."""
    if rules.carry is None:
        if rules.chain is not None:
            raise InvalidArgumentError(
                f'chain={rules.chain} needs something to carry; ask for carry="notes" or carry="memory".'
            )
        return
    field = STORES[rules.carry].field
    if getattr(budget, field) is None:
        raise InvalidArgumentError(f'carry="{rules.carry}" carries what {field} keeps; give {field} a number.')
    if rules.observation != "text":
        raise InvalidArgumentError(
            f'carry="{rules.carry}" shows the last result in words; leave observation at "text", '
            f'not "{rules.observation}".'
        )
    if budget.prompt_tokens is not None and budget.result_tokens is None:
        raise InvalidArgumentError(
            f'carry="{rules.carry}" under prompt_tokens={budget.prompt_tokens} keeps room for the longest result; '
            'give result_tokens a number, or leave it at "auto".'
        )


def _message(words: Wording, result: str | None, notes: str | None) -> Message:
    parts: list[str] = [words("carried")]
    for name, text in (("carried_result", result), ("carried_notes", notes)):
        if text is not None:
            parts.append(f"{words(name)}\n{text}")
    return {"role": "user", "content": "\n\n".join(parts)}
