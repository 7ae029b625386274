"""The output of `--pilot N`: the use of the whole run, estimated from the few episodes that were played."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import typer
from rich.console import Console

from smartplay_tools.cli.estimate import run_hours
from smartplay_tools.cli.show import compact_table
from smartplay_tools.evaluation.quantities import duration, short
from smartplay_tools.evaluation.runs import Plan, PlayerConfig, Run, RunOptions, cell_name, player_of
from smartplay_tools.records.rows import Row


@dataclass(frozen=True)
class CellUse:
    """What the episodes of a cell are expected to use, from those that were played."""

    name: str
    player: str
    played: int
    planned: int
    calls: float
    tokens: float
    cost: float | None
    seconds: float
    """For all its episodes, one after another."""


def pilot_estimate(run: Run, plan: Plan) -> list[CellUse]:
    """Return the expected use of every cell that has a finished episode: their mean, times the planned number."""
    seconds: dict[str, float] = {}
    for row in run.folder.timings():
        seconds[row["key"]] = seconds.get(row["key"], 0.0) + float(row["seconds"])
    rows: Mapping[str, Row] = {row["key"]: row for row in run.rows}
    uses = []
    for place, cell in enumerate(plan.cells):
        keys = [episode.key for episode in plan.episodes if episode.place == place]
        played = [rows[key] for key in keys if key in rows]
        if played:
            costs = [row["cost"] for row in played]
            uses.append(
                CellUse(
                    cell_name(cell),
                    player_of(cell),
                    len(played),
                    len(keys),
                    len(keys) * fmean(row["turns"] + row.get("summaries", 0) for row in played),
                    len(keys) * fmean(row["tokens"]["prompt"] + row["tokens"]["reply"] for row in played),
                    None if None in costs else len(keys) * fmean(costs),
                    len(keys) * fmean(seconds.get(row["key"], 0.0) for row in played),
                )
            )
    return uses


def print_pilot(console: Console, run: Run, plan: Plan, players: Sequence[PlayerConfig], options: RunOptions) -> None:
    """Print the estimate, and how to continue the run."""
    uses = pilot_estimate(run, plan)
    table = compact_table("from the pilot", "played", "planned", "calls", "tokens", "USD", folded=1)
    for use in uses:
        cost = "unknown" if use.cost is None else f"{use.cost:,.2f}"
        table.add_row(use.name, str(use.played), str(use.planned), short(use.calls), short(use.tokens), cost)
    console.print(table)
    costs = [use.cost for use in uses if use.cost is not None]
    total = f"${sum(costs):,.2f}, " if len(costs) == len(uses) else "cost unknown, "
    hours, at_once = run_hours([(use.player, use.planned, use.seconds) for use in uses], players, options.workers)
    typer.echo(
        f"The whole run: {short(sum(use.tokens for use in uses))} tokens, {total}"
        f"about {duration(3600 * hours)} with {at_once} episodes at a time. "
        "The same command without --pilot continues and keeps these episodes.",
        err=True,
    )
