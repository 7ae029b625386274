"""Reading the folder of a run: its manifest, and its finished, running and failed episodes.

    manifest.json         the plan, caps, prices; written before the first episode
    episodes/KEY.jsonl    the records of finished episodes
    attempts/KEY.N.jsonl  the records of attempts without a result: failed, interrupted, or paused by a cap of the run
    running/KEY.N.jsonl   the records that are being written now
    results.jsonl         a row for every finished episode; no times in it
    timings.jsonl         a row for every attempt: wall time, processor time of the game, why it began again

Rows can always be computed again from the records. Reading works at any time, also during the run. Only
`evaluation.runs` writes to the folder.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, in_one_line
from smartplay_tools.files.lines import parse_json
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.damage import DamageError, damage_left_out, damage_named
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row, Timing, read_rows

__all__ = ["RunFolder"]

T = TypeVar("T")

FORMAT: Literal[1] = 1
"""The version of the layout of a run's folder; folders with another version are refused."""


def shard_of(digest: str, chain: int, count: int) -> int:
    """Return the number (from 1) of the shard, of `count`, that plays a chain of the cell with this digest.

    Without `carry` every trial is its own chain (`CellConfig.chain_of`). The shard depends only on the cell and
    the chain, so an episode stays in its shard when a run is extended.
    """
    return (int(digest, 16) + chain) % count + 1


def _price(value: Any) -> Price:
    try:
        return value if isinstance(value, Price) else Price.from_json(value)
    except (AttributeError, KeyError, TypeError):
        raise ValueError("it is not a price") from None


@dataclass(frozen=True, slots=True)
class ManifestEpisode:
    """An episode in a manifest; `cell` is the number of its cell there. There may be a million of them."""

    key: Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
    """It is part of the names of files."""
    cell: Annotated[int, Field(ge=0)]
    trial: Annotated[int, Field(ge=0)]
    seed: Annotated[int, Field(ge=0, lt=2**31)]


class Manifest(BaseModel):
    """The content of `manifest.json`. All shards of a run have the whole plan."""

    model_config = ConfigDict(frozen=True)

    format: Literal[1] = FORMAT
    seed: Annotated[int, Field(ge=0)]
    cells: tuple[CellConfig, ...]
    episodes: tuple[ManifestEpisode, ...]
    shard: tuple[int, int] | None
    """The part of the run that this folder is for, as (i, n); None for the whole run."""
    caps: Mapping[str, Any] = Field(default_factory=dict)
    """`tokens` and `cost`, each None if there is no cap."""
    prices: dict[str, Annotated[Price, BeforeValidator(_price), PlainSerializer(Price.to_json)]]
    """By player."""
    versions: dict[str, str] = Field(default_factory=dict)
    repeats: int | None = None
    """How often each world is played, one trial after the other; None for once."""
    run_file: str | None = None
    """In runs of earlier versions: the text of the file with the arguments of `eval`."""
    game_files: dict[str, str] | None = None
    """The paths of the files of games, by the sha256 of the file; None without such a game."""
    strategy_files: dict[str, str] | None = None
    """The paths of the files of custom strategies, by the sha256 of the file; None without such a strategy."""
    until: Mapping[str, Any] | None = None
    """In runs of earlier versions: the margin at which their comparisons were decided, which ended them early."""

    @field_validator("episodes")
    @classmethod
    def _have_listed_cells(
        cls, episodes: tuple[ManifestEpisode, ...], info: ValidationInfo
    ) -> tuple[ManifestEpisode, ...]:
        count = len(info.data.get("cells", ()))
        for episode in episodes:
            if episode.cell >= count:
                raise ValueError(f"{episode.key} has the cell {episode.cell}, which is not listed")
        return episodes

    @property
    def planned(self) -> tuple[ManifestEpisode, ...]:
        """The episodes of this part of the run."""
        if self.shard is None:
            return self.episodes
        number, count = self.shard
        digests, cells = [cell.digest for cell in self.cells], self.cells
        return tuple(
            e for e in self.episodes if shard_of(digests[e.cell], cells[e.cell].chain_of(e.trial), count) == number
        )

    @cached_property
    def predecessors(self) -> dict[str, str]:
        """The key of the trial before it, by the key of every episode that takes something over (`Rules.carry`)."""
        carrying = [cell.carry is not None for cell in self.cells]
        if not any(carrying):
            return {}
        chained = [episode for episode in self.episodes if carrying[episode.cell]]
        keys = {(episode.cell, episode.trial): episode.key for episode in chained}
        before: dict[str, str] = {}
        for episode in chained:
            cell, earlier = self.cells[episode.cell], (episode.cell, episode.trial - 1)
            if earlier in keys and cell.chain_of(episode.trial - 1) == cell.chain_of(episode.trial):
                before[episode.key] = keys[earlier]
        return before

    def to_json(self) -> dict[str, Any]:
        """Return the manifest as plain data; what there is not is left out."""
        optional = ("repeats", "run_file", "game_files", "strategy_files", "until")
        return self.model_dump(mode="json", exclude={name for name in optional if getattr(self, name) is None})


class RunFolder:
    """A run on disk."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def manifest(self) -> Manifest:
        """Return the manifest; raise `InvalidArgumentError` if the folder does not contain a run."""
        path = self.path / "manifest.json"
        try:
            value = parse_json(path.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            raise InvalidArgumentError(f"{self.path} is not the folder of a run: it has no {path.name}.") from None
        except OSError as error:
            raise DamageError(f"{path} cannot be read: {error.strerror}.") from None
        except (ValueError, RecursionError):
            raise DamageError(f"{path} is not JSON.") from None
        written = value.get("format") if isinstance(value, dict) else None
        if written != FORMAT:
            raise DamageError(f"{self.path} was written in format {written}; this version reads format {FORMAT}.")
        try:
            return Manifest.model_validate(value)
        except ValidationError as error:
            raise DamageError(f"{path} is damaged: {in_one_line(error)}.") from None

    def rows(self) -> list[Row]:
        """Return the rows of the finished episodes, in the order of the plan."""
        order = {episode.key: place for place, episode in enumerate(self.manifest().episodes)}
        rows = {row["key"]: row for row in read_rows(self.path / "results.jsonl") if row["key"] in order}
        return sorted(rows.values(), key=lambda row: order[row["key"]])

    def failures(self) -> list[Row]:
        """Return a row for every attempt without a result: `key, attempt, end_reason, error, game, player, seed`.

        The end reason is that of the episode; "exception" if there was no episode yet, "interrupted" if the run was
        stopped or killed, "run_budget" if a cap of the run paused it, "damaged" if its record cannot be read.
        """
        return list(map(_failure, self.attempts()))

    def first_reply(self, row: Row) -> str:
        """Return the text of the first reply in a finished episode, "" if its record is not here."""
        path = self.transcript(row["key"])
        with damage_left_out(path):
            return Record.read(path).first_reply if path.exists() else ""
        return ""

    def attempts(self) -> list[Path]:
        """Return the records of attempts without a result, by key and then in their order."""
        return sorted(filter(_names_attempt, (self.path / "attempts").glob("*.jsonl")), key=_place)

    def running(self) -> list[Path]:
        """Return the records that are being written now, or were when the run was killed."""
        return sorted(filter(_names_attempt, (self.path / "running").glob("*.jsonl")), key=_place)

    def timings(self) -> list[Row]:
        """Return a row for every attempt at an episode, in the order of completion."""
        return list(read_rows(self.path / "timings.jsonl", Timing))

    def beginnings(self) -> Counter[str]:
        """Return how many attempts began their episode again instead of continuing an earlier one, by the reason."""
        return Counter(reason_of(str(row["began_again"])) for row in self.timings() if "began_again" in row)

    def transcript(self, key: str) -> Path:
        """Return the path of a finished episode's record."""
        return self.path / "episodes" / f"{key}.jsonl"

    def finished(self) -> set[str]:
        """Return the keys of the episodes that have the record of a finished attempt."""
        with suppress(FileNotFoundError, NotADirectoryError), os.scandir(self.path / "episodes") as files:
            return {file.name.removesuffix(".jsonl") for file in files if file.name.endswith(".jsonl")}
        return set()

    def records(self) -> Iterator[Path]:
        """Yield the records of all attempts: finished, without a result, and running."""
        yield from sorted((self.path / "episodes").glob("*.jsonl"))
        yield from self.attempts()
        yield from self.running()


def current_place(record: Path) -> Path:
    """Return where a record is now: one that was being written is moved when its attempt is over."""
    if record.parent.name != "running" or record.exists():
        return record
    run, key = record.parents[1], record.name.partition(".")[0]
    moved = run / "episodes" / f"{key}.jsonl", run / "attempts" / record.name
    return next((place for place in moved if place.exists()), record)


def reason_of(why: str) -> str:
    """Return the beginning of what an error says, which episodes share: up to the first colon or full stop."""
    return re.split(r"[.:](?: |$)", why, maxsplit=1)[0]


def read_each(folders: Sequence[Path], read: Callable[[Path], T]) -> list[T]:
    """Return what is read of folders; of several, a damaged one is left out with a `DamageWarning`."""
    if len(folders) == 1:
        with damage_named(folders[0]):
            return [read(folders[0])]
    parts: list[T] = []
    for folder in folders:
        with damage_left_out(folder):
            parts.append(read(folder))
    if not parts:
        raise DamageError("None of these folders can be read.")
    return parts


def _failure(path: Path) -> Row:
    """Return the row of an attempt without a result."""
    try:
        with damage_named(path):
            record = Record.head(path)
            ended = {"end_reason": record.end_reason, "error": record.error}
            facts = {name: getattr(record.config, name) if record.start else None for name in ABOUT}
            return {"key": record.key, "attempt": record.attempt, **ended, **facts}
    except SmartPlayError as error:
        key, attempt = _place(path)
        return {"key": key, "attempt": attempt, "end_reason": DAMAGED, "error": str(error), **dict.fromkeys(ABOUT)}


ABOUT = ("game", "player", "seed")

DAMAGED = "damaged"
"""The end reason of an attempt whose record cannot be read."""

_ATTEMPT = re.compile(r"[0-9a-f]{16}\.[0-9]{1,6}\.jsonl")


def _names_attempt(record: Path) -> bool:
    return _ATTEMPT.fullmatch(record.name) is not None


def _place(record: Path) -> tuple[str, int]:
    key, _, attempt = record.stem.partition(".")
    return key, int(attempt or 0)


def records_in(source: Path) -> Iterator[Path]:
    """Yield the records in a run's folder (the finished episodes), a folder of records, or a file."""
    if source.is_file():
        yield source
    elif (source / "manifest.json").exists():
        yield from sorted((source / "episodes").glob("*.jsonl"))
    elif source.is_dir():
        yield from sorted(source.glob("*.jsonl"))
    else:
        raise InvalidArgumentError(f"There is no run and no record at {source}.")


def replace_file(path: Path, text: str) -> None:
    """Write a file in one operation: who reads it meanwhile finds the old text or the new one."""
    part = path.with_name(f".{path.name}.part")
    part.write_text(text, encoding="utf-8", newline="\n")
    part.replace(path)
