"""The ruler: how much must be kept before a player that only reads can play, for games that need more and more of it.

    python experiments/ruler.py --out runs/ruler     # plays it; needs the extra popgym

The player `reader` plays rightly from what its prompt shows, and guesses otherwise. Each game is played under every
history without a cap, and under every cap without a limit on the history, on the same seeds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from page_tables import (
    Experiment,
    arguments,
    complete,
    in_steps,
    interval,
    is_playable,
    markdown_table,
    mean_score,
    repeat_previous,
)

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_estimates,
    figure,
    legend_below,
    mark_notes,
    mark_points,
    panels,
    sample_note,
)
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAYER = "reader"
SEED, TRIALS = 1997, 10
GAMES = {repeat_previous(k): f"RepeatPrevious, k = {k}" for k in (2, 8, 24)} | {
    "popgym-CountRecallEasy-v0": "CountRecall"
}
"""The games, and their names in the table."""
HISTORIES = (0, 1, 2, 4, 6, 7, 8, 12, 16, 20, 22, 23, 24, 32, 40, 49, 50)
CAPS = (250, 300, 350, 400, 500, 600, 700, 800, 1000, 1200, 1400, 1600, 2000, 2500, 3000, 3500)
SOLVED = 0.9
"""A mean score from which a game counts as solved."""

Points = list[tuple[int, MeanEstimate, str]]


def play(out: Path) -> Iterator[Row]:
    """Play every game under every budget that it can be played under."""
    for game in GAMES:
        budgets = [sp.Budget(history=history) for history in HISTORIES]
        budgets += [sp.Budget(history=None, prompt_tokens=cap) for cap in CAPS]
        yield from complete(
            [game], [PLAYER], budgets=[each for each in budgets if is_playable(game, each, PLAYER)], trials=TRIALS,
            seed=SEED, out=out / game,
        ).rows  # fmt: skip


def points(rows: Sequence[Row], game: str, along: str) -> Points:
    """Return the mean score of a game against its history, or its cap, in ascending order, with marks of early ends."""
    other = {"history": "prompt_tokens", "prompt_tokens": "history"}[along]
    return sorted(
        (cell.budget[along], mean_score(own), in_steps(own))
        for cell, own in by_cell(rows)
        if cell.game == game and cell.budget[other] is None and cell.budget[along] is not None
    )


def enough(own: Points) -> int:
    """Return the place from which a game is solved."""
    return own[max(at for at, (_, estimate, _) in enumerate(own) if estimate.mean < SOLVED) + 1][0]


def table(rows: Sequence[Row]) -> str:
    """The last history and cap under which each game is not solved, and the first from which it is."""
    lines = []
    for game, name in GAMES.items():
        needed = sp.GAMES[game].memory
        line = [name, f"{needed}"]
        for along in ("history", "prompt_tokens"):
            own = points(rows, game, along)
            first = [place for place, *_ in own].index(enough(own))
            line += [f"{place:,}: {interval(estimate)}{early}" for place, estimate, early in own[first - 1 : first + 1]]
        lines.append(line)
    last, first = "the last that fails", "the first that suffices"
    headings = ("game", "past steps needed", f"history: {last}", first, f"cap: {last}", first)
    return markdown_table(headings, lines)


@figure
def ruler(rows: Sequence[Row]) -> Figure:
    """Draw the score against the history, and against the cap on prompts, with a line for each game."""
    drawn, axes = panels(2)
    counts, marks = set(), [""]
    for panel, along, label in zip(
        axes, ("history", "prompt_tokens"), ("past steps shown", "cap on prompts (tokens)"), strict=True
    ):
        first = [enough(points(rows, game, along)) for game in GAMES]
        for index, (game, name) in enumerate(GAMES.items()):
            places, estimates, early = zip(*points(rows, game, along), strict=True)
            draw_estimates(panel, places, estimates, Series.number(index), name)
            mark_points(
                panel, [(x, each.mean) for x, each in zip(places, estimates, strict=True)], [mark[:1] for mark in early]
            )
            counts |= {estimate.episodes for estimate in estimates}
            marks += early
        panel.set(
            title=f"Played rightly from {', '.join(map('{:,}'.format, first))} on",
            xlabel=label,
            ylabel="score",
            ylim=(-1.05, 1.05),
        )
    axes[1].set_xscale("log")
    axes[1].set_xticks(ticks := (250, 500, 1000, 2000, 3500), [f"{tick:,}" for tick in ticks])
    axes[1].minorticks_off()
    legend_below(drawn, note="; ".join([sample_note(counts), *mark_notes(marks)]))
    return drawn


EXPERIMENT = Experiment("ruler", lambda rows: {"ruler": table(rows)}, lambda rows: {"memory-ruler": ruler(rows)})


def main() -> None:
    """Play, and print or publish the table."""
    given = arguments(__doc__, "runs/ruler").parse_args()
    EXPERIMENT.conclude(play(given.out), publishes=given.publish)


if __name__ == "__main__":
    main()
