"""The tables in the pages of the documentation: each stands between its marks, and its script renews it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.evaluation.analysis.windows import WindowComparison
from smartplay_tools.evaluation.runs.runner import Run

END = "<!-- end -->"

REPEAT = sp.GAMES["popgym-RepeatPreviousEasy-v0"]


def repeat_previous(k: int, decks: int = 1) -> str:
    """Register RepeatPrevious with this `k`, which needs k - 1 past steps; return its id."""
    steps = 52 * decks - 1
    facts: dict[str, Any] = {"kwargs": {"decks": decks, "k": k}, "memory": k - 1, "worst_step": -1 / (52 * decks - k)}
    facts |= {"history": steps, "rollout": steps}
    return sp.register(replace(REPEAT, id=f"RepeatPrevious{k}-v0", **facts)).id


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


def show(page: Path, name: str, written: str, *, publishes: bool) -> None:
    """Print a table, and put it into a page if it is to be published."""
    print(written, "\n", flush=True)
    if publishes:
        publish(page, name, written)


def table_row(cells: Iterable[str]) -> str:
    """Return a line of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def markdown_table(headings: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join(map(table_row, [headings, ["---"] * len(headings), *rows]))


Column = tuple[str, Callable[[WindowComparison], str]]
"""A heading, and what it shows of a comparison."""


def comparison_table(columns: Sequence[Column], comparisons: Iterable[WindowComparison]) -> str:
    """Return a table in Markdown with a line for each comparison."""
    return markdown_table([heading for heading, _ in columns], ([show(c) for _, show in columns] for c in comparisons))


def interval(estimate: MeanEstimate | None, sign: str = "-") -> str:
    """Return a mean with its interval; without one, whether all its episodes were equal.

    A difference, whose `sign` is "+", that is the same in all pairs and not 0 has the p value of the sign test instead.
    """
    if estimate is None:
        return "no pairs"
    digits = ",.0f" if max(abs(estimate.mean), abs(estimate.high or 0)) >= 100 else ",.2f"
    mean = f"{estimate.mean:{sign}{digits}}"
    if sign == "+" and estimate.sign_p is not None:
        return f"{mean} in all {estimate.episodes}, p {estimate.sign_p:.1g}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{estimate.low:{sign}{digits}}, {estimate.high:{sign}{digits}}]"


def arguments(description: str | None, out: str) -> argparse.ArgumentParser:
    """Return a parser of what every experiment takes: the folder of its runs, and whether to publish."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(out), help="the folder of the runs")
    parser.add_argument("--publish", action="store_true", help="put tables and figures into the documentation")
    return parser


def complete(*arguments: Any, **options: Any) -> Run:
    """Play a run as `evaluate` does, or leave if some of its episodes have no result."""
    done = sp.evaluate(*arguments, **options)
    if not done.complete:
        left = done.planned - len(done.rows)
        sys.exit(f"{left} episodes of {done.folder.path} are not finished; run the command again.")
    return done
