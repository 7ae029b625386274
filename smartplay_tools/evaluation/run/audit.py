"""The audit of a run: every episode is replayed, and every row compared with its record.

A replay that is identical bit for bit shows that the record follows from the game, the budget and the replies. The
audit also checks that the row agrees with the record, and that the record is of the planned episode.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.folder import RunFolder
from smartplay_tools.evaluation.rows import Row, row_of
from smartplay_tools.evaluation.sharing import sharing, worth
from smartplay_tools.replays.replay import replay_events
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.file import read_written

WORTH_A_PROCESS = 300_000
"""Bytes of records for which another process is started: fewer are mostly replayed before it is ready."""


@dataclass(frozen=True)
class Finding:
    """The result of the audit of an episode."""

    key: str
    game: str
    differences: tuple[str, ...]
    """One sentence each; empty if everything agrees."""


def audit(
    folder: RunFolder, workers: int, tokenizer: str | None = None, *, rows: Sequence[Row] | None = None
) -> Iterator[Finding]:
    """Yield a finding for every finished episode of a run, as they come.

    At most so many `workers` replay them, this process included, and it alone if no other knows a game that it has
    registered. `tokenizer` names the records' tokenizer if its file was moved; rows are read from the folder unless
    they are given.
    """
    rows = folder.rows() if rows is None else rows
    records = [(folder.transcript(row["key"]), row) for row in rows]
    processes = worth(workers, (record for record, _ in records), WORTH_A_PROCESS)
    with sharing(functools.partial(_audit_all, tokenizer=tokenizer), records, processes) as found:
        for _, findings in found:
            yield from findings


def _audit_all(records: Sequence[tuple[Path, Row]], *, tokenizer: str | None) -> list[Finding]:
    return [_audit(record, row, tokenizer=tokenizer) for record, row in records]


def _audit(record: Path, row: Row, *, tokenizer: str | None) -> Finding:
    try:
        events, written = read_written(record)
        config = EpisodeConfig.from_event(events[0])
        found = replay_events(events, written, name=record, tokenizer=tokenizer, config=config)
        differences = [*found.differences, *_row_differences(events, config, row)]
    except SmartPlayError as error:
        differences = [str(error)]
    return Finding(row["key"], row["game"], tuple(differences))


def _row_differences(events: Sequence[Event], config: EpisodeConfig, row: Row) -> Iterator[str]:
    if not any(event["event"] == "end" for event in events):
        yield "The record is incomplete: it has no end event."
        return
    key = config.key
    if key != row["key"]:
        yield f"The record is of another episode, {key}."
    for name, value in row_of(events, key, row["trial"], config=config).items():
        # The cost follows from the run's prices, which are in the manifest.
        if name not in ("cost", "key") and row.get(name) != value:
            yield f"The field {name} is {row.get(name)!r} in the row, {value!r} in the record."
