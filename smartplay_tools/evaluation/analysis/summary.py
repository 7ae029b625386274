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
from smartplay_tools.evaluation.analysis.capabilities import (
    Baselines,
    Capabilities,
    Weights,
    capability_scores,
    find_baselines,
)
from smartplay_tools.evaluation.analysis.grouping import Condition, PlayedCell, by_cell, conditions
from smartplay_tools.evaluation.analysis.intervals import USUAL, MeanEstimate, Method, Sample, named_estimates
from smartplay_tools.evaluation.analysis.pairs import completed, normalized_score, reward, sample, score
from smartplay_tools.records.rows import Row, grouped, has_reported_tokens, is_unplayed
from smartplay_tools.types import EndReason

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

FAMILIES_WITHOUT_OBJECTIVE = ("bandit", "rock_paper_scissors", "crafter")
"""Games that cannot be completed, so they have no completion rate (paper, section 4.2)."""


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
        """The provider's count as a multiple of ours."""
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
    """USD; None if the price of an episode is not known."""
    deviations: Mapping[str, Any]
    """What differs from the paper's protocol: name -> {"paper": ..., "played": ...}."""
    unplayed: int
    """Episodes that ended without a single action; their scores say nothing of how well the player plays."""

    @property
    def privileged(self) -> bool:
        """Whether the player had access to the game's state."""
        return "player" in self.deviations

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
    baselines: tuple[Baselines, ...]
    failures: tuple[Failures, ...]

    def label_of(self, cell: CellSummary) -> str:
        """Return a short description of what a cell's player was given; empty for the default."""
        among = [profile.condition for profile in self.profiles]
        return next((condition.label_among(among) for condition in among if cell.cell in condition.cells), "")


def summarize(
    rows: Iterable[Row], failures: Iterable[Row] = (), *, weights: Weights = "paper", method: Method = USUAL
) -> RunSummary:
    """Summarise a run, from `RunFolder.rows` (finished episodes) and `RunFolder.failures` (failed attempts)."""
    rows = list(rows)
    groups = by_cell(rows)
    estimates = named_estimates((_measured(cell, members) for cell, members in groups), method)
    cells = [_cell_summary(cell, members, means) for (cell, members), means in zip(groups, estimates, strict=True)]
    grouped = conditions([cell for cell, _ in groups])
    profiles = [_profile(condition, groups, cells, weights) for condition in grouped]
    lost = _failures(failures, {row["key"] for row in rows})
    played = [
        (condition, [(c.cell, c.score, c.normalized_score) for c in cells if c.cell in condition.cells])
        for condition in grouped
    ]
    return RunSummary(tuple(cells), tuple(profiles), tuple(find_baselines(played)), tuple(lost))


def _measured(cell: PlayedCell, rows: Sequence[Row]) -> dict[str, Sample]:
    """The samples from which a cell's means are estimated."""
    objective = cell.spec.family not in FAMILIES_WITHOUT_OBJECTIVE
    return {
        "reward": sample(rows, reward),
        "completion": sample(rows if objective else [], completed),
        "score": sample(rows, score),
        "normalized_score": sample(rows, normalized_score),
    }


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
        tokens=_tokens(rows),
        cost=None if None in costs else math.fsum(costs),
        deviations=_deviations(cell, rows),
        unplayed=sum(map(is_unplayed, rows)),
    )


def _tokens(rows: Sequence[Row]) -> TokenSummary:
    tokens = [row["tokens"] for row in rows]
    total = {name: sum(each[name] for each in tokens) for name in ("prompt", "reply", "prefix", "overruns")}
    reported = [each for each in tokens if each["provider"] is not None]
    requests = sum(each["provider"]["requests"] for each in reported) if reported else None
    counted = [row["tokens"] for row in rows if has_reported_tokens(row)]
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
    if len(rows) != cell.spec.trials:
        merged["trials"] = differs(cell.spec.trials, len(rows))
    return merged


def _profile(
    condition: Condition,
    groups: Sequence[tuple[PlayedCell, list[Row]]],
    cells: Sequence[CellSummary],
    weights: Weights,
) -> Profile:
    rows = {cell.game: members for cell, members in groups if cell in condition.cells}
    normalized = {game: sample(members, normalized_score).values for game, members in rows.items()}
    privileged = any(cell.privileged for cell in cells if cell.cell in condition.cells)
    return Profile(condition, privileged, capability_scores(normalized, weights=weights))


def _failures(rows: Iterable[Row], finished: Set[str]) -> list[Failures]:
    return [
        Failures(
            game,
            player,
            attempts=len(failed),
            missing=len({row["key"] for row in failed} - finished),
            reasons=Counter(row["end_reason"] for row in failed),
            last_error=next((row["error"] for row in reversed(failed) if row["error"]), None),
        )
        for (game, player), failed in grouped(rows, lambda row: (row["game"], row["player"])).items()
    ]
