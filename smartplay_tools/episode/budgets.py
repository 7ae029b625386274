"""Budgets in numbers: what "game" and "auto" in a `Budget` mean for one game and one head, and what cannot be enforced.

They are resolved once, when an episode begins; the record contains the numbers.
"""

from __future__ import annotations

from smartplay_tools.context.strategies import Strategies, refusal
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.types import Budget, ResolvedBudget

SMALLEST_AUTO_CAP = 32
"""The smallest cap that "auto" gives a result, in tokens: with less, no observation could be read."""


def usual_tool_calls(rollout: int) -> int:
    """Return the cap on tool calls that "game" stands for."""
    return 4 * rollout + 16


def resolve(asked: Budget, spec: GameSpec, head_tokens: int, picture: int = 0) -> ResolvedBudget:
    """Resolve a budget for a game; `head_tokens` counts head and tool schemas without the manual.

    `picture` is the tokens of a picture, which "auto" gives a result in addition.

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
        results, manual = max(room // 4, SMALLEST_AUTO_CAP) + picture, max(room // 3, SMALLEST_AUTO_CAP)
    numbers = {
        "history": _history(asked, spec),
        "result_tokens": results,
        "manual_tokens": manual,
        "tool_calls": usual_tool_calls(spec.rollout) if asked.tool_calls == "game" else asked.tool_calls,
    }
    return ResolvedBudget(**{**dict(asked), **numbers})


def check_head(budget: Budget, least: int, strategies: Strategies | None = None, *, carried: int = 0) -> None:
    """Raise a ValueError if the smallest prompt is over the cap.

    `least` counts its head, schemas and priming; `strategies` may keep more of it free, and `carried` is the longest
    message that a trial takes over from the one before it.
    """
    reserve = 0 if strategies is None else strategies.reserve
    if budget.prompt_tokens is not None and budget.prompt_tokens < least + reserve + carried:
        more = f", and the {reserve} more that {strategies.reserved_for} needs" if strategies and reserve else ""
        more += f", and up to {carried} for what is carried from the trial before" if carried else ""
        raise InvalidArgumentError(
            f"prompt_tokens={budget.prompt_tokens} cannot hold the head of every prompt and the tool schemas, which "
            f"take {least} tokens{more}; raise it well above that."
        )
    if strategies is not None:
        strategies.check(budget, least + reserve + carried)


def check_pictures(budget: ResolvedBudget, least: int, picture: int, words: int) -> None:
    """Raise an `InvalidArgumentError` if an observation with its picture does not fit, since no picture is ever cut.

    `least` counts the smallest prompt, `picture` a picture, and `words` the text that accompanies it.
    """
    for name, cap, needed in (
        ("result_tokens", budget.result_tokens, picture + words),
        ("prompt_tokens", budget.prompt_tokens, least + picture + words),
    ):
        if cap is not None and cap < needed:
            raise InvalidArgumentError(
                f"{name}={cap} cannot hold an observation with a picture of {picture} tokens; it takes at least "
                f'{needed}: raise it, or play with observation="text".'
            )


def check_strategies(
    budget: Budget, spec: GameSpec, *, context: str, protocol: str = "tools", observation: str
) -> None:
    """Raise an `InvalidArgumentError` if a strategy that the budget asks for cannot be enforced."""
    if refusal := refused_strategy(budget, spec, context=context, protocol=protocol, observation=observation):
        raise InvalidArgumentError(refusal)


def refused_strategy(
    budget: Budget, spec: GameSpec, *, context: str, protocol: str = "tools", observation: str = "text"
) -> str | None:
    """Return why a strategy that the budget asks for cannot be enforced, in one sentence; None if all can be."""
    history, asked = _history(budget, spec), ", ".join(budget.strategies)
    if budget.question_tokens is not None and budget.strategy is None:
        return "question_tokens caps the questions of a compactor, and there is none; name one as strategy."
    if budget.episode_cost is not None and context != "window":
        return 'episode_cost is checked before a prompt is sent, which context="host" leaves to the host; leave it out.'
    if not asked:
        return None
    if context != "window" or protocol != "tools":
        where = 'context="host" leaves the past to the host' if context != "window" else "the paper's protocol has none"
        return f'{asked} needs a window over tool calls, and {where}; use context="window" and protocol="tools".'
    return refusal(budget, history, observation)


def _history(asked: Budget, spec: GameSpec) -> int | None:
    return spec.history if asked.history == "game" else asked.history
