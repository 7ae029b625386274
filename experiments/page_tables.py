"""The tables in the pages of the documentation: each stands between its marks, and its script renews it."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.evaluation.runs.runner import Run

END = "<!-- end -->"


def mark(name: str) -> str:
    """Return the line that begins the table of a name."""
    return f"<!-- table: {name} -->\n"


def publish(page: Path, name: str, written: str) -> None:
    """Put a table between its marks in a page; ValueError if the page does not have them."""
    before, marked, rest = page.read_text(encoding="utf-8").partition(mark(name))
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{page} has no place for the table {name}: a line {mark(name)!r} and, below it, {END!r}.")
    page.write_text(f"{before}{marked}\n{written}\n\n{end}{after}", encoding="utf-8")


def table_row(cells: Iterable[str]) -> str:
    """Return a line of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def interval(estimate: MeanEstimate | None, sign: str = "-") -> str:
    """Return a mean with its interval; without one, whether all its episodes were equal."""
    if estimate is None:
        return "no pairs"
    mean = f"{estimate.mean:{sign}.2f}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{estimate.low:{sign}.2f}, {estimate.high:{sign}.2f}]"


def complete(*arguments: Any, **options: Any) -> Run:
    """Play a run as `evaluate` does, or leave if some of its episodes have no result."""
    done = sp.evaluate(*arguments, **options)
    if not done.complete:
        left = done.planned - len(done.rows)
        sys.exit(f"{left} episodes of {done.folder.path} are not finished; run the command again.")
    return done
