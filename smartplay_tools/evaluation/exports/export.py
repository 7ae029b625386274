"""export: the finished episodes of a run as data of a format."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from smartplay_tools.errors import InvalidArgumentError, in_one_line
from smartplay_tools.evaluation.exports.sft import EpisodeSelection
from smartplay_tools.records.damage import DamageError, damage_named, warn_damaged
from smartplay_tools.records.record import Record
from smartplay_tools.registry import Registry

Write = Callable[..., dict[str, int]]
"""Writes episodes into an existing folder, and returns how much of each kind it wrote: `write(episodes, folder)`.

The functions of `WITH_MORE` also take `summaries` and `pictures`.
"""

FORMATS: dict[str, str] = {
    "sft": "smartplay_tools.evaluation.exports.sft:write_replies",
    "sft-chains": "smartplay_tools.evaluation.exports.sft:write_chains",
}
"""The formats: name -> the function that writes it."""

WITH_MORE = ("sft", "sft-chains")
"""The formats that can have rows for prompts for a summary, and pictures as files beside the rows."""

_REGISTRY = Registry("export format", FORMATS)


@dataclass(frozen=True)
class Exported:
    """What was exported."""

    folder: Path
    counts: dict[str, int]
    """How many episodes, and how many rows or logs."""
    left_out: Counter[str]
    """How many episodes were left out, by reason."""


def export(
    source: str | Path,
    out: str | Path,
    format: str = "sft",  # noqa: A002 - the word of the command line
    *,
    summaries: bool = False,
    pictures: bool = False,
    **selection: Any,
) -> Exported:
    """Export the finished episodes of a run's folder, of a folder of records, or of one record.

    `out` is a new folder, in which the data are written. With `summaries`, replies to
    prompts for a summary get rows, too. With `pictures`, episodes whose observations are pictures are exported instead
    of left out, and their pictures are written as files. `selection` are the fields of an `EpisodeSelection`.
    Every prompt is rebuilt from its record and verified; a record that was changed is left out with a `DamageWarning`,
    and a selection without any episode is an `InvalidArgumentError`.
    """
    more = {name: True for name, value in {"summaries": summaries, "pictures": pictures}.items() if value}
    if more and format not in WITH_MORE:
        raise InvalidArgumentError(
            f"{format} has no place for {' and '.join(more)}; {' and '.join(WITH_MORE)} have, so choose one of them or "
            "leave that out."
        )
    write: Write = _REGISTRY[format]
    try:
        chosen = EpisodeSelection(**selection)
    except ValidationError as error:
        raise InvalidArgumentError(f"The selection is invalid: {in_one_line(error)}.") from None
    records, left_out = chosen.choose(Path(source), pictures=pictures)
    if not records:
        why = ", ".join(f"{number} {reason}" for reason, number in left_out.items()) or "there is none"
        raise InvalidArgumentError(f"No finished episode in {source} is selected: {why}.")
    folder = Path(out)
    if folder.exists():
        raise InvalidArgumentError(f"{folder} exists, and data is never overwritten; name a new folder.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as unfinished:
        part = Path(unfinished) / folder.name
        while True:  # again without a record that turns out to be damaged
            part.mkdir()
            begun: list[Path] = []
            try:
                with damage_named(source):
                    counts = write(_read(records, begun), part, **more)
                break
            except DamageError as error:
                records = [record for record in records if record not in begun[-1:]]
                if not records or not begun:
                    raise
                warn_damaged(f"{begun[-1]} is left out. {error}")
                left_out["damaged"] += 1
                shutil.rmtree(part)
        part.rename(folder)
    return Exported(folder, counts, left_out)


def _read(records: Iterable[Path], begun: list[Path]) -> Iterator[Record]:
    """Read one record after the other, keeping of each its path."""
    for record in records:
        begun.append(record)
        yield Record.read(record)
