"""What notes are worth from trial to trial: score against the number of the trial, with `carry` and without.

    python experiments/carry.py                          # scripted players: no key, no network, minutes
    python experiments/carry.py --player openai:MODEL    # the same question to a model

`rule-notes` can use what it carries at the bandit, where it learns how often better and worse machines win. The same
command continues where it stopped; `--publish` puts rows, table and figure into the checkout.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from page_tables import Experiment, arguments, complete, in_steps, interval, markdown_table, player_options, verdict

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_estimates,
    figure,
    legend_below,
    panels,
    sample_note,
    spread,
)
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell
from smartplay_tools.evaluation.analysis.pairs import difference_sample, pairs, sample, score
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate, mean_estimates
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAMES = ("BanditTwoArmedHighLowFixed-v0", "BanditTwoArmedHighHighFixed-v0")
CHAIN = 10
SEED = 4711
"""Of the run: its worlds are in no other table."""
BUDGET = sp.Budget(notes_tokens=200)


def main() -> None:
    """Play both runs, print the table, and write it."""
    asked = _arguments()
    rows: list[Row] = []
    for carry in (None, "notes"):
        done = complete(
            GAMES,
            asked.player or ["rule-notes"],
            budgets=BUDGET,
            trials=CHAIN * asked.chains,
            seed=SEED,
            out=asked.out / (carry or "nothing"),
            workers=asked.workers,
            **({} if carry is None else {"carry": "notes", "chain": CHAIN}),
        )
        rows += done.rows
    EXPERIMENT.conclude(rows, publishes=asked.publish)


Pairs = list[tuple[Row, Row]]


def compared(rows: Sequence[Row]) -> list[tuple[PlayedCell, Pairs, MeanEstimate]]:
    """Return, for every cell that carries, its later trials beside those without, and the difference of their scores.

    The unit is the chain, and the intervals hold together.
    """
    cells = by_cell(rows)
    without = {(cell.game, cell.player): members for cell, members in cells if cell.rules["carry"] is None}
    carries = ((cell, members) for cell, members in cells if cell.rules["carry"] is not None)
    carrying = [(cell, members) for cell, members in carries if (cell.game, cell.player) in without]
    if not carrying:
        return []
    later = [[row for row in members if row["trial"] % CHAIN] for _, members in carrying]
    paired = [
        pairs(members, without[cell.game, cell.player]) for (cell, _), members in zip(carrying, later, strict=True)
    ]
    differences = mean_estimates([difference_sample(each, score) for each in paired], bonferroni(len(paired)))
    return [(cell, *each) for (cell, _), *each in zip(carrying, paired, differences, strict=True)]


def table(rows: Sequence[Row]) -> str:
    """What carrying adds to the score at every game, in Markdown."""
    lines = []
    for cell, own, difference in compared(rows):
        means = mean_estimates([sample(side, score) for side in ([b for _, b in own], [a for a, _ in own])])
        shown = [f"{mean.mean:.2f}" for mean in means]
        less = interval(difference, "+") + in_steps([b for _, b in own])
        lines.append((f"`{cell.game}`", cell.player, str(difference.episodes), *shown, less))
    headings = ("game", "player", "chains", "score without", "score with", "with less without [95 %, all together]")
    return markdown_table(headings, lines)


@figure
def score_against_trial(rows: Sequence[Row]) -> Figure:
    """Draw the mean score of every trial of a chain over all chains, with and without `carry`, a panel for each game.

    Without `carry` trials are put into chains of the same length, whose seeds are the same. Bars are 95 % intervals,
    each over the trials at one position of all chains, which are independent.
    """
    cells = by_cell(rows)
    lengths = {cell.rules["chain"] for cell, _ in cells if cell.rules["carry"] is not None}
    if len(lengths) != 1 or None in lengths:
        raise InvalidArgumentError(
            "There is nothing to draw: the rows need chains of one length (`carry` and `chain`)."
        )
    (length,) = lengths
    games = grouped(cells, lambda group: group[0].game)
    drawn, axes = panels(len(games), columns=3)
    counts: list[int] = []
    verdicts = grouped(compared(rows), lambda each: each[0].game)
    for panel, (game, own) in zip(axes, games.items(), strict=True):
        for index, (cell, members) in enumerate(own):
            places = sorted(grouped(members, lambda row: row["trial"] % length).items())
            estimates = mean_estimates([sample(each, score) for _, each in places])
            counts += [estimate.episodes for estimate in estimates]
            at = [place + 1 + spread(index, len(own)) for place, _ in places]
            draw_estimates(panel, at, estimates, Series.number(index), _name(cell))
        said = ", ".join(f"{cell.player} {verdict(difference)}" for cell, _, difference in verdicts.get(game, ()))
        panel.set(
            title=game.removesuffix("-v0") + (f"\ncarried notes: {said}" if said else ""),
            xlabel="trial of the chain",
            ylabel="score (points)",
        )
        panel.set_xticks(range(1, length + 1))
    legend_below(drawn, columns=2, note=sample_note(counts))
    return drawn


def _name(cell: PlayedCell) -> str:
    carried = (
        "begins with nothing" if cell.rules["carry"] is None else f"with the {cell.rules['carry']} of the trial before"
    )
    return f"{cell.player}, {carried}"


EXPERIMENT = Experiment(
    "carry", lambda rows: {"carry": table(rows)}, lambda rows: {"carry-score-against-trial": score_against_trial(rows)}
)


def _arguments() -> argparse.Namespace:
    parser = arguments("What notes are worth from trial to trial.", "runs/carry")
    player_options(parser)
    parser.add_argument("--chains", type=int, default=15, help="chains of every game")
    return parser.parse_args()


if __name__ == "__main__":
    main()
