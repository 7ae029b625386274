"""The audit of a run: every episode is replayed, and every row compared with its record.

A replay that is identical bit for bit shows that the record follows from the game, the budget and the replies. The
audit also checks that the row agrees with the record, that the record is of the planned episode, and that a trial which
takes something over began with what the trial before it left.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.context.strategies import load_strategy
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.parallel import parallel_map, worth
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.chains import chain_fault
from smartplay_tools.records.record import Record
from smartplay_tools.records.replays import replay_record
from smartplay_tools.records.rows import LATER, Row, row_of

WORTH_A_PROCESS = 300_000
"""Bytes of records for which another process is started: fewer are usually replayed before it is ready."""


@dataclass(frozen=True)
class EpisodeAudit:
    """The result of the audit of an episode."""

    key: str
    game: str
    differences: tuple[str, ...]
    """One sentence each; empty if everything agrees."""


def audit(
    folder: RunFolder,
    workers: int,
    tokenizer: str | None = None,
    *,
    strategy: str | None = None,
    rows: Sequence[Row] | None = None,
) -> Iterator[EpisodeAudit]:
    """Yield the audit of every finished episode of a run, in the order of completion.

    At most `workers` processes replay them, including this one, and only this one if no other knows a game that it has
    registered. `tokenizer` names the records' tokenizer if its file was moved, `strategy` is the
    name of their strategy, if that is in a file. Rows are read from the folder unless they are given.
    """
    rows = folder.rows() if rows is None else rows
    before = {key: folder.transcript(earlier) for key, earlier in folder.manifest().predecessors.items()}
    records = [(folder.transcript(row["key"]), before.get(row["key"]), row) for row in rows]
    processes = worth(workers, (record for record, _, _ in records), WORTH_A_PROCESS)
    work = functools.partial(_audit_all, tokenizer=tokenizer, strategy=strategy)
    with parallel_map(work, records, processes) as results:
        for _, findings in results:
            yield from findings


def _audit_all(
    records: Sequence[tuple[Path, Path | None, Row]], *, tokenizer: str | None, strategy: str | None
) -> list[EpisodeAudit]:
    if strategy is not None:
        load_strategy(strategy)
    return [_audit(record, before, row, tokenizer=tokenizer) for record, before, row in records]


def _audit(record: Path, before: Path | None, row: Row, *, tokenizer: str | None) -> EpisodeAudit:
    try:
        read = Record.read(record)
        replayed = replay_record(read, tokenizer=tokenizer)
        differences = [*replayed.differences]
        if replayed.complete or not read.is_complete:
            differences += _row_differences(read, row)
        if fault := chain_fault(read, before):
            differences.append(fault)
    except SmartPlayError as error:
        differences = [str(error)]
    return EpisodeAudit(row["key"], row["game"], tuple(differences))


def _row_differences(record: Record, row: Row) -> Iterator[str]:
    if not record.is_complete:
        yield "The record is incomplete: it has no end event."
        return
    key = record.config.key
    if key != row["key"]:
        yield f"The record is of another episode, {key}."
    for name, value in row_of(record, row["trial"]).items():
        # The cost follows from the run's prices, which are in the manifest.
        unsaid = name in LATER and name not in row
        if name not in ("cost", "key") and not unsaid and row.get(name) != value:
            yield f"The field {name} is {row.get(name)!r} in the row, {value!r} in the record."
