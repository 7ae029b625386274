"""Sources: which episodes a page shows. Run folders, a folder of transcripts, or one transcript.

Episodes are read from their records, which exist from the first event on. The run adds the order of the plan, the trial
and the price. The failed attempts of a run are shown as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.groups import grouped
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import Row


@dataclass(frozen=True)
class Source:
    """An episode: its key in the page, its record, and the facts from its run."""

    key: str
    transcript: Path
    facts: dict[str, Any] = field(default_factory=dict)
    row: Row | None = None
    """The row that its run has written, if the episode is finished."""
    turns: tuple[int, int] | None = None
    """The first and the last turn that the page plays; None for all."""


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
    runs = []
    for letter, path in zip(ascii_uppercase, map(Path, paths), strict=False):
        sources = find_sources(path)
        lettered = [replace(source, key=f"{letter}.{source.key}") for source in sources.episodes]
        runs.append(ShownRun(path, letter, replace(sources, episodes=lettered)))
    if len(runs) < len(paths):
        raise InvalidArgumentError(f"A page shows at most {len(ascii_uppercase)} runs, not {len(paths)}.")
    return runs


def find_sources(path: Path) -> Sources:
    """Return the episodes of a run folder, a folder of transcripts or one transcript."""
    if path.is_file():
        return Sources([Source(path.stem, path)])
    if not path.exists():
        raise InvalidArgumentError(f"There is no {path}; name a run folder or a transcript.")
    if (path / "manifest.json").exists():
        return _run(RunFolder(path))
    episodes = [Source(file.stem, file) for file in sorted(path.glob("*.jsonl")) if Record.head(file).start]
    if not episodes:
        raise InvalidArgumentError(f"{path} contains neither a run nor transcripts; name a folder that does.")
    return Sources(episodes)


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
        sources += [Source(file.stem, file, facts) for file in attempts if Record.head(file).start]
    if not sources:
        raise InvalidArgumentError(f"{folder.path} has no episode to show yet.")
    return Sources(sources, manifest.to_json(), folder.failures(), rows=rows, waiting=waiting)
