"""Sources: which episodes a page shows. Run folders, a folder of transcripts, or one transcript.

Episodes are read from their records, which exist from the first event on. The run adds the order of the plan, the trial
and the price. The failed attempts of a run are shown as well.

The choice of the episodes that a page holds, where a run has more than a browser opens well.

The tables of the page are always those of the whole run; the choice decides which episodes can be opened.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, SmartPlayWarning, TranscriptError
from smartplay_tools.evaluation.run_folder.folder import RunFolder, read_each
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row
from smartplay_tools.types.arguments import well_formed
from smartplay_tools.types.groups import grouped


@dataclass(frozen=True)
class Source:
    """An episode: its key in the page, its record, and the facts from its run."""

    key: str
    transcript: Path
    facts: dict[str, Any] = field(default_factory=dict)
    row: Row | None = None
    """The row that its run has written, if the episode is finished."""


@dataclass(frozen=True)
class Sources:
    """The episodes of a page, in their order, and the other facts about the run."""

    episodes: Sequence[Source]
    manifest: dict[str, Any] = field(default_factory=dict)
    failures: Sequence[dict[str, Any]] | None = None
    """The failed attempts of a run; None without a run."""
    left_out: Sequence[Source] = ()
    """Episodes that the page does not hold; its tables count those that have a row."""
    rows: Sequence[Row] = ()
    """The rows of a run."""
    waiting: int = 0
    """The number of planned episodes that have not been attempted yet."""


@dataclass(frozen=True)
class ShownRun:
    """One of the runs of a page."""

    path: Path
    letter: str
    """What it is called beside others, "A" and so on; empty for a run by itself."""
    sources: Sources


def find_runs(paths: Sequence[str | Path]) -> list[ShownRun]:
    """Return the runs of a page. Of several, the keys of episodes begin with the run's letter."""
    if not paths:
        raise InvalidArgumentError("Name at least one run.")
    if len(paths) == 1:
        return [ShownRun(Path(paths[0]), "", find_sources(Path(paths[0])))]
    if len({Path(path).resolve() for path in paths}) < len(paths):
        raise InvalidArgumentError("The same run is named twice; name every run once.")
    if len(paths) > len(ascii_uppercase):
        raise InvalidArgumentError(f"A page shows at most {len(ascii_uppercase)} runs, not {len(paths)}.")
    letters = {Path(path): letter for letter, path in zip(ascii_uppercase, paths, strict=False)}

    def lettered(path: Path) -> ShownRun:
        letter, sources = letters[path], find_sources(path)
        episodes = [replace(source, key=f"{letter}.{source.key}") for source in sources.episodes]
        return ShownRun(path, letter, replace(sources, episodes=episodes))

    return read_each([*letters], lettered)


def find_sources(path: Path) -> Sources:
    """Return the episodes of a run folder, a folder of transcripts or one transcript."""
    if path.is_file():
        return Sources([Source(well_formed(path.stem), path)])
    if not path.exists():
        raise InvalidArgumentError(f"There is no {path}; name a run folder or a transcript.")
    if (path / "manifest.json").exists():
        return _run(RunFolder(path))
    episodes = [Source(well_formed(file.stem), file) for file in sorted(path.glob("*.jsonl")) if _has_begun(file)]
    if not episodes:
        raise InvalidArgumentError(f"{path} contains neither a run nor transcripts; name a folder that does.")
    return Sources(episodes)


def _has_begun(record: Path) -> bool:
    """Whether a file is the record of an episode; a damaged one is, as reading it will say."""
    try:
        return Record.head(record).start is not None
    except TranscriptError:
        return True


def _run(folder: RunFolder) -> Sources:
    manifest, rows = folder.manifest(), folder.rows()
    row_of = {row["key"]: row for row in rows}
    attempts_at = grouped((*folder.attempts(), *folder.running()), lambda file: file.name.partition(".")[0])
    there = folder.finished()
    sources: list[Source] = []
    waiting = 0
    for planned in manifest.episodes:
        key = planned.key
        finished = [folder.transcript(key)] if key in there else []
        attempts = attempts_at.get(key, [])
        waiting += not finished and not attempts
        facts = {"trial": planned.trial}
        # The cost is that of the finished attempt; earlier attempts were charged separately.
        sources += [
            Source(key, file, {**facts, "cost": row_of.get(key, {}).get("cost")}, row_of.get(key)) for file in finished
        ]
        facts["finished_later"] = bool(finished)
        sources += [Source(file.stem, file, facts) for file in attempts if _has_begun(file)]
    if not sources:
        raise InvalidArgumentError(f"{folder.path} has no episode to show yet.")
    return Sources(sources, manifest.to_json(), folder.failures(), rows=rows, waiting=waiting)


MOST_EPISODES = 1_000
"""The most episodes of a page."""

MOST_BYTES = 40_000_000
"""The most bytes of their records: such a page is written in some ten seconds, and is 3 MB large."""


def that_open_well(runs: Sequence[ShownRun]) -> list[ShownRun]:
    """Return the runs with the sources that the page holds: all or, with a `SmartPlayWarning`, the first trials.

    Those that it leaves out keep their rows for the tables.
    """
    held = size = 0
    for number, episodes in enumerate(zip_longest(*map(_by_trial, runs))):
        there = [source.transcript for source in episodes if source]
        size += sum(record.lstat().st_size for record in there)
        if held and (held + len(there) > MOST_EPISODES or size > MOST_BYTES):
            count = sum(len(run.sources.episodes) for run in runs)
            why = (
                f"The page holds {held:,} of {count:,} episodes, the first trials of every game and player, because "
                "more would be slow to open; its tables are of all, and `view` shows each."
            )
            warnings.warn(why, SmartPlayWarning, stacklevel=2)
            return [_only(run, {source.key for source in _by_trial(run)[:number]}) for run in runs]
        held += len(there)
    return list(runs)


def _by_trial(run: ShownRun) -> list[Source]:
    """Return the episodes of a run by their trials, so that the first episodes of several runs are pairs."""
    return sorted(run.sources.episodes, key=lambda source: source.facts.get("trial") or 0)


def _only(run: ShownRun, keys: set[str]) -> ShownRun:
    kept = [source for source in run.sources.episodes if source.key in keys]
    rest = [source for source in run.sources.episodes if source.key not in keys]
    return replace(run, sources=replace(run.sources, episodes=kept, left_out=rest))
