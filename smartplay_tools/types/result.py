"""The state of an episode, and its result."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from smartplay_tools.types.recorded import Recorded
from smartplay_tools.types.usage import Usage

CarriedStore = Literal["notes", "memory"]
"""What a trial of a run can leave to the next one: the agent's notes, or the files of its tool `memory`."""

EndReason = Literal[
    "terminated",
    "rollout",
    "tool_calls",
    "episode_tokens",
    "prompt_tokens",
    "no_tool_call",
    "stalled_turns",
    "player_error",
    "game_error",
    "strategy_error",
    "run_budget",
    "host",
    "closed",
]
"""Why an episode is over. `terminated` and `rollout` are the game's own ends; a reason with the name of a budget
means that it is spent; `host` is a limit of the framework that drove the agent (`EpisodeResult.detail` names it)."""


@dataclass(frozen=True, slots=True)
class Progress:
    """The state of an episode, before or after its end."""

    score: float
    normalized_score: float | None
    reward: float
    steps: int
    end_reason: EndReason | None
    """Why it is over; None while it runs."""


class Tokens(Recorded):
    """The tokens of an episode: our count and the provider's."""

    later: ClassVar[Mapping[str, Any]] = {"summary_prompt": 0, "summary_reply": 0}

    prompt: int = 0
    """Sum over all prompts."""
    reply: int = 0
    """Sum over all replies."""
    prefix: int = 0
    """The part of `prompt` that repeats the beginning of the previous prompt: a provider's cache can serve it."""
    overruns: int = 0
    """Replies longer than their cap; they are charged in full."""
    provider: Usage | None = None
    summary_prompt: int = 0
    """The part of `prompt` that asked for summaries."""
    summary_reply: int = 0
    """The part of `reply` that was summaries."""


class EpisodeResult(Recorded):
    """The result of an episode, a row of `results.jsonl`. It contains no times, so equal play gives equal rows."""

    later: ClassVar[Mapping[str, Any]] = dict.fromkeys(
        (
            "cut_summaries",
            "empty_summaries",
            "over_prompts",
            "pages",
            "recalls",
            "refused_memory",
            "refused_notes",
            "summaries",
            "unusable_usages",
        ),
        0,
    )

    game: str
    engine: str | None = None
    seed: int
    score: float
    normalized_score: float | None
    reward: float
    completed: bool
    steps: int
    turns: int
    tool_calls: int
    """Calls answered while the episode ran, mistakes included."""
    illegal_actions: int
    malformed_calls: int
    refused_calls: int
    """Calls refused by the batch policy, calls after the end of the game in the same message, calls in a summary."""
    idle_replies: int
    """Replies without a tool call."""
    fallback_actions: int = 0
    """Answers in which the paper's protocol found no action, so that the game's first action was played."""
    tokens: Tokens
    cut_results: int
    refused_notes: int = 0
    """Notes that were longer than `notes_tokens`, so that the earlier ones stood."""
    refused_memory: int = 0
    """Calls of `memory` that would have made its files larger than `memory_tokens`, so that nothing changed."""
    recalls: int = 0
    """Answers of `recall`, empty ones included."""
    pages: int = 0
    """Pages of results that were read with `read_result`."""
    summaries: int = 0
    """Summaries that were asked for and answered: one for each time that the window moved."""
    cut_summaries: int = 0
    """Summaries whose end was cut to `summary_tokens`."""
    empty_summaries: int = 0
    """Summaries of which nothing was left to show, so that the earlier one stood."""
    over_prompts: int = 0
    """Prompts over `prompt_tokens` of a host that owns the context; they were counted, not cut."""
    unusable_usages: int = 0
    """Usages reported by a provider whose numbers cannot be token counts; they are ignored."""
    end_reason: EndReason
    error: str | None = None
    """The exception's type and message for an end whose name ends in `_error`; its traceback is in the transcript."""
    detail: str | None = None
    """The host's name for the limit that ended the episode (`host`)."""
    state_hash: str
    context: Literal["window", "host"]
    deviations: dict[str, Any]
    """The differences from the paper's protocol: name -> {"paper": ..., "played": ...}."""
    versions: dict[str, str]

    def _repr_html_(self) -> str:
        human = "" if self.normalized_score is None else f" ({self.normalized_score:.0%} of the human score)"
        names = ("illegal_actions", "malformed_calls", "refused_calls", "idle_replies", "cut_results")
        mistakes = [f"{getattr(self, name)} {name.replace('_', ' ')}" for name in names if getattr(self, name)]
        facts = {
            "score": f"{self.score:g}{human}",
            "end": self.end_reason + (f": {self.error}" if self.error else ""),
            "steps": f"{self.steps} in {self.turns} turns",
            "tokens": f"{self.tokens.prompt:,} in prompts, {self.tokens.reply:,} in replies",
            "mistakes": ", ".join(mistakes) or "none",
            "seed": str(self.seed),
        }
        return facts_as_html(self.game, facts)


MISTAKES = ("illegal_actions", "malformed_calls", "idle_replies", "fallback_actions")
"""The counts of an `EpisodeResult` that are a model's mistakes; refused calls are not, as the batch policy decides
those."""


def facts_as_html(title: str, facts: Mapping[str, str]) -> str:
    """Return a title and facts as a small table, as a notebook shows objects."""
    rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in facts.items())
    return f"<div><b>{html.escape(title)}</b><table>{rows}</table></div>"
