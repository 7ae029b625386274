"""Is a picture cheaper than words? The experiment of `docs/pictures.md`: score against tokens for each and for both.

    python experiments/pictures.py                        # rule players: no key, no network, minutes
    python experiments/pictures.py --player openai:MODEL --player-option pictures=true

Crafter is played on the same seeds under the same caps on prompts, and cut off after 300 calls. A model plays all
three; without one, `rule` plays from words and `rule_pixels.py` from pictures, by the same rules. The latter looks at
pictures only, so "both" shows what words beside a picture cost and not what they are worth. The same command again
goes on where it stopped. `--publish` puts rows, figure and table into the checkout.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from page_tables import HERE, Experiment, arguments, complete, interval, markdown_table

import smartplay_tools as sp
from smartplay_tools.cli.options import key_values
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, panels
from smartplay_tools.evaluation.analysis.pairs import MEASURES, paired_difference, tokens
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row, grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAME, CALLS = "Crafter-v0", 300
CAPS = (500, 1_000, 2_000)
FORMS = ("text", "picture", "both")
PIXELS = f"{HERE / 'rule_pixels.py'}:RulePixelsPlayer"


def play(out: Path, player: str | None, options: Mapping[str, Any], trials: int, seed: int) -> Iterator[Row]:
    """Play every form under every cap, and yield the rows."""
    for form in FORMS:
        name = player or ("rule" if form == "text" else PIXELS)
        budgets = [sp.Budget(prompt_tokens=cap, history=None, tool_calls=CALLS) for cap in CAPS]
        played = PlayerConfig(name=name, options=dict(options))
        yield from complete(
            [GAME], [played], budgets=budgets, out=out / form, trials=trials, seed=seed, observation=form
        ).rows


def cells_of(rows: Sequence[Row]) -> dict[tuple[str, int], list[Row]]:
    """The rows by form and cap."""
    return grouped(rows, lambda row: (row["observation"], row["budget"]["prompt_tokens"]))


def table(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: the score of words, and how pictures and both differ from it under the same cap."""
    cells, lines = cells_of(rows), []
    for cap in CAPS:
        for form in FORMS:
            own = cells[form, cap]
            score = fmean(row["score"] for row in own)
            against = "reference"
            if form != "text":
                against = interval(paired_difference(own, cells["text", cap], MEASURES["score"]), "+")
            shown = fmean(row["tokens"]["prompt"] / max(1, row["turns"]) for row in own)
            used = fmean(map(tokens, own)) / 1e3
            lines.append((f"{cap:,}", form, f"{score:,.0f}", against, f"{used:,.1f}k", f"{shown:,.0f}"))
    headings = ("cap", "observation", "score", "against words", "tokens an episode", "tokens a prompt")
    return markdown_table(headings, lines)


@figure
def frontier(rows: Sequence[Row]) -> Figure:
    """Draw mean score against tokens an episode, a line for each form of observation, a point for each cap."""
    (drawn, [axes]), cells = panels(1), cells_of(rows)
    for number, form in enumerate(FORMS):
        look = Series.number(number)
        points = [(fmean(map(tokens, cells[form, cap])), fmean(r["score"] for r in cells[form, cap])) for cap in CAPS]
        axes.plot(*zip(*points, strict=True), color=look.colour, marker=look.marker, linestyle=look.line, label=form)
    axes.set_xscale("log")
    axes.set_xlabel("tokens an episode")
    axes.set_ylabel("mean score")
    axes.legend()
    return drawn


EXPERIMENT = Experiment(
    "pictures", lambda rows: {"pictures": table(rows)}, lambda rows: {"pictures-frontier": frontier(rows)}
)


def main() -> None:
    """Play, and print or publish the table."""
    parser = arguments(__doc__, "runs/pictures")
    parser.add_argument("--player", help="A model that plays all three; by default the rule players.")
    parser.add_argument("--player-option", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    options = key_values(asked.player_option, "--player-option")
    EXPERIMENT.conclude(play(asked.out, asked.player, options, asked.trials, asked.seed), publishes=asked.publish)


if __name__ == "__main__":
    main()
