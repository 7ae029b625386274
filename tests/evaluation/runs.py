"""Rows as a run writes them, from episodes that are really played."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import smartplay_tools as sp


def play_row(
    game: str,
    player: str | sp.Player = "rule",
    trial: int = 0,
    *,
    protocol: str = "tools",
    manual: str = "tool",
    batch: str = "all",
    budget: sp.Budget | None = None,
    engine: str | None = None,
    cost: float | None = None,
    options: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Play an episode and return its row of `results.jsonl`."""
    who = sp.get_player(player, seed=trial) if isinstance(player, str) else player
    rules = {"manual": manual, "batch": batch}
    with sp.Episode(game, seed=trial, budget=budget, engine=engine, **rules, **(options or {})) as episode:
        result = sp.play(episode, who, protocol=protocol)
        asked = {"player": who.name, "protocol": protocol, "trial": trial, **rules, "options": options or {}}
        asked |= {"budget": episode.budget.model_dump(), "cost": cost}
    row = {**result.model_dump(mode="json"), **asked}
    key = hashlib.sha256(json.dumps([game, engine, trial, asked], sort_keys=True).encode()).hexdigest()[:16]
    return json.loads(json.dumps({"key": key, **row}))


def play_rows(game: str, player: str = "rule", trials: int = 5, **asked: Any) -> list[dict[str, Any]]:
    return [play_row(game, player, trial, **asked) for trial in range(trials)]
