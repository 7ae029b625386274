"""A run as flat tables for notebooks, and its summary as JSON.

A row is an episode; nested fields become separate columns (`tokens.prompt` is `prompt_tokens`, `budget.history` is
`budget_history`), and fields without a fixed structure are JSON text. The columns are always the same, in the same
order and of the same types, even if there are few rows.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from smartplay_tools.episode.config import RULES, Rules
from smartplay_tools.evaluation.analysis.formats import rows_to_csv
from smartplay_tools.evaluation.analysis.grouping import Condition
from smartplay_tools.evaluation.analysis.summary import COUNTS, CellSummary, Drift, RunSummary, TokenSummary
from smartplay_tools.records.rows import FILES, LATER as ROWS_LATER, OPTIONAL, Row
from smartplay_tools.statistics.intervals import with_ends
from smartplay_tools.types import STRATEGIES, WORDS, Budget, EpisodeResult, Tokens, Usage
from smartplay_tools.types.arguments import well_formed

_STRINGS = ("key", "game", "engine", "player", *(name for name in RULES if name != "chain"), "tokenizer", "prompts")
_TOKENS = ("prompt", "reply", "prefix")
_PROVIDER = ("prompt", "reply", "cached", "written", "reasoning")
_CAPS = (
    "history",
    "prompt_tokens",
    "reply_tokens",
    "question_tokens",
    "episode_tokens",
    "result_tokens",
    "manual_tokens",
    "tool_calls",
    "stalled_turns",
)

COLUMNS: dict[str, tuple[str, str]] = {
    "run": ("run", "string"),
    **{name: (name, "string") for name in _STRINGS},
    **{name: (name, "int64") for name in ("chain", "trial", "seed")},
    **{name: (name, "float64") for name in ("score", "normalized_score", "reward")},
    "completed": ("completed", "bool"),
    **{name: (name, "int64") for name in COUNTS},
    **{f"{name}_tokens": (f"tokens.{name}", "int64") for name in _TOKENS},
    "overruns": ("tokens.overruns", "int64"),
    **{name: (name, "int64") for name in ("peak_prompt_tokens", "limited_prompts")},
    **{f"provider_{name}_tokens": (f"tokens.provider.{name}", "int64") for name in _PROVIDER},
    "provider_requests": ("tokens.provider.requests", "int64"),
    **{name: (name, "float64") for name in ("cost", "question_cost")},
    **{name: (name, "string") for name in ("end_reason", "error", "detail")},
    **{f"budget_{name}": (f"budget.{name}", "int64") for name in _CAPS},
    **{f"budget_{name}": (f"budget.{name}", "float64") for name in ("slack", "episode_cost")},
    "budget_cost_rule": ("budget.cost_rule", "string"),
    **{f"budget_{name}": (f"budget.{name}", "string" if name in WORDS else "int64") for name in STRATEGIES},
    **{name: (name, "int64") for name in sorted({*EpisodeResult.later} - {"spent_cost"})},
    "spent_cost": ("spent_cost", "float64"),
    **{f"{name}_tokens": (f"tokens.{name}", "int64") for name in sorted(Tokens.later)},
    **{name: (name, "json") for name in ("asked", "options", "player_options", "deviations", "versions", *OPTIONAL)},
    **{name: (name, "string") for name in ("state_hash", "play_sha256", *FILES)},
}
"""Every column: the location of its value in a row, and its type. `run` is empty if all rows are of one run."""

LATER: Mapping[str, Any] = {
    **Budget.later,
    **EpisodeResult.later,
    **Tokens.later,
    **Usage.later,
    "observation": Rules().observation,
    **Rules.later,
    **dict.fromkeys((*FILES, *OPTIONAL, "question_cost")),
}
"""Values that a row leaves out, and what they then are."""

PROPERTIES: dict[type, tuple[str, ...]] = {
    CellSummary: ("privileged", "cut_share"),
    Condition: ("label",),
    Drift: ("difference", "ratio"),
    TokenSummary: ("prefix_share",),
}
"""The properties that a summary's JSON has in addition to the fields."""


def flat(row: Row) -> dict[str, Any]:
    """Return a row with the columns of `COLUMNS`."""
    values = {name: _value(row, path.split("."), kind) for name, (path, kind) in COLUMNS.items()}
    return {name: well_formed(value) if isinstance(value, str) else value for name, value in values.items()}


def write_csv(rows: Iterable[Row], path: str | Path) -> None:
    """Write rows as CSV; None is an empty field."""
    Path(path).write_text(rows_to_csv(list(map(flat, rows)), COLUMNS), encoding="utf-8", newline="")


def cell_rows(summary: RunSummary) -> list[dict[str, Any]]:
    """Return a flat row for every cell, with the intervals of its figures."""
    rows = []
    for each in summary.cells:
        row: dict[str, Any] = {"game": each.cell.game, "engine": each.cell.engine, "player": each.cell.player}
        row |= {"condition": summary.label_of(each), "episodes": each.episodes}
        for name in ("score", "normalized_score", "completion", "reward"):
            row |= with_ends(name, getattr(each, name))
        row |= with_ends("tokens", each.episode_tokens) | with_ends("cost", each.episode_cost)
        rows.append({**row, **each.counts})
    return rows


def summary_json(summary: RunSummary) -> dict[str, Any]:
    """Return a summary as JSON."""
    content: dict[str, Any] = plain(summary)
    return content


def _value(row: Any, path: list[str], kind: str) -> Any:
    if path[0] in ("run", *ROWS_LATER):
        row, path = row.get(path[0], LATER.get(path[0])), []
    for name in path:
        row = None if row is None else row[name] if name in row else LATER[name]
    if kind == "json" and row is not None:
        return json.dumps(row, sort_keys=True, ensure_ascii=False)
    return float(row) if kind == "float64" and row is not None else row


def plain(value: Any) -> Any:
    """Return figures as plain data: dataclasses as dictionaries, with the properties of `PROPERTIES`.

    What a cell was `asked` for is left out, since its condition has it, and so is a `width`, which only chooses.
    """
    if is_dataclass(value) and not isinstance(value, type):
        names = [
            *(field.name for field in fields(value) if field.name not in ("asked", "width")),
            *PROPERTIES.get(type(value), ()),
        ]
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    return value
