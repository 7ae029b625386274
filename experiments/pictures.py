"""Is a picture cheaper than words? The experiment of `docs/pictures.md`: score against tokens for each and for both.

    python experiments/pictures.py                        # rule players: no key, no network, minutes
    python experiments/pictures.py --player openai:MODEL --player-option pictures=true

Crafter is played on the same seeds under the same caps on prompts, and cut off after 300 calls. A model plays all
three; without one, `rule` plays from words and `rule_pixels.py` from pictures, by the same rules. The latter looks at
pictures only, so "both" shows what words beside a picture cost and not what they are worth. The same command again
goes on where it stopped. `--publish` puts the figure and the table into the documentation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from page_tables import arguments, interval, show

import smartplay_tools as sp
from smartplay_tools.cli.options import key_values
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, panels, save_figure
from smartplay_tools.evaluation.analysis.pairs import MEASURES, paired_difference
from smartplay_tools.evaluation.runs.players import PlayerConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GAME, CALLS = "Crafter-v0", 300
CAPS = (500, 1_000, 2_000, 4_000, 8_000)
FORMS = ("text", "picture", "both")
DOCS = Path(__file__).parents[1] / "docs"
PIXELS = f"{Path(__file__).with_name('rule_pixels.py')}:RulePixelsPlayer"
Cells = Mapping[tuple[str, int], Sequence[dict[str, Any]]]
"""By form and cap: the rows of the episodes, in the order of their trials."""


def play(out: Path, player: str | None, options: Mapping[str, Any], trials: int, seed: int) -> Cells:
    """Play every cell, or read what was played."""
    cells = {}
    for form in FORMS:
        name = player or ("rule" if form == "text" else PIXELS)
        budgets = [sp.Budget(prompt_tokens=cap, history=None, tool_calls=CALLS) for cap in CAPS]
        run = sp.evaluate(
            [GAME],
            [PlayerConfig(name=name, options=dict(options))],
            budgets=budgets,
            out=out / form,
            trials=trials,
            seed=seed,
            observation=form,
        )
        for cap in CAPS:
            rows = [row for row in run.rows if row["budget"]["prompt_tokens"] == cap]
            cells[form, cap] = sorted(rows, key=lambda row: row["trial"])
    return cells


def tokens(row: Mapping[str, Any]) -> int:
    """The tokens of an episode: all prompts and replies."""
    return int(row["tokens"]["prompt"] + row["tokens"]["reply"])


def table(cells: Cells) -> str:
    """Return a table in Markdown: the score of words, and how pictures and both differ from it under the same cap."""
    lines = ["| cap | observation | score | against words | tokens an episode | tokens a prompt |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    for cap in CAPS:
        for form in FORMS:
            rows = cells[form, cap]
            score = fmean(row["score"] for row in rows)
            paired = paired_difference(rows, cells["text", cap], MEASURES["score"]) if form != "text" else None
            used = fmean(map(tokens, rows))
            shown = fmean(row["tokens"]["prompt"] / max(1, row["turns"]) for row in rows)
            against = "reference" if form == "text" else interval(paired, "+")
            lines.append(f"| {cap:,} | {form} | {score:,.0f} | {against} | {used / 1e3:,.1f}k | {shown:,.0f} |")
    return "\n".join(lines)


@figure
def frontier(cells: Cells) -> Figure:
    """Draw mean score against tokens an episode, a line for each form of observation, a point for each cap."""
    drawn, [axes] = panels(1)
    for number, form in enumerate(FORMS):
        look = Series.number(number)
        points = [(fmean(map(tokens, cells[form, cap])), fmean(r["score"] for r in cells[form, cap])) for cap in CAPS]
        axes.plot(*zip(*points, strict=True), color=look.colour, marker=look.marker, linestyle=look.line, label=form)
    axes.set_xscale("log")
    axes.set_xlabel("tokens an episode")
    axes.set_ylabel("mean score")
    axes.legend()
    return drawn


def main() -> None:
    """Play, print the table, draw the figure."""
    parser = arguments(__doc__, "runs/pictures")
    parser.add_argument("--player", help="A model that plays all three; by default the rule players.")
    parser.add_argument("--player-option", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    options = key_values(asked.player_option, "--player-option")
    cells = play(asked.out, asked.player, options, asked.trials, asked.seed)
    show(DOCS / "pictures.md", "pictures", table(cells), publishes=asked.publish)
    folder = DOCS / "figures" if asked.publish else asked.out
    save_figure(frontier(cells), folder / "pictures-frontier", formats=["svg"])


if __name__ == "__main__":
    main()
