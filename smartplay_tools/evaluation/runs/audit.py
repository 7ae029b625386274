"""Auditing the episodes of a run.

An audit replays every episode and compares every row with its record. A replay that is identical bit for bit shows that
the record follows from the game, the budget and the replies. The audit also checks that the row agrees with the record,
that the record is of the planned episode, and that a trial which takes something over began with what the trial before
it left.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.context.strategies import custom
from smartplay_tools.context.tokens import get_tokenizer
from smartplay_tools.context.tokens.tokenizers import named_tokenizers, open_tokenizers, split_rule
from smartplay_tools.episode.config import CellConfig
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, TranscriptError
from smartplay_tools.evaluation.processes import parallel_map, worth
from smartplay_tools.evaluation.run_folder.folder import Manifest, RunFolder
from smartplay_tools.games.specs import IN_FILES as GAMES_IN_FILES, load_game
from smartplay_tools.records.damage import DamageError, damage_named
from smartplay_tools.records.record import Record
from smartplay_tools.records.replays import replay_record
from smartplay_tools.records.resumption import chain_fault
from smartplay_tools.records.rows import LATER, Row, row_of
from smartplay_tools.registry import is_in_file

WORTH_A_PROCESS = 300_000
"""Bytes of records for which another process is started: fewer are usually replayed before it is ready."""


@dataclass(frozen=True)
class EpisodeAudit:
    """The result of the audit of an episode."""

    key: str
    game: str
    differences: tuple[str, ...]
    """One sentence each; empty if everything agrees."""
    not_compared: str | None = None
    """What could not be compared (`Replay.not_compared`)."""
    has_row: bool = True
    has_record: bool = True
    not_replayed: str | None = None
    """Why it was not played again: its game, engine, strategy or tokenizer is not here, or was not named."""


def audit(
    folder: RunFolder,
    workers: int,
    *,
    games: Sequence[str] = (),
    strategies: Sequence[str] = (),
    rows: Sequence[Row] | None = None,
) -> Iterator[EpisodeAudit]:
    """Yield the audit of every episode of a run that is planned or has a record, in the order of completion.

    Those without a row come first, unless they have no record and the run was to end before its planned episodes
    (`Manifest.until`).

    At most `workers` processes replay them, including this one, and only this one if no other knows a game that it has
    registered. `games` and `strategies` are the names of those that are in files; a compactor that is named is called
    again. A tokenizer that does not ship with this package has been named before. Rows are read from the folder unless
    they are given.
    """
    rows, manifest = folder.rows() if rows is None else rows, folder.manifest()
    yield from _without_row(folder, manifest, rows)
    before = {key: folder.transcript(earlier) for key, earlier in manifest.predecessors.items()}
    records = [(folder.transcript(row["key"]), before.get(row["key"]), row) for row in rows]
    processes = worth(workers, (record for record, _, _ in records), WORTH_A_PROCESS)
    named = {"games": games, "strategies": strategies, "tokenizers": named_tokenizers()}
    yield from parallel_map(functools.partial(_audit, named=named), records, processes)


def _without_row(folder: RunFolder, manifest: Manifest, rows: Sequence[Row]) -> Iterator[EpisodeAudit]:
    by_key, finished = {row["key"]: row for row in rows}, folder.finished()
    for episode in manifest.planned:
        if episode.key in by_key:
            continue
        game, has_record = manifest.cells[episode.cell].game, episode.key in finished
        why = "It has no row and no record."
        if has_record:
            why = "It has a record and no row; the run's own command makes it from the record."
        if has_record or manifest.until is None:
            yield EpisodeAudit(episode.key, game, (why,), has_row=False, has_record=has_record)
    for key in sorted(finished - {episode.key for episode in manifest.episodes}):
        yield EpisodeAudit(key, "", ("It has a record and is not in the plan.",))


def import_named(games: Iterable[str], strategies: Iterable[str], cells: Sequence[CellConfig] = ()) -> None:
    """Import the games and strategies in files that a user names for records, which import no file themselves.

    A file that is not that of one of the cells is refused before it is imported.
    """
    for game in games:
        GAMES_IN_FILES.check(game, [cell.game_sha256 for cell in cells])
        load_game(game)
    for strategy in strategies:
        place, _ = custom.parted(strategy)
        if is_in_file(place):
            custom.IN_FILES.check(place, [cell.strategy_sha256 for cell in cells])
        custom.load_strategy(strategy)


def check_tokenizers(names: Iterable[str], cells: Iterable[CellConfig]) -> None:
    """Refuse a tokenizer that a user names for records if none of them was counted with it."""
    asked = {cell.tokenizer_sha256 or split_rule(cell.tokenizer)[0]: cell.tokenizer for cell in cells}
    for name in names:
        sha256 = getattr(get_tokenizer(name), "sha256", None) or split_rule(name)[0]
        if sha256 not in asked:
            theirs = ", ".join(f"{own!r} ({digest})" for digest, own in asked.items())
            raise InvalidArgumentError(
                f"The record was counted with the tokenizer {theirs}, not with {name!r} ({sha256})."
            )


def is_called_again(config: CellConfig, strategies: Iterable[str]) -> bool:
    """Return whether a user has named the strategy of a config, so that a compactor is called again."""
    asked = config.budget.strategy
    return asked is not None and _place(asked) in map(_place, strategies)


def _place(strategy: str) -> str:
    return custom.parted(custom.name_on_record(strategy))[0]


def _audit(given: tuple[Path, Path | None, Row], *, named: Mapping[str, Sequence[str]]) -> EpisodeAudit:
    """Audit a record, with that of the trial before it and its row, in any process."""
    record, before, row = given
    import_named(named["games"], named["strategies"])
    open_tokenizers(named["tokenizers"])
    differences, not_compared, not_replayed = [], None, None
    try:
        read = Record.read(record, checks_fields=False)
        replayed = replay_record(read, calls_compactor=is_called_again(read.config, named["strategies"]))
        differences, not_compared = [*replayed.differences], replayed.not_compared
        with damage_named(record):
            if replayed.complete or not read.is_complete:
                differences += _row_differences(read, row)
            if fault := chain_fault(read, before):
                differences.append(fault)
    except (TranscriptError, DamageError) as error:
        differences = [str(error)]
    except SmartPlayError as error:
        not_replayed = str(error)
    return EpisodeAudit(row["key"], row["game"], tuple(differences), not_compared, not_replayed=not_replayed)


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
