"""Rows written by hand, whose means, differences and fronts can be computed in the head."""

from __future__ import annotations

from typing import Any

BUDGET = {
    "history": None,
    "prompt_tokens": None,
    "reply_tokens": None,
    "episode_tokens": None,
    "result_tokens": None,
    "manual_tokens": None,
    "tool_calls": 216,
    "stalled_turns": 10,
    "slack": 0.0,
}


def row(seed: int = 0, score: float = 0.0, *, tokens: int = 100, cost: float | None = None, **facts: Any) -> Any:
    """A row of one episode: `tokens` in prompts, none in replies; half of them in a stable prefix."""
    window = {name: facts.pop(name) for name in list(facts) if name in BUDGET}
    usual = {
        "key": f"{seed:016x}",
        "game": "BanditTwoArmedHighLowFixed-v0",
        "engine": None,
        "player": "rule",
        "player_options": {},
        "protocol": "tools",
        "manual": "tool",
        "batch": "all",
        "context": "window",
        "tokenizer": "o200k_base",
        "options": {},
        "trial": seed,
    }
    measured = {
        "seed": seed,
        "score": score,
        "reward": score,
        "normalized_score": score / 45,
        "tokens": {"prompt": tokens, "reply": 0, "prefix": tokens // 2, "overruns": 0, "provider": None},
        "cost": cost,
        "end_reason": "rollout",
        "steps": 50,
        "tool_calls": 50,
        "cut_results": 0,
    }
    asked = {name: cap for name, cap in window.items() if name != "manual_tokens"}
    budgets = {"budget": BUDGET | window, "asked": {"history": None, "stalled_turns": 10} | asked}
    return usual | measured | budgets | facts
