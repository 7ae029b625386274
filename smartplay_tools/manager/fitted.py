"""FittedPrompt: what a context manager sends of a conversation, and what it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools.manager.forms import Given, MessageForm
from smartplay_tools.manager.strategy import AskedStrategy
from smartplay_tools.manager.summaries import Covered
from smartplay_tools.manager.units import Chosen, Shown


@dataclass(frozen=True, slots=True)
class Conversation:
    """The messages that a manager was given."""

    given: Sequence[Any]
    """The objects."""
    data: Sequence[Given]
    """The same as plain data."""
    keys: list[object]
    """What stands for what each says."""
    form: MessageForm


@dataclass(frozen=True)
class FittedPrompt:
    """The messages of a prompt, its tokens, and what became of every message that was given.

    Numbers are positions in the list that was given, from 0. A message of which nothing was changed is the object that
    was given.
    """

    messages: list[Any]
    """What to send, in the form of what was given."""
    tokens: int
    """Budget tokens of these messages, of `system`, tools and output schema, and of priming."""
    sources: Sequence[int | None]
    """For each message its number; None for one that was made here."""
    dropped: Sequence[int] = ()
    """Messages that are not shown."""
    masked: Sequence[int] = ()
    """Messages whose results are older than `history`, and read as a line that says so."""
    trimmed: Sequence[int] = ()
    """Replies that are shown with their calls alone."""
    elided: Sequence[int] = ()
    """Results whose pictures are left out."""
    cut: Sequence[int] = ()
    """Results that were longer than their cap, and end with a notice."""
    repaired: Sequence[int] = ()
    """Messages that were moved, changed or left out so that each call has its result."""
    rewritten: Sequence[int] = ()
    """Messages that a compactor has changed, or in whose place its own stand."""
    made: int = 0
    """How many calls without a result were answered here."""
    uncertain: Sequence[int] = ()
    """Shown messages with encrypted parts, whose tokens are an estimate."""
    parts: Mapping[str, int] = field(default_factory=dict)
    """Tokens by part: `tools`, `head`, `summary` if there is one, `pinned`, `turns`; priming is in `head`.

    What a strategy has written counts as a summary.
    """
    costs: Sequence[int] = ()
    """Tokens of each message of `messages`."""
    summary: str = ""
    """The message with a summary that it shows after the head; made here, so its source is None."""
    failed: str = ""
    """Why a summary could not be asked for, where the manager goes on without one."""
    recorded_as: tuple[str, int] | None = field(default=None, compare=False)
    """The thread and the number of the prompt in the manager's records."""


@dataclass(frozen=True, slots=True)
class Draft:
    """A prompt that is not finished: a model may have to be asked."""

    head: Sequence[Shown]
    parts: Mapping[str, int]
    """Tokens by part."""
    repaired: Sequence[int]
    made: int
    lacks_user: bool
    """Whether no words of a user stand in the head."""
    chosen: Chosen = field(default_factory=Chosen)
    covered: Covered | None = None
    """What a summary has to cover; None if nothing has left, or nobody asks for summaries."""
    asked: AskedStrategy | None = None
    """What a strategy is asked about; None without one."""
    summary: Shown | None = None
    failed: str = ""

    def prompt(self, conversation: Conversation) -> FittedPrompt:
        """Return the prompt, with the objects that were given where nothing was changed."""
        summary, chosen = self.summary, self.chosen
        shown = [*self.head, *([] if summary is None else [summary]), *chosen.shown]
        own = sum(each.tokens for each in shown if each.turn is None)
        of_turns = [each for each in shown if each.turn is not None and each.turn >= 0]
        pinned = sum(each.tokens for each in of_turns if each.turn in chosen.pinned)
        parts = {**self.parts, "summary": own} if own else dict(self.parts)
        parts |= {"pinned": pinned, "turns": sum(each.tokens for each in of_turns) - pinned}
        out: list[Any] = []
        changed: dict[str, Any] = {"masked": [], "trimmed": [], "elided": [], "cut": []}
        for each in shown:
            source = each.part.source
            is_given = each.part.is_given and each.message is each.part.message
            out.append(conversation.given[source] if is_given and source is not None else each.message)
            if each.change not in (None, "rewritten") and source is not None:
                changed[str(each.change)].append(source)
        sources = [each.part.source for each in shown]
        kept = {*sources, *self.repaired, *chosen.rewritten}
        return FittedPrompt(
            out,
            sum(parts.values()),
            sources,
            dropped=sorted({*range(len(conversation.given))}.difference(kept)),
            **changed,
            repaired=self.repaired,
            rewritten=chosen.rewritten,
            made=self.made,
            uncertain=[e.part.source for e in shown if e.part.cost.is_uncertain and e.part.source is not None],
            parts=parts,
            costs=[each.tokens for each in shown],
            summary="" if summary is None else str(summary.message["content"]),
            failed=self.failed or chosen.failed,
        )
