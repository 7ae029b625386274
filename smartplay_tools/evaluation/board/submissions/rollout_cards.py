"""The rollout card of a submission: what its scores were computed from, by which rules, and without what.

A score of an agent depends on which part of the records counts and on what happens to episodes that failed ("Rollout
Cards: A Reproducibility Standard for Agent Research", arXiv 2605.12131), so the card declares three things: the views
(what each file of the bundle shows of an episode), the rules by which figures follow from them, and the drops (what is
in no score, by reason, and what was cut short or changed within episodes that are). It follows from the records alone,
and the check computes it again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from smartplay_tools.records.record import EXCEPTION, Record
from smartplay_tools.records.rows import Row, is_unplayed

NAME = "rollout-card.json"
VERSION = 1

VIEWS = {
    "episodes/KEY.jsonl": "the record of a finished episode: every prompt, reply, call and answer, hashed in a chain",
    "attempts/KEY.N.jsonl": "the record of an attempt without a result",
    "results.jsonl": "a row for every finished episode, which its record gives",
    "manifest.json": "the plan: every episode with its game, seed and budget, declared before the first one",
}

RULES = {
    "episodes": "every planned episode that ended by itself counts, once; a spent budget of the episode ends it, too",
    "score": "the game's own score at the end of the episode, under the rules of docs/metrics.md",
    "normalized_score": "(score - min) / (human - min), with the paper's human scores; null where it has none",
    "aggregation": "the mean over the episodes of a game and budget; none is weighted, clipped or left out",
    "tokens": "counted by the package's tokenizer over whole prompts and replies; a provider's count stands beside it",
    "cost": "of all episodes, by the prices of the manifest; null where a price is not known; attempts are not in it",
}

COUNTED = (
    "illegal_actions",
    "malformed_calls",
    "refused_calls",
    "idle_replies",
    "fallback_actions",
    "cut_results",
    "cut_summaries",
    "unusable_usages",
)
"""What happened within episodes that count, as rows have it."""


def rollout_card(planned: int, rows: Sequence[Row], attempts: Mapping[str, int]) -> dict[str, Any]:
    """Return the card of a bundle; `attempts` are those without a result, by reason."""
    return {
        "rollout_card": VERSION,
        "views": VIEWS,
        "rules": RULES,
        "drops": {
            "episodes_planned": planned,
            "episodes_in_scores": len(rows),
            "episodes_dropped": planned - len(rows),
            "attempts_without_result": dict(sorted(attempts.items())),
        },
        "within_scores": {
            "end_reasons": dict(sorted(Counter(row["end_reason"] for row in rows).items())),
            "episodes_without_action": sum(map(is_unplayed, rows)),
            **{name: sum(row.get(name, 0) for row in rows) for name in COUNTED},
            "replies_over_their_cap": sum(row["tokens"]["overruns"] for row in rows),
        },
    }


def attempts_by_reason(records: Iterable[Path]) -> dict[str, int]:
    """Count attempts by why they have no result, as the check does."""
    heads = map(Record.head, records)
    return dict(Counter(EXCEPTION if head.start is None else head.end_reason for head in heads))
