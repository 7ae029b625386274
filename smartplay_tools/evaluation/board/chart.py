"""The picture of a board: the mean of each submission against its tokens an episode, on a logarithmic scale.

It is made of numbers only, which the template writes into an SVG: no text of a stranger becomes markup.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from smartplay_tools.evaluation.board.table import Board
from smartplay_tools.evaluation.quantities import short

WIDTH, HEIGHT = 520, 300
LEFT, RIGHT, TOP, BOTTOM = 48, 40, 14, 40
"""The edges of the plot; a point has a number, whose name is in the list below."""

STEPS, CLOSE_STEPS = (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7)
"""Ticks of a decade, and those of a picture that is narrower than one."""

COLOURS = 6
"""Colours of budgets; further ones begin again."""


@dataclass(frozen=True)
class Point:
    """A submission under one budget."""

    x: float
    y: float
    ends: tuple[float, float] | None
    """Where its interval begins and ends."""
    colour: int
    name: str
    words: str


@dataclass(frozen=True)
class Chart:
    """The places of points and ticks in an SVG of `WIDTH` times `HEIGHT`."""

    points: tuple[Point, ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]


def make_chart(board: Board) -> Chart | None:
    """Return the picture of a board; None if fewer than two submissions have a mean."""
    entries = [(at, group, entry) for at, group in enumerate(board.classes) for entry in group.entries if entry.mean]
    if len(entries) < 2:
        return None
    low = math.log10(min(entry.tokens for _, _, entry in entries)) - 0.1
    high = math.log10(max(entry.tokens for _, _, entry in entries)) + 0.1

    def across(value: float) -> float:
        return round(LEFT + (math.log10(value) - low) / (high - low) * (WIDTH - LEFT - RIGHT), 1)

    tops = [entry.mean.mean if entry.mean.high is None else entry.mean.high for _, _, entry in entries if entry.mean]
    top = max(1.0, *tops)

    def up(value: float) -> float:
        return round(HEIGHT - BOTTOM - max(0.0, value) / top * (HEIGHT - TOP - BOTTOM), 1)

    points = []
    for at, group, entry in entries:
        mean = entry.mean
        assert mean is not None
        ends = None if mean.low is None or mean.high is None else (up(mean.low), up(mean.high))
        words = f"{mean.mean:.2f} with {entry.tokens:,.0f} tokens an episode, {group.name}"
        name = entry.submission.model_name
        points.append(Point(across(entry.tokens), up(mean.mean), ends, at % COLOURS, name, words))
    decades = range(math.floor(low), math.ceil(high) + 1)
    ticks = [step * 10.0**decade for decade in decades for step in (STEPS if high - low > 1 else CLOSE_STEPS)]
    return Chart(
        tuple(points),
        tuple((across(tick), short(tick)) for tick in ticks if low <= math.log10(tick) <= high),
        tuple((up(tick), f"{tick:.2g}") for tick in (0.0, 0.25, 0.5, 0.75, 1.0)),
    )


NAMES = (
    ("-v0", ""),
    ("BanditTwoArmed", "Bandit "),
    ("Fixed", ""),
    ("RockPaperScissor", "RPS "),
    ("Minedojo", "Minecraft "),
)


def short_name(game: str) -> str:
    """Return a game's id in fewer letters, for the head of a column."""
    for long, brief in NAMES:
        game = game.replace(long, brief)
    return game
