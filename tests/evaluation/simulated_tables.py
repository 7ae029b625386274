"""The tables of docs/metrics.md that simulations make.

    python -m tests.evaluation.simulated_tables             # prints them; minutes
    python -m tests.evaluation.simulated_tables --publish   # the same, and they go into the page

The slow tests simulate again and compare with the page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tests.evaluation import simulations
from tests.evaluation.simulations import (
    JOINT_SIZES,
    SIZES,
    WORD_SIZES,
    coverage,
    intervals,
    joint,
    words,
)

PAGE = Path(__file__).parents[2] / "docs" / "metrics.md"

REPETITIONS = 10_000
"""Samples behind a figure of the page."""

NEAR = 0.02
"""How far a share of 2,000 may be from the page's: three standard errors of 90 %, with those of the page."""


def coverages() -> Mapping[str, tuple[float, ...]]:
    """How often the intervals hold."""
    return {name: coverage(*case) for name, case in intervals().items()}


TABLES: Mapping[str, tuple[tuple[str, ...], Callable[[], Mapping[str, tuple[float, ...]]]]] = {
    "coverage": (("scores", *(f"n = {n}" for n in SIZES)), coverages),
    "together": (("all of", *(f"n = {n}" for n in JOINT_SIZES)), joint),
    "words": (
        ("players", *(f"{word}, n = {n}" for n in WORD_SIZES for word in ('"different"', '"equivalent"'))),
        words,
    ),
}
"""The tables of the page: their headings, and their figures by row."""


def table(name: str, figures: Mapping[str, Sequence[float]]) -> str:
    """A table in Markdown, in percent."""
    headings = TABLES[name][0]
    lines = [headings, ("---",) * len(headings)]
    lines += [(row, *(f"{100 * figure:.1f}" for figure in own)) for row, own in figures.items()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def agrees(name: str, row: str, figures: Sequence[float], near: float = NEAR) -> bool:
    """Whether figures are those of the page, but for chance."""
    return all(abs(own - other) <= near for own, other in zip(figures, published(name)[row], strict=True))


def published(name: str) -> Mapping[str, tuple[float, ...]]:
    """The figures of a table as they stand in the page."""
    lines = _marked(name).search(PAGE.read_text(encoding="utf-8"))[2].strip().splitlines()[2:]  # type: ignore[index]
    cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {first: tuple(float(figure) / 100 for figure in others) for first, *others in cells}


def _marked(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- simulation: {name} -->\n)(.*?)(<!-- end -->)", flags=re.DOTALL)


def main() -> None:
    """Print the tables, and put them into the page."""
    simulations.REPETITIONS = REPETITIONS
    text = PAGE.read_text(encoding="utf-8")
    for name, (_, simulate) in TABLES.items():
        made = table(name, simulate())
        print(f"{made}\n", flush=True)
        text = _marked(name).sub(lambda mark: f"{mark[1]}\n{made}\n\n{mark[3]}", text)  # noqa: B023 - used at once
    if "--publish" in sys.argv[1:]:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
