"""A budget in numbers, and whether it is refused: docs/budgets.md, and docs/strategies.md of each strategy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import smartplay_tools as sp
from smartplay_tools.types import ResolvedBudget

from .answering import OVER, PICTURE
from .counting import PRIMING, Counting
from .model import FRAME, QUESTION


def in_numbers(budget: sp.Budget, spec: sp.GameSpec, head: int, picture: int) -> ResolvedBudget:
    """Return a budget in numbers; `head` counts head and schemas without strategies, `picture` what a picture costs."""
    given = budget.model_dump() | {name: getattr(budget, name) for name in ("stalled_turns", "strategy")}
    cap, results = budget.prompt_tokens, budget.result_tokens
    if results == "auto":
        shares: tuple[int | None, int | None] = (
            (None, None) if cap is None else (max(32, (cap - head) // 4) + picture, max(32, (cap - head) // 3))
        )
    else:
        shares = (results, results)
    return ResolvedBudget(
        **given
        | {
            "history": spec.history if budget.history == "game" else budget.history,
            "tool_calls": 4 * spec.rollout + 16 if budget.tool_calls == "game" else budget.tool_calls,
            "result_tokens": shares[0],
            "manual_tokens": shares[1],
        }
    )


def reserve_of(budget: ResolvedBudget, n: Counting) -> tuple[int, int]:
    """Return the tokens of the question for a summary and of the longest summary; 0 where none is asked for."""
    if budget.summary_tokens is None:
        return 0, 0
    question = n.message({"role": "user", "content": QUESTION.format(budget.summary_tokens)})
    return question, 3 + n.text("user") + n.text(FRAME) + budget.summary_tokens


def is_refused(
    budget: ResolvedBudget,
    n: Counting,
    head: Sequence[sp.Message],
    tools: Sequence[sp.ToolSpec],
    picture: int,
    form: str,
    carried: int = 0,
) -> bool:
    """Say whether an episode with a budget is refused; `picture` is what the picture of an observation costs.

    `form` is of what its observations are: text, picture or both. `carried` is the longest message that a trial takes
    over from the one before it.
    """
    if form == "text" and budget.newest_pictures is not None:
        return True
    if form == "picture" and budget.recall_tokens is not None:
        return True
    cap, history, slack = budget.prompt_tokens, budget.history, Fraction(str(budget.slack))
    smallest = n.messages(head) + n.tools(tools) + PRIMING + sum(reserve_of(budget, n)) + carried
    masks = budget.beyond_history == "mask"
    never_leaves = cap is None and (history is None or masks)
    if masks and history is None:
        return True
    if budget.summary_tokens is not None:
        at_every_step = not masks and history is not None and history == math.ceil((1 - slack) * history)
        if not slack or at_every_step or never_leaves:
            return True
    if budget.first_turns is not None and never_leaves:
        return True
    if budget.recall_tokens is not None:
        if cap is None and history is None:
            return True
        if cap is not None and smallest + budget.recall_tokens + (budget.result_tokens or 0) > cap:
            return True
    if budget.beyond_result == "offload" and budget.result_tokens is None:
        return True
    seen = picture + n.text(PICTURE + OVER) if picture else 0
    if budget.result_tokens is not None and seen > budget.result_tokens:
        return True
    least = max(smallest, smallest - sum(reserve_of(budget, n)) + seen)
    return cap is not None and least > cap
