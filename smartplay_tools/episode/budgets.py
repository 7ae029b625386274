"""Budgets in numbers: what "game" and "auto" in a `Budget` mean for one game and one head, and what cannot be enforced.

They are resolved once, when an episode begins; the record contains the numbers.
"""

from __future__ import annotations

import math
from fractions import Fraction

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.specs import GameSpec
from smartplay_tools.types import Budget, ResolvedBudget

SMALLEST_AUTO_CAP = 32
"""The smallest cap that "auto" gives a result, in tokens: with less, no observation could be read."""


def usual_tool_calls(rollout: int) -> int:
    """Return the cap on tool calls that "game" stands for."""
    return 4 * rollout + 16


def resolve(asked: Budget, spec: GameSpec, head_tokens: int) -> ResolvedBudget:
    """Resolve a budget for a game; `head_tokens` counts head and tool schemas without the manual.

    The schemas are the three that every strategy has, so that "auto" cuts results alike under all of them.
    """
    if isinstance(asked, ResolvedBudget):
        return asked
    results: int | None
    if asked.result_tokens != "auto":
        results = manual = asked.result_tokens
    elif asked.prompt_tokens is None:
        results = manual = None
    else:
        room = asked.prompt_tokens - head_tokens
        results, manual = max(room // 4, SMALLEST_AUTO_CAP), max(room // 3, SMALLEST_AUTO_CAP)
    numbers = {
        "history": _history(asked, spec),
        "result_tokens": results,
        "manual_tokens": manual,
        "tool_calls": usual_tool_calls(spec.rollout) if asked.tool_calls == "game" else asked.tool_calls,
    }
    return ResolvedBudget(**{**dict(asked), **numbers})


def share_kept(slack: float) -> Fraction | int:
    """Return 1 - slack, read as a decimal: in floats, ceil((1 - .7) x 10) is 4. Without slack it is the integer 1."""
    return 1 - Fraction(str(slack)) if slack else 1


def check_head(budget: Budget, least: int, reserve: int = 0) -> None:
    """Raise a ValueError if the smallest prompt is over the cap.

    `least` counts its head, schemas and priming, `reserve` what is kept free for summaries.
    """
    if budget.prompt_tokens is not None and budget.prompt_tokens < least + reserve:
        summaries = f", and the {reserve} more that summary_tokens={budget.summary_tokens} needs" if reserve else ""
        raise InvalidArgumentError(
            f"prompt_tokens={budget.prompt_tokens} cannot hold the head of every prompt and the tool schemas, which "
            f"take {least} tokens{summaries}; raise it well above that."
        )


def check_strategies(budget: Budget, spec: GameSpec, *, context: str, protocol: str = "tools") -> None:
    """Raise an `InvalidArgumentError` if the budget says something of the past that cannot be enforced."""
    if refusal := refused_strategy(budget, spec, context=context, protocol=protocol):
        raise InvalidArgumentError(refusal)


def refused_strategy(budget: Budget, spec: GameSpec, *, context: str, protocol: str = "tools") -> str | None:
    """Return why what the budget says of the past cannot be enforced, in one sentence; None if it can be."""
    history, asked = _history(budget, spec), ", ".join(budget.strategies)
    if not asked:
        return None
    if context != "window" or protocol != "tools":
        where = 'context="host" leaves the past to the host' if context != "window" else "the paper's protocol has none"
        return f'{asked} needs a window over tool calls, and {where}; use context="window" and protocol="tools".'
    if budget.beyond_history == "mask" and history is None:
        return 'beyond_history="mask" without a history masks nothing; give history a number, or leave it at "drop".'
    if budget.summary_tokens is None:
        return None
    if budget.slack == 0:
        return "summary_tokens at slack 0 would ask for a summary at every step; give a slack, such as 0.5."
    aged = None if budget.beyond_history == "mask" else history
    if aged is not None and aged == math.ceil(share_kept(budget.slack) * aged):
        return (
            f"summary_tokens with history={history} and slack={budget.slack:g} would ask for a summary at every step; "
            "raise one of the two."
        )
    if aged is None and budget.prompt_tokens is None:
        return "summary_tokens has nothing to summarise where no turn ever leaves; give prompt_tokens a number."
    return None


def _history(asked: Budget, spec: GameSpec) -> int | None:
    return spec.history if asked.history == "game" else asked.history
