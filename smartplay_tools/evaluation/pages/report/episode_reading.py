"""The reading of records for a page: each is checked, drawn and packed, which is most of the work of a report.

A page of thousands of episodes is read by several processes; what it says does not depend on their number.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

from smartplay_tools.errors import DamageError, TranscriptError, damage_named
from smartplay_tools.evaluation.pages.report.drawings import Drawings
from smartplay_tools.evaluation.pages.report.episodes import episode_data, excerpt
from smartplay_tools.evaluation.pages.report.sources import Source
from smartplay_tools.evaluation.pages.report.summary_tables import rules
from smartplay_tools.evaluation.processes import parallel_map, worth
from smartplay_tools.evaluation.run_folder.folder import as_list, read_notes
from smartplay_tools.games.game_registry import importing_packages
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import COPIED, Row
from smartplay_tools.types.arguments import encoder

WORTH_A_PROCESS = 8_000_000
"""Bytes of records for which another process is started: fewer are read before it has imported what it needs."""

PACKED_ONLY = ("head", "tools", "first_observations", "turns", "drawing", "pictures", "traceback", "check")
"""What is needed only when an episode is opened; it takes most of the memory of a long one."""


@dataclass(frozen=True)
class ShownEpisode:
    """An episode in the form that a page needs."""

    facts: dict[str, Any]
    """What the lists and tables of the page say of it."""
    packed: str
    """All that the page's script reads of it."""
    row: Row | None
    """Its row for the statistics; None if it is not finished."""


@contextmanager
def reading(
    sources: Sequence[Source], letter: str, *, workers: int = 1, plugins: bool = False
) -> Iterator[Callable[[], tuple[list[ShownEpisode], list[str]]]]:
    """Read the episodes of a run; return a function that returns them, in the order of their sources.

    It also returns a sentence for each damaged record, which is left out.

    At most `workers` processes read them, including this one, and fewer if there is little to read. The others begin at
    once, this one when that function is called. `plugins` says whether they import games of installed packages; a game
    that only this process knows cannot be drawn elsewhere, so this process then reads alone.
    """
    processes = worth(workers, (source.transcript for source in sources), WORTH_A_PROCESS, plugins=plugins)
    with parallel_map(partial(_read_chunk, letter=letter, plugins=plugins), sources, processes) as chunks:
        yield lambda: _parted([each for _, part in sorted(chunks, key=itemgetter(0)) for each in part])


def _parted(read: Sequence[ShownEpisode | str]) -> tuple[list[ShownEpisode], list[str]]:
    return [each for each in read if not isinstance(each, str)], [each for each in read if isinstance(each, str)]


def _read_chunk(sources: Sequence[Source], *, letter: str, plugins: bool) -> list[ShownEpisode | str]:
    with importing_packages(plugins), Drawings() as drawings:
        return [_read_or_fault(source, letter, drawings) for source in sources]


def _read_or_fault(source: Source, letter: str, drawings: Drawings) -> ShownEpisode | str:
    try:
        with damage_named(source.transcript):
            return _read(source, letter, drawings)
    except (DamageError, TranscriptError) as error:
        return str(error)


def _read(source: Source, letter: str, drawings: Drawings) -> ShownEpisode:
    record = Record.read(source.transcript)
    data = {
        **episode_data(source.key, record, source.facts),
        "drawing": drawings.draw(record),
        "pictures": drawings.pictures(record),
        "run": letter,
        "notes": as_list(read_notes(source.transcript)),
    }
    if source.turns is not None:
        data = excerpt(data, *source.turns)
    row = _row(source.key, record.facts, data["result"], source.facts) if data["status"] == "finished" else None
    facts = {name: value for name, value in data.items() if name not in PACKED_ONLY}
    facts["rules"] = rules(facts)
    return ShownEpisode(facts, pack(data), row)


def _row(key: str, start: Mapping[str, Any], result: Mapping[str, Any], facts: Mapping[str, Any]) -> Row:
    """The row of a finished episode, also if no run has written one; `start` are its recorded facts."""
    copied = {name: start[name] for name in COPIED} | {"player": start["player"] or "unnamed"}
    return {"key": key, **result, **copied, "trial": facts.get("trial"), "cost": facts.get("cost")}


LEVEL = 5
"""The compression level; higher levels are slower and make a page hardly smaller."""


def pack(value: Any) -> str:
    """Return JSON, compressed and in base64, which has no character with a meaning in HTML."""
    # The same run always gives the same page; gzip would otherwise write the time.
    plain = _encode(value).encode("ascii")
    return base64.b64encode(gzip.compress(plain, LEVEL, mtime=0)).decode("ascii")


_encode = encoder(separators=(",", ":"))
