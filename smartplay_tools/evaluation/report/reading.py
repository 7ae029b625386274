"""The reading of records for a page: each is checked, drawn and packed, which is most of the work of a report.

A page of thousands of episodes is read by several processes; what it says does not depend on their number.
"""

from __future__ import annotations

import base64
import gzip
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, repeat
from typing import Any, TypeAlias

from smartplay_tools.episode.config import EpisodeConfig, recorded_facts
from smartplay_tools.errors import SmartPlayError, TranscriptError, in_one_line
from smartplay_tools.evaluation.report.drawings import Drawings
from smartplay_tools.evaluation.report.episodes import episode_data
from smartplay_tools.evaluation.report.sources import Source
from smartplay_tools.evaluation.rows import COPIED, Row
from smartplay_tools.games.registry import importing_packages
from smartplay_tools.games.specs import GAMES
from smartplay_tools.json_text import encoder
from smartplay_tools.transcript.file import read_transcript
from smartplay_tools.types import EpisodeResult

CHUNK = 16
"""Records that a process is handed at a time."""

WORTH_A_PROCESS = 8_000_000
"""Bytes of records for which another process is started: fewer are read before it has imported what it needs."""

PACKED_ONLY = ("head", "tools", "first_observations", "turns", "drawing", "traceback", "check")
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
) -> Iterator[Iterator[ShownEpisode]]:
    """Read the episodes of a run; the value is an iterator over them in the order of their sources.

    At most so many processes read them, this one included, and fewer if there is little to read. The others begin at
    once, this one when the iterator is asked. `plugins` says whether they import games of installed packages; a game
    that only this process knows is not drawn in any other, so it then reads alone.
    """
    chunks = [sources[first : first + CHUNK] for first in range(0, len(sources), CHUNK)]
    read = partial(_read_chunk, letter=letter, plugins=plugins)
    others = min(workers, _size(sources) // WORTH_A_PROCESS) - 1
    if others < 1 or not _others_know_the_games(plugins):
        yield (episode for chunk in chunks for episode in read(chunk))
        return
    pool = ProcessPoolExecutor(others, multiprocessing.get_context("spawn"))
    theirs: list[Future[list[ShownEpisode]]] = []
    try:
        with suppress(BrokenProcessPool):  # the chunks that were handed over before stay in the list
            theirs.extend(pool.submit(read, chunk) for chunk in chunks)
        yield _shared(chunks, read, theirs)
    finally:
        pool.shutdown(cancel_futures=True)


def _shared(
    chunks: Sequence[Sequence[Source]], read: Read, theirs: list[Future[list[ShownEpisode]]]
) -> Iterator[ShownEpisode]:
    """Yield the episodes of all chunks. The other processes begin at the first, this one at the last."""
    ours = [read(chunk) for chunk in reversed(chunks[len(theirs) :])]
    while theirs and theirs[-1].cancel():
        theirs.pop()
        ours.append(read(chunks[len(theirs)]))
    for episodes in chain(map(_found, theirs, chunks, repeat(read)), reversed(ours)):
        yield from episodes


def _found(future: Future[list[ShownEpisode]], chunk: Sequence[Source], read: Read) -> list[ShownEpisode]:
    try:
        return future.result()
    except BrokenProcessPool:  # the others were killed, or could not begin; this process reads on alone
        return read(chunk)


Read: TypeAlias = Callable[[Sequence[Source]], list[ShownEpisode]]


def _size(sources: Sequence[Source]) -> int:
    """The bytes of all records; one that its run has moved meanwhile is missed when it is read."""
    size = 0
    for source in sources:
        with suppress(FileNotFoundError):
            size += source.transcript.stat().st_size
    return size


def _others_know_the_games(plugins: bool) -> bool:
    """Whether another process draws the same games as this one."""
    added = GAMES.added()
    return not added or (plugins and all(map(GAMES.is_declared, added)))


def _read_chunk(sources: Sequence[Source], *, letter: str, plugins: bool) -> list[ShownEpisode]:
    with importing_packages(plugins), Drawings() as drawings:
        return [_read(source, letter, drawings) for source in sources]


def _read(source: Source, letter: str, drawings: Drawings) -> ShownEpisode:
    events = read_transcript(source.transcript)
    try:
        config = EpisodeConfig.from_event(events[0])
        start = recorded_facts(events[0], config)
        data = {
            **episode_data(source.key, start, events, source.facts),
            "drawing": drawings.draw(config, events),
            "run": letter,
        }
        if data["result"] is not None:
            EpisodeResult.model_validate(data["result"])
        row = _row(source.key, start, data["result"], source.facts) if data["status"] == "finished" else None
    except TranscriptError:
        raise
    except (AttributeError, KeyError, TypeError, IndexError, StopIteration, ValueError) as error:
        kind = "" if isinstance(error, SmartPlayError) else f"{type(error).__name__}: "
        what = f"{kind}{in_one_line(error)[:200]}".rstrip(".")
        raise TranscriptError(f"{source.transcript} cannot be shown: {what}.") from error
    facts = {name: value for name, value in data.items() if name not in PACKED_ONLY}
    return ShownEpisode(facts, pack(data), row)


def _row(key: str, start: Mapping[str, Any], result: Mapping[str, Any], facts: Mapping[str, Any]) -> Row:
    """The row of a finished episode, also if no run has written one; `start` are its recorded facts."""
    copied = {name: start[name] for name in COPIED} | {"player": start["player"] or "unnamed"}
    return {"key": key, **result, **copied, "trial": facts.get("trial"), "cost": facts.get("cost")}


def pack(value: Any) -> str:
    """Return JSON, compressed and in base64, which has no character with a meaning in HTML."""
    # The same run always gives the same page; gzip would otherwise write the time.
    plain = _encode(value).encode("ascii")
    return base64.b64encode(gzip.compress(plain, mtime=0)).decode("ascii")


_encode = encoder(separators=(",", ":"))
