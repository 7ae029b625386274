"""The reading of records for a page: each is checked, drawn and packed, which is most of the work of a report."""

from __future__ import annotations

import base64
import functools
import gzip
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.episode.budgets import usual_tool_calls
from smartplay_tools.episode.config import Rules
from smartplay_tools.evaluation.pages.report.drawings import draw, pictures
from smartplay_tools.evaluation.pages.report.episodes import episode_data
from smartplay_tools.evaluation.pages.report.sources import Source
from smartplay_tools.evaluation.run_folder.folder import current_place
from smartplay_tools.games.game_registry import importing_packages
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.damage import DamageError, damage_named
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import COPIED, Row
from smartplay_tools.types import Budget, ResolvedBudget
from smartplay_tools.types.arguments import encoder

PACKED_ONLY = ("head", "tools", "first_observations", "turns", "drawing", "pictures", "traceback", "check")
"""What is needed only when an episode is opened; it takes most of the memory of a long one."""


@dataclass(frozen=True)
class ShownEpisode:
    """An episode in the form that a page needs."""

    facts: dict[str, Any]
    """What the lists and tables of the page say of it."""
    text: str
    """All that the page's script reads of it, as JSON."""
    row: Row | None
    """Its row for the statistics; None if it is not finished."""


def read_episodes(
    sources: Sequence[Source], letter: str, *, plugins: bool = False
) -> tuple[list[ShownEpisode], list[str]]:
    """Return the episodes of a run, in the order of their sources, and a sentence for each damaged record.

    `plugins` says whether games of installed packages are imported.
    """
    shown, damaged = list[ShownEpisode](), list[str]()
    with importing_packages(plugins):
        for source in sources:
            try:
                with damage_named(source.transcript):
                    shown.append(_read(source, letter))
            except DamageError as error:
                damaged.append(str(error))
    return shown, damaged


def _read(source: Source, letter: str) -> ShownEpisode:
    record = Record.read(current_place(source.transcript))
    data = {
        **episode_data(source.key, record, source.facts),
        "drawing": draw(record),
        "pictures": pictures(record),
        "run": letter,
    }
    row = _row(source.key, record.facts, data["result"], source.facts) if data["status"] == "finished" else None
    facts = {name: value for name, value in data.items() if name not in PACKED_ONLY}
    facts["rules"] = rules(facts)
    return ShownEpisode(facts, json_text({**data, "turns": columns(data["turns"])}), row)


def rules(facts: Mapping[str, Any]) -> str:
    """Return a short description of the budget and protocol of an episode."""
    words = [_budget_in_words(json.dumps(facts["budget"]), _usual_calls(facts["game"]))]
    words += [f"{name} {facts[name]}" for name, usual in Rules() if facts[name] != usual]
    words += [f"engine {facts['engine']}"] if facts["engine"] else []
    words += [f"{name} {value}" for name, value in sorted((facts["options"] or {}).items())]
    return ", ".join(words)


@functools.lru_cache(64)
def _budget_in_words(numbers: str, usual_calls: int | None) -> str:
    """What differs from the usual budget; a run has few budgets."""
    usual = Budget(result_tokens=None, tool_calls=usual_calls)
    return ResolvedBudget(**json.loads(numbers)).describe(beside=usual)


def _usual_calls(game: str) -> int | None:
    """The default cap on tool calls of a game; None if the game is not registered here."""
    return usual_tool_calls(GAMES[game].rollout) if game in GAMES else None


def _row(key: str, start: Mapping[str, Any], result: Mapping[str, Any], facts: Mapping[str, Any]) -> Row:
    """The row of a finished episode, also if no run has written one; `start` are its recorded facts."""
    copied = {name: start[name] for name in COPIED} | {"player": start["player"] or "unnamed"}
    return {"key": key, **result, **copied, "trial": facts.get("trial"), "cost": facts.get("cost")}


def columns(rows: list[Any], depth: int = 4) -> Any:
    """Return rows as columns if all of them are objects, and the same of each column; a page is then half as large.

    A column has the numbers of the rows that have this field, None for all, and their values.
    """
    if depth == 0 or not rows or not all(isinstance(row, dict) for row in rows):
        return rows
    made = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        numbers = [number for number, row in enumerate(rows) if name in row]
        values = columns([rows[number][name] for number in numbers], depth - 1)
        made[name] = (numbers if len(numbers) < len(rows) else None, values)
    return {"rows": len(rows), "columns": made}


LEVEL = 5
"""The compression level; higher levels are slower and make a page hardly smaller."""

PACK = 400_000
"""Characters from which a pack is closed: packs make a page smaller, since episodes have texts in common."""

json_text = encoder(separators=(",", ":"))


def pack(text: str) -> str:
    """Return JSON, compressed and in base64, which has no character with a meaning in HTML."""
    # The same run always gives the same page; gzip would otherwise write the time.
    return base64.b64encode(gzip.compress(text.encode("ascii"), LEVEL, mtime=0)).decode("ascii")


def packs(episodes: Iterable[ShownEpisode]) -> list[tuple[list[str], str]]:
    """Return the keys of the episodes of each pack, and the pack: an object of the episodes by key."""
    made: list[tuple[list[str], str]] = []
    keys, members, size = [], [], 0
    for episode in episodes:
        keys.append(episode.facts["key"])
        members.append(f"{json_text(keys[-1])}:{episode.text}")
        size += len(episode.text)
        if size >= PACK:
            made.append((keys, pack(f"{{{','.join(members)}}}")))
            keys, members, size = [], [], 0
    return [*made, (keys, pack(f"{{{','.join(members)}}}"))] if keys else made
