"""Summaries: the statistics of a run's rows, as plain data.

Pure functions from rows (`results.jsonl`) to summaries; nothing here reads a file or prints. How well a player plays
(reward, completion, score, normalised score) is estimated with an interval; mistakes, ends, tokens, cost and drift are
counted. Differences from the paper are listed with every cell, and episodes that failed are counted separately, because
an exception is not a score.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, get_args

from smartplay_tools.episode.config import differs
from smartplay_tools.evaluation.analysis.beside import Beside, early_ends, ends_of
from smartplay_tools.evaluation.analysis.capabilities import Capabilities, capability_scores
from smartplay_tools.evaluation.analysis.grouping import Condition, PlayedCell, by_cell, conditions, label_in
from smartplay_tools.evaluation.analysis.pairs import (
    Measure,
    completion,
    cost,
    normalized_score,
    reward,
    samples,
    score,
    tokens,
)
from smartplay_tools.records.rows import Row, has_reported_tokens, is_managed, is_unplayed
from smartplay_tools.statistics.intervals import MeanEstimate, named_estimates
from smartplay_tools.types import EndReason
from smartplay_tools.types.groups import grouped

__all__ = ["CellSummary", "Failures", "Profile", "RunSummary", "summarize"]

COUNTS = (
    "steps",
    "turns",
    "tool_calls",
    "illegal_actions",
    "malformed_calls",
    "refused_calls",
    "idle_replies",
    "fallback_actions",
    "unusable_usages",
    "cut_results",
)
"""Fields of a row that are added up over a cell."""

FIGURES: Mapping[str, Measure] = {
    "reward": reward,
    "completion": completion,
    "score": score,
    "normalized_score": normalized_score,
    "tokens": tokens,
    "cost": cost,
    "spent_cost": lambda row: row.get("spent_cost"),
}
"""What is estimated for every cell."""


@dataclass(frozen=True)
class Drift:
    """Our count of tokens against the provider's, over the episodes for which the provider reported one."""

    episodes: int
    ours: int
    provider: int

    @property
    def difference(self) -> int:
        """How many tokens more the provider counted."""
        return self.provider - self.ours

    @property
    def ratio(self) -> float | None:
        """The provider's count as a multiple of our count."""
        return self.provider / self.ours if self.ours else None


@dataclass(frozen=True)
class TokenSummary:
    """The tokens of a cell's episodes together."""

    prompt: int
    reply: int
    prefix: int
    overruns: int
    """Replies that were longer than allowed."""
    prompt_drift: Drift | None
    reply_drift: Drift | None
    requests: int | None
    """Requests to the provider, including those that failed; None without a provider."""

    @property
    def prefix_share(self) -> float | None:
        """The share of prompt tokens that repeat the beginning of the previous prompt."""
        return self.prefix / self.prompt if self.prompt else None


@dataclass(frozen=True)
class CellSummary:
    """All finished episodes of a cell."""

    cell: PlayedCell
    episodes: int
    reward: MeanEstimate
    completion: MeanEstimate | None
    """The share of episodes that reached the objective; None for games that have none."""
    score: MeanEstimate
    normalized_score: MeanEstimate | None
    """None unless the setting has a human score and the engine is comparable."""
    counts: Mapping[str, int]
    """`COUNTS`, added up."""
    end_reasons: Mapping[str, int]
    tokens: TokenSummary
    cost: float | None
    """USD of all episodes; None if the price of one is not known."""
    episode_tokens: MeanEstimate
    """Tokens of an episode, prompts and replies."""
    episode_cost: MeanEstimate | None
    """USD of an episode; None if the price of one is not known."""
    spent_cost: MeanEstimate | None
    """What an episode cost by the `cost_rule` of its budget; None unless that caps its cost."""
    deviations: Mapping[str, Any]
    """What differs from the paper's protocol: name -> {"paper": ..., "played": ...}."""
    unplayed: int
    """Episodes that ended without a single action; their scores say nothing of how well the player plays."""
    managed: int
    """Episodes whose context a provider managed, so that what the model saw is not on record."""
    early: int
    """Episodes that ended before their game did."""

    @property
    def privileged(self) -> bool:
        """Whether the player had access to the game's state."""
        return "player" in self.deviations

    @property
    def beside(self) -> Beside:
        """What may have to stand beside its score."""
        steps = self.counts["steps"] / self.episodes
        return Beside(
            self.cell.game, self.score.mean, self.reward.mean, steps, early_ends(Counter(self.end_reasons).elements())
        )

    @property
    def cut_share(self) -> float | None:
        """The share of tool results that were cut to their cap; None without a tool call."""
        calls = self.counts["tool_calls"]
        return self.counts["cut_results"] / calls if calls else None


@dataclass(frozen=True)
class Failures:
    """Failed attempts of one player at one game, which are in no mean."""

    game: str | None
    """None if an attempt failed before its episode began."""
    player: str | None
    attempts: int
    missing: int
    """Episodes among them that no later attempt has finished so far."""
    reasons: Mapping[str, int]
    last_error: str | None


@dataclass(frozen=True)
class Profile:
    """A player's condition, and its nine capability scores."""

    condition: Condition
    privileged: bool
    """Whether the player had access to the game's state."""
    capabilities: Capabilities


@dataclass(frozen=True)
class RunSummary:
    """The statistics of a run."""

    cells: tuple[CellSummary, ...]
    profiles: tuple[Profile, ...]
    failures: tuple[Failures, ...]

    def label_of(self, cell: CellSummary) -> str:
        """Return a short description of what a cell's player was given; empty for the default."""
        return label_in([profile.condition for profile in self.profiles], cell.cell)


def summarize(rows: Iterable[Row], failures: Iterable[Row] = ()) -> RunSummary:
    """Summarise a run, from `RunFolder.rows` (finished episodes) and `RunFolder.failures` (failed attempts)."""
    rows = list(rows)
    groups = by_cell(rows)
    among = conditions(cell for cell, _ in groups)
    measured = [samples(members, FIGURES) for _, members in groups]
    pairs = zip(groups, measured, strict=True)
    cells = tuple(_cell_summary(cell, members, named_estimates(own)) for (cell, members), own in pairs)
    lost = _failures(failures, {row["key"] for row in rows})
    normalized = [each["normalized_score"].values for each in measured]
    profiles = (_profile(condition, cells, normalized) for condition in among)
    return RunSummary(cells, tuple(profiles), tuple(lost))


def _cell_summary(cell: PlayedCell, rows: Sequence[Row], estimates: Mapping[str, MeanEstimate]) -> CellSummary:
    costs = [row["cost"] for row in rows]
    ends = Counter(row["end_reason"] for row in rows)
    return CellSummary(
        cell=cell,
        episodes=len(rows),
        reward=estimates["reward"],
        completion=estimates.get("completion"),
        score=estimates["score"],
        normalized_score=estimates.get("normalized_score"),
        counts={name: sum(row.get(name, 0) for row in rows) for name in COUNTS},
        end_reasons={reason: ends[reason] for reason in get_args(EndReason) if ends[reason]},
        deviations=_deviations(cell, rows),
        unplayed=sum(map(is_unplayed, rows)),
        managed=sum(map(is_managed, rows)),
        early=sum(ends_of(rows).values()),
        cost=None if None in costs else math.fsum(costs),
        episode_tokens=estimates["tokens"],
        episode_cost=None if None in costs else estimates["cost"],
        spent_cost=estimates.get("spent_cost"),
        tokens=_tokens(rows),
    )


def _tokens(rows: Sequence[Row]) -> TokenSummary:
    tokens = [row["tokens"] for row in rows]
    total = {name: sum(each[name] for each in tokens) for name in ("prompt", "reply", "prefix", "overruns")}
    reported = [each for each in tokens if each["provider"] is not None]
    requests = sum(each["provider"]["requests"] for each in reported) if reported else None
    counted = [row["tokens"] for row in rows if has_reported_tokens(row) and not is_managed(row)]
    return TokenSummary(
        **total, prompt_drift=_drift("prompt", counted), reply_drift=_drift("reply", counted), requests=requests
    )


def _drift(name: str, counts: Sequence[Mapping[str, Any]]) -> Drift | None:
    if not counts:
        return None
    return Drift(len(counts), sum(each[name] for each in counts), sum(each["provider"][name] for each in counts))


def _deviations(cell: PlayedCell, rows: Sequence[Row]) -> dict[str, Any]:
    """What the results say, and the number of trials, which only a run can tell."""
    merged: dict[str, Any] = {}
    for row in rows:
        for name, values in row["deviations"].items():
            deviation = merged.setdefault(name, {"paper": values["paper"], "played": []})
            deviation["played"] += [values["played"]] if values["played"] not in deviation["played"] else []
    for values in merged.values():
        values["played"] = values["played"][0] if len(values["played"]) == 1 else values["played"]
    if cell.spec is not None and len(rows) != cell.spec.trials:
        merged["trials"] = differs(cell.spec.trials, len(rows))
    return merged


def _profile(condition: Condition, cells: Sequence[CellSummary], normalized: Sequence[Sequence[float]]) -> Profile:
    """The profile of a condition, from the normalised scores of all cells."""
    own = [(each, scores) for each, scores in zip(cells, normalized, strict=True) if each.cell in condition.cells]
    scores = capability_scores({each.cell.game: scores for each, scores in own})
    return Profile(condition, any(each.privileged for each, _ in own), scores)


def _failures(rows: Iterable[Row], finished: Set[str]) -> list[Failures]:
    attempts = grouped(rows, lambda row: (row["game"], row["player"]))
    return [
        Failures(
            game,
            player,
            attempts=len(failed),
            missing=len({row["key"] for row in failed} - finished),
            reasons=Counter(row["end_reason"] for row in failed),
            last_error=next((row["error"] for row in reversed(failed) if row["error"]), None),
        )
        for (game, player), failed in attempts.items()
    ]
