"""Rows as a run writes them, from episodes that are played and recorded."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.providers.prices import Price
from smartplay_tools.records import Record
from smartplay_tools.records.rows import row_of


def play_row(
    game: str,
    player: str | sp.Player = "rule",
    trial: int = 0,
    *,
    protocol: str = "tools",
    options: dict[str, Any] | None = None,
    price: Price | None = None,
    **asked: Any,
) -> dict[str, Any]:
    """Play an episode, whose seed is its trial, and return its row of `results.jsonl`."""
    who = sp.get_player(player, seed=trial) if isinstance(player, str) else player
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "record.jsonl"
        with sp.Episode(game, seed=trial, transcript=record, **asked, **(options or {})) as episode:
            sp.play(episode, who, protocol=protocol)
        read = Record.read(record, {} if price is None else {who.name: price})
        return row_of(read, trial) | {"key": read.config.key}


def play_rows(game: str, player: str = "rule", trials: int = 5, **asked: Any) -> list[dict[str, Any]]:
    return [play_row(game, player, trial, **asked) for trial in range(trials)]


def failed_row(row: dict[str, Any], attempt: int = 1) -> dict[str, Any]:
    """Return the row of `RunFolder.failures` for an attempt, from the row of an episode that ended in an exception."""
    names = ("key", "end_reason", "error", "game", "player", "seed")
    return {**{name: row[name] for name in names}, "attempt": attempt}


def under_way(folder: Path, key: str, count: int | None = None) -> tuple[list[str], Path]:
    """Leave the first lines of an episode's record, or half of them, as while it is played or when it was killed.

    Returns all lines of the record, and the path of what is left.
    """
    finished, left = folder / "episodes" / f"{key}.jsonl", folder / "running" / f"{key}.1.jsonl"
    lines = finished.read_text().splitlines(keepends=True)
    count = len(lines) // 2 if count is None else count
    left.write_text("".join(lines[:count]) + lines[count][:30])
    finished.unlink()
    rows = (folder / "results.jsonl").read_text().splitlines(keepends=True)
    (folder / "results.jsonl").write_text("".join(row for row in rows if key not in row))
    return lines, left
