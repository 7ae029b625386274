"""The choice of the episodes that a page holds, where a run has more than a browser opens well.

The tables of the page are always those of the whole run; the choice decides which episodes can be opened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.pages.report.sources import ShownRun, Source
from smartplay_tools.records.record import Record
from smartplay_tools.types import MISTAKES

MOST_EPISODES = 1_000
"""The most episodes of a page if none were chosen."""

MOST_BYTES = 2_000_000_000
"""The most bytes of their records; a page has about a fiftieth of that."""

HOW = "a number (the first trials of every game and player), mistakes, failed, the keys of episodes with commas, or all"
"""What `episodes` may be."""


def choose(runs: Sequence[ShownRun], asked: str | None) -> list[ShownRun]:
    """Return the runs with the sources that the page holds; those that it leaves out keep their rows for the tables.

    `asked` is one of `HOW`. None is all, and an `InvalidArgumentError` if these are too many.
    """
    if asked is None:
        _check_size(runs)
        return list(runs)
    if asked == "all":
        return list(runs)
    chosen = [_choice(run, asked, len(runs)) for run in runs]
    if not any(chosen):
        raise InvalidArgumentError(f"--episodes {asked} chooses no episode; it takes {HOW}.")
    return [_only(run, keys) for run, keys in zip(runs, chosen, strict=True)]


def _check_size(runs: Sequence[ShownRun]) -> None:
    sources = [source for run in runs for source in run.sources.episodes]
    size = sum(source.transcript.stat().st_size for source in sources)
    if len(sources) > MOST_EPISODES or size > MOST_BYTES:
        raise InvalidArgumentError(
            f"A page of {len(sources):,} episodes ({size / 1e6:,.0f} MB of records) would be slow to open; choose "
            f"with --episodes which of them it holds: {HOW}. Its tables are of all episodes in any case."
        )


def _choice(run: ShownRun, asked: str, runs: int) -> set[str]:
    """Return the keys of the chosen episodes of one run."""
    sources = run.sources.episodes
    if asked.isascii() and asked.isdigit():
        # The first trials of all cells, so that the episodes of several runs are still pairs.
        by_trial = sorted(sources, key=lambda source: source.facts.get("trial") or 0)
        return {source.key for source in by_trial[: int(asked) // runs]}
    if asked in KINDS:
        return {source.key for source in sources if KINDS[asked](source)}
    wanted = {name.strip() for name in asked.split(",")}
    return {source.key for source in sources if source.key in wanted or source.transcript.stem in wanted}


def _has_mistakes(source: Source) -> bool:
    result = source.row or Record.head(source.transcript).result_data or {}
    return any(result.get(name) for name in MISTAKES)


def _has_failed(source: Source) -> bool:
    return source.row is None and Record.head(source.transcript).outcome == "failed"


KINDS: dict[str, Callable[[Source], bool]] = {"mistakes": _has_mistakes, "failed": _has_failed}


def _only(run: ShownRun, keys: set[str]) -> ShownRun:
    kept = [source for source in run.sources.episodes if source.key in keys]
    rest = [source for source in run.sources.episodes if source.key not in keys]
    return replace(run, sources=replace(run.sources, episodes=kept, left_out=rest))
