"""export: the finished episodes of a run as data of a format."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import records_in
from smartplay_tools.records.damage import DamageError, damage_named, warn_damaged
from smartplay_tools.records.record import Record
from smartplay_tools.registry import Registry

FILE = "data.jsonl"

Rows = Callable[..., Iterator[dict[str, Any]]]
"""Yields the rows of an episode: `rows(record, summaries=...)`, those of prompts for a summary if it is told so."""

FORMATS: dict[str, str] = {
    "sft": "smartplay_tools.evaluation.exports.sft:reply_rows",
    "sft-chains": "smartplay_tools.evaluation.exports.sft:chain_rows",
}
"""The formats: name -> the function that yields its rows."""

_REGISTRY = Registry("export format", FORMATS)


@dataclass(frozen=True)
class Exported:
    """What was exported."""

    folder: Path
    counts: dict[str, int]
    """How many episodes and rows, and for `sft-chains` how many replies."""
    left_out: Counter[str]
    """How many episodes were left out, by reason."""


def export(
    source: str | Path,
    out: str | Path,
    format: str = "sft",  # noqa: A002 - the word of the command line
    *,
    summaries: bool = False,
    games: Collection[str] = (),
    players: Collection[str] = (),
    completed: bool = False,
) -> Exported:
    """Export the finished episodes of a run's folder, of a folder of records, or of one record.

    `out` is a new folder, in which the data are written. With `summaries`, replies to prompts for a summary get rows,
    too. `games` and `players` are the only ones that are exported, all if empty; with `completed`, only episodes whose
    game was completed. Every prompt is rebuilt from its record and verified; a record that was changed is left out with
    a `DamageWarning`, and a selection without any episode is an `InvalidArgumentError`.
    """
    rows_of: Rows = _REGISTRY[format]
    for name, chosen in (("games", games), ("players", players)):
        if isinstance(chosen, str):
            raise InvalidArgumentError(f"{name} is a list of names, such as [{chosen!r}], not the text {chosen!r}.")
    records: list[Path] = []
    left_out: Counter[str] = Counter()
    for path, reason in _judged(Path(source), games, players, completed=completed):
        if reason is None:
            records.append(path)
        else:
            left_out[reason] += 1
    if not records:
        why = ", ".join(f"{number} {reason}" for reason, number in left_out.items()) or "there is none"
        raise InvalidArgumentError(f"No finished episode in {source} is selected: {why}.")
    folder = Path(out)
    if folder.exists():
        raise InvalidArgumentError(f"{folder} exists, and data is never overwritten; name a new folder.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    counts = Counter(episodes=0, rows=0)
    with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as unfinished:
        part = Path(unfinished) / folder.name
        part.mkdir()
        with (part / FILE).open("xb") as file:
            for path in records:
                begin, own = file.tell(), Counter(episodes=1)
                try:
                    for replies, line in _lines(path, rows_of, summaries=summaries):
                        own.update(replies, rows=1)
                        file.write(line)
                    counts.update(own)
                except DamageError as error:
                    if path is records[-1] and not counts["episodes"]:
                        raise
                    warn_damaged(f"{path} is left out. {error}")
                    left_out["damaged"] += 1
                    file.seek(begin)
                    file.truncate()
        part.rename(folder)
    return Exported(folder, dict(counts), left_out)


def _judged(
    source: Path, games: Collection[str], players: Collection[str], *, completed: bool
) -> Iterator[tuple[Path, str | None]]:
    """Yield each record with the reason why it is left out, None for one that is exported."""
    for path in records_in(source):
        try:
            record = Record.head(path)
        except TranscriptError as error:
            warn_damaged(error)
            yield path, "damaged"
            continue
        if record.start is None:
            continue  # not the record of an episode: a run's own files are JSON Lines, too
        reasons = {
            record.end_reason: record.outcome != "finished",
            "observations are pictures": record.config.observation != "text",
            "its host managed the context, so its prompts are not recorded": record.config.context == "host",
            "another game": games and record.game not in games,
            "another player": players and record.player not in players,
            "not completed": completed and not (record.result_data or {}).get("completed"),
        }
        yield path, next((reason for reason, holds in reasons.items() if holds), None)


def _lines(path: Path, rows_of: Rows, *, summaries: bool) -> Iterator[tuple[dict[str, int], bytes]]:
    """Yield the replies of each row, where it counts them, and its line; a `DamageError` if the record is damaged."""
    with damage_named(path):  # and not writing, whose errors are others
        for row in rows_of(Record.read(path), summaries=summaries):
            replies = {"replies": row["replies"]} if "replies" in row else {}
            yield replies, f"{json.dumps(row, ensure_ascii=False)}\n".encode()
