"""Summaries: the agent is asked for one when turns leave the window, and it is shown in their place.

A window with `Budget.summary_tokens` asks the agent for a summary whenever turns are about to leave. A window that
moves leaves `reserve` tokens free for the question and the longest answer, so that neither can end an episode. The
message that shows a summary never takes more tokens than are reserved for the answer. The answer is cut together with
the sentence that introduces it, because the tokens of two texts do not add up to those of the joined text.
"""

from __future__ import annotations

from smartplay_tools.context.grid import moved_on_grid
from smartplay_tools.context.prompts.wording import Wording
from smartplay_tools.context.strategies.ageing import drops_old_turns, turns_leave
from smartplay_tools.context.strategies.base import BudgetStrategy, Summary
from smartplay_tools.context.tokens import TokenCounter, truncation
from smartplay_tools.context.turns import Form
from smartplay_tools.types import Budget


class Summaries(BudgetStrategy):
    """Asks for a summary of the turns that leave, and shows it after the head."""

    name = "summary_tokens"
    option_help = "Cap on summaries of the turns that leave; none: not asked for."

    def __init__(self, budget: Budget, counter: TokenCounter, words: Wording) -> None:
        assert budget.summary_tokens is not None
        self._counter, self._words = counter, words
        self._cap = cap = budget.summary_tokens
        self._frame = f"{words('summary')}\n"
        self.question: Form = Form({"role": "user", "content": words("summary_request", tokens=cap)})
        """The last message of a prompt that asks for a summary."""
        self.question_tokens = self.question.tokens(counter)
        longest = 3 + counter.text("user") + counter.text(self._frame) + cap
        self.reserve = self.question_tokens + longest  # for the question and for the longest answer

    @classmethod
    def refusal(cls, budget: Budget, history: int | None) -> str | None:
        """Return why summaries cannot be asked for: it would be at every step, or never."""
        if budget.slack == 0:
            return "summary_tokens at slack 0 would ask for a summary at every step; give a slack, such as 0.5."
        aged = history if drops_old_turns(budget) else None
        if aged is not None and moved_on_grid(aged + 1, aged, budget.slack) == 1:
            return (
                f"summary_tokens with history={history} and slack={budget.slack:g} would ask for a summary at every "
                "step; raise one of the two."
            )
        if not turns_leave(budget, history):
            return "summary_tokens has nothing to summarise where no turn ever leaves; give prompt_tokens a number."
        return None

    def cut(self, reply_text: str) -> str:
        """Return the agent's words as they can be shown: whole, cut at their end with a notice, or nothing."""
        if not reply_text.strip():
            return ""
        shown = (
            reply_text
            if self._count(reply_text) <= self._cap
            else truncation.cut_end(reply_text, self._cap, self._count, self._words.cut)
        )
        return shown if shown.strip() else ""  # where not even the notice fits

    def show(self, text: str) -> Summary:
        """Return the summary that shows words of `cut`."""
        form = Form({"role": "user", "content": f"{self._frame}{text}"})
        return Summary(text, form, form.tokens(self._counter))

    def _count(self, text: str) -> int:
        """The tokens that a text adds to its frame."""
        return self._counter.text(f"{self._frame}{text}") - self._counter.text(self._frame)


def summaries_of(budget: Budget, counter: TokenCounter, words: Wording) -> Summaries | None:
    """Return the strategy of summaries, for readers of records; None where the budget asks for none."""
    return Summaries(budget, counter, words) if budget.summary_tokens is not None else None
