"""The estimate of a run's use, from its first episodes (`--pilot N`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import reduce
from operator import add

from smartplay_tools.cli.show import compact_table
from smartplay_tools.evaluation.runs.estimate import Estimate, Range, estimate_from
from smartplay_tools.evaluation.runs.executors import WAITING_AT_ONCE
from smartplay_tools.evaluation.runs.plan import Plan, cell_name, player_of
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.terminal import Console, say
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import duration, short


def print_pilot(console: Console, run: Run, plan: Plan, players: Sequence[PlayerConfig], options: RunOptions) -> None:
    """Print the use of the whole run, estimated from the episodes that were played, and how to continue it."""
    rows, seconds = {row["key"]: row for row in run.rows}, Counter[str]()
    for timing in run.folder.timings():
        seconds[timing["key"]] += timing["seconds"]
    table = compact_table("from the pilot", "played", "planned", "calls", "tokens", "USD", folded=1)
    estimates = []
    for members in grouped(plan.episodes, lambda episode: episode.place).values():
        played = [rows[episode.key] for episode in members if episode.key in rows]
        if not played:
            continue
        estimates.append(each := estimate_from(members[0].cell, len(members), played, seconds))
        used = [_span(figure, _short) for figure in (each.calls, each.tokens)]
        dollars = "unknown" if each.cost is None else _span(each.cost, "{:,.2f}".format)
        table.add_row(cell_name(each.cell), str(len(played)), str(each.episodes), *used, dollars)
    console.print(table)
    costs = [each.cost for each in estimates if each.cost is not None]
    cost = _span(_sum(costs), "${:,.2f}".format) if len(costs) == len(estimates) else "cost unknown"
    seconds_left, at_once = _seconds(estimates, players, options.workers)
    say(
        f"The whole run: {_span(_sum([each.tokens for each in estimates]), _short)} tokens, {cost}, about "
        f"{duration(seconds_left)} with {at_once} episodes at a time. Ranges are from what it would take if all "
        "episodes were as the smallest of their cell in the pilot to the same for the largest. The same command "
        "without --pilot continues and keeps these episodes.",
        err=True,
    )


def _span(figure: Range, show: Callable[[float], str]) -> str:
    low, high = show(figure.low), show(figure.high)
    return low if low == high else f"{low}-{high}"


def _short(value: float) -> str:
    return short(round(value))


def _sum(ranges: Sequence[Range]) -> Range:
    return reduce(add, ranges, Range(0, 0, 0))


def _seconds(estimates: Sequence[Estimate], players: Sequence[PlayerConfig], workers: int | None) -> tuple[float, int]:
    """The seconds of a run, and the most episodes at a time.

    A player with its own limit (`concurrency`) may take longer than all the others together.
    """
    slots = workers or WAITING_AT_ONCE
    limits = {config.name: config.concurrency for config in players}
    longest, total, most = 0.0, 0.0, 0
    for player, own in grouped(estimates, lambda each: player_of(each.cell)).items():
        room = max(1, min(slots, limits.get(player) or slots, sum(each.episodes for each in own)))
        taken = sum(each.call_seconds.expected for each in own)
        longest, total, most = max(longest, taken / room), total + taken, most + room
    at_once = max(1, min(slots, most))
    return max(longest, total / at_once), at_once
