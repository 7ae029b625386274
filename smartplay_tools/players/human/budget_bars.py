"""Budget bars: what a prompt takes of the budget, in numbers that add up.

A prompt is task, tools and past turns. Its tokens are charged to the episode with the reply to it, so the bar of the
episode includes them, and what is left there is what the reply may take.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile

from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.types import Prompt

WIDTH = 20
"""Cells of a full bar."""


@dataclass(frozen=True)
class BudgetBar:
    """A fact about the budget, in full and for a narrow terminal."""

    full: str
    short: str
    share: float | None = None
    """How much of the cap is used, at most 1; None without a cap."""


def budget_bars(prompt: Prompt, conversation: BaseConversation | None) -> list[BudgetBar]:
    """Return what the budget allows and how much of it is gone; empty without a conversation."""
    if conversation is None or conversation.view is None:
        return []
    budget, stats, view = conversation.episode.budget, conversation.episode.stats, conversation.view
    task = _task_tokens(prompt, conversation)
    parts = f" (task {task:,} + turns {view.tokens - task:,})"
    bars = [_budget_bar("prompt", view.tokens, budget.prompt_tokens, parts)]
    used = stats.tokens.prompt + stats.tokens.reply + view.tokens
    bars.append(_budget_bar("episode", used, budget.episode_tokens, " with this prompt"))
    bars.append(_budget_bar("calls", stats.tool_calls, budget.tool_calls))
    # The view counts the current observation, a history counts what is behind it.
    past = max(0, view.shown_steps - 1)
    allowed = "all" if budget.history is None else str(budget.history)
    bars.append(BudgetBar(f"history {past} past steps shown, {allowed} allowed", f"past steps {past}/{allowed}"))
    if prompt.max_tokens is not None:
        most = f"{prompt.max_tokens:,}"
        bars.append(BudgetBar(f"reply at most {most} tokens", f"reply {most}"))
    return bars


def _task_tokens(prompt: Prompt, conversation: BaseConversation) -> int:
    """Tokens of what comes before the first turn, tools and priming included."""
    counter = conversation.episode.counter
    if not prompt.tools:  # the paper's protocol has no turns: its prompts are put together anew
        return counter.messages(prompt.messages) + PRIMING
    head = takewhile(lambda message: message["role"] not in ("assistant", "tool"), prompt.messages)
    return counter.messages(list(head)) + counter.tools(prompt.tools) + PRIMING


def _budget_bar(name: str, used: int, cap: int | None, parts: str = "") -> BudgetBar:
    if cap is None:
        return BudgetBar(f"{name} {used:,}{parts}, no cap", f"{name} {used:,}")
    share = min(1.0, used / cap)
    full = round(WIDTH * share)
    drawn = f"{'█' * full}{'░' * (WIDTH - full)}"
    return BudgetBar(f"{name} {drawn} {used:,}/{cap:,}{parts}", f"{name} {used:,}/{cap:,}", share)
