"""The output of `--dry-run`: the expected use of a run, as ranges, compared with its caps.

The output of `--pilot N`: the use of the whole run, estimated from the few episodes that were played.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from operator import add, attrgetter
from statistics import fmean
from typing import Any

import typer
from rich.console import Console
from rich.markup import escape

from smartplay_tools.cli.show import compact_table
from smartplay_tools.episode.config import RULES, CellConfig
from smartplay_tools.evaluation.quantities import duration, short
from smartplay_tools.evaluation.runs import (
    Caps,
    Estimate,
    Plan,
    PlayerConfig,
    Run,
    RunOptions,
    cell_name,
    estimate,
    player_of,
)
from smartplay_tools.evaluation.runs.estimate import SECONDS_A_CALL, TOKENS_A_SECOND, Range
from smartplay_tools.evaluation.runs.executors import WAITING_AT_ONCE
from smartplay_tools.evaluation.runs.plan import prices_in_tables
from smartplay_tools.evaluation.runs.players import given_prices
from smartplay_tools.records.rows import Row

CUT_SHARE = 0.05
"""The share of cut tool results that is worth a warning."""

AXES: tuple[tuple[str, Callable[[CellConfig], Any]], ...] = (
    ("game", lambda cell: cell.game),
    ("player", lambda cell: player_of(cell)),
    ("budget", lambda cell: cell.budget.describe() or "default"),
    *((rule, attrgetter(rule)) for rule in RULES),
)
"""The fields in which cells can differ; each gets a column if they do."""


def print_estimate(
    plan: Plan, players: Sequence[PlayerConfig], options: RunOptions, *, reply_tokens: int | None, as_json: bool
) -> None:
    """Print the estimate of a plan, or of the shard of it that would be played."""
    plan = plan if options.shard is None else plan.shard(*options.shard)
    prices = {**prices_in_tables(plan.cells), **given_prices(players), **(options.prices or {})}
    estimates = estimate(plan, prices, reply_tokens=reply_tokens)
    hours = _hours(estimates, players, options.workers)
    if as_json:
        print(json.dumps([{**asdict(each), "cell": each.cell.model_dump(mode="json")} for each in estimates], indent=2))
        return
    Console().print(_table(estimates))
    for line in _sentences(estimates, options.caps, hours):
        typer.echo(line)


def _table(estimates: Sequence[Estimate]) -> Any:
    axes = [axis for axis in AXES if len({axis[1](each.cell) for each in estimates}) > 1] or [AXES[0]]
    names = [name for name, _ in axes]
    table = compact_table(*names, "episodes", "calls", "prompts", "replies", "USD", folded=len(names))
    for each in estimates:
        named = [escape("none" if value(each.cell) is None else str(value(each.cell))) for _, value in axes]
        table.add_row(*named, *_figures(each.episodes, each.calls, each.prompt_tokens, each.reply_tokens, each.cost))
    if len(estimates) > 1:
        calls, prompts, replies = (
            _sum([getattr(each, name) for each in estimates]) for name in ("calls", "prompt_tokens", "reply_tokens")
        )
        episodes = sum(each.episodes for each in estimates)
        names = ["[bold]all[/]", *[""] * (len(axes) - 1)]
        table.add_row(*names, *_figures(episodes, calls, prompts, replies, _total_cost(estimates)))
    return table


def _figures(episodes: int, calls: Range, prompts: Range, replies: Range, cost: Range | None) -> list[str]:
    tokens = [_span(figure, lambda value: short(round(value))) for figure in (calls, prompts, replies)]
    return [f"{episodes:,}", *tokens, "unknown" if cost is None else _span(cost, "{:,.2f}".format)]


def _span(figure: Range, show: Callable[[float], str]) -> str:
    low, high = show(figure.low), show(figure.high)
    return low if low == high else f"{low}-{high}"


def _sum(ranges: Sequence[Range]) -> Range:
    return reduce(add, ranges, Range(0, 0, 0))


def _total_cost(estimates: Sequence[Estimate]) -> Range | None:
    costs = [each.cost for each in estimates if each.cost is not None]
    return _sum(costs) if len(costs) == len(estimates) else None


def run_hours(
    cells: Sequence[tuple[str, int, float]], players: Sequence[PlayerConfig], workers: int | None
) -> tuple[float, int]:
    """Return the hours of a run and the most episodes at a time, from each cell's player, episodes and seconds.

    A player with a limit of its own (`concurrency`) may take longer than all the others together.
    """
    limits = {config.name: config.concurrency for config in players}
    episodes: dict[str, int] = {}
    seconds: dict[str, float] = {}
    for player, count, taken in cells:
        episodes[player] = episodes.get(player, 0) + count
        seconds[player] = seconds.get(player, 0.0) + taken
    most = {
        player: min(workers or WAITING_AT_ONCE, limits.get(player) or WAITING_AT_ONCE * 1000, count)
        for player, count in episodes.items()
    }
    at_once = max(1, min(workers or WAITING_AT_ONCE, sum(most.values())))
    longest = max((seconds[player] / max(1, most[player]) for player in seconds), default=0.0)
    return max(longest, sum(seconds.values()) / at_once) / 3600, at_once


def _hours(estimates: Sequence[Estimate], players: Sequence[PlayerConfig], workers: int | None) -> tuple[Range, int]:
    ends = [
        run_hours(
            [(player_of(each.cell), each.episodes, getattr(each.call_seconds, end)) for each in estimates],
            players,
            workers,
        )
        for end in ("low", "expected", "high")
    ]
    return Range(*(hours for hours, _ in ends)), ends[0][1]


def _sentences(estimates: Sequence[Estimate], caps: Caps, how_long: tuple[Range, int]) -> list[str]:
    sentences = ["Tokens: from the shortest of the sampled episodes to the longest that the game allows."]
    lengths = sorted({each.reply_length for each in estimates if each.reply_length is not None})
    if lengths:
        span = " and ".join(f"{low} to {high}" if low < high else f"{low}" for low, high in lengths)
        sentences.append(
            f"A model's replies are assumed to have {span} tokens; --assume-reply-tokens changes this, "
            "--reply-tokens makes it a cap."
        )
        hours, at_once = how_long
        sentences.append(
            f"Hours: {_span(hours, '{:.2g}'.format)} with {at_once} episodes at a time, if a reply takes "
            f"{SECONDS_A_CALL[0]:g} to {SECONDS_A_CALL[1]:g} seconds and its tokens come at {TOKENS_A_SECOND[1]:g} to "
            f"{TOKENS_A_SECOND[0]:g} a second."
        )
    tokens = _sum([each.prompt_tokens + each.reply_tokens for each in estimates])
    sentences += _against_cap("--run-tokens", caps.tokens, tokens, lambda value: short(round(value)))
    cost = _total_cost(estimates)
    sentences += _against_cap("--run-cost", caps.cost, cost, "${:,.2f}".format) if cost is not None else []
    for each in estimates:
        if each.cut_share > CUT_SHARE:
            sentences.append(
                f"{cell_name(each.cell)}: {each.cut_share:.0%} of the tool results are cut to fit; "
                "raise --prompt-tokens."
            )
    return sentences


def _against_cap(option: str, cap: float | None, figure: Range, show: Callable[[float], str]) -> list[str]:
    if cap is None:
        return []
    if figure.high <= cap:
        return [f"{option} {show(cap)} is enough for the whole run."]
    likely = "will pause" if figure.low > cap else "is likely to pause" if figure.expected > cap else "may pause"
    return [f"{option} {show(cap)} {likely} the run, which is expected to take {_span(figure, show)}."]


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
