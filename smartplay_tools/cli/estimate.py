"""The estimates of a run's use: ranges before it is played (`--dry-run`), means of its first episodes (`--pilot N`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import reduce
from operator import add, attrgetter
from typing import Any

from smartplay_tools.cli.show import compact_table, print_json, print_table, table_console
from smartplay_tools.episode.config import RULES, CellConfig
from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.evaluation.runs.estimate import (
    SECONDS_A_CALL,
    TOKENS_A_SECOND,
    Estimate,
    Range,
    estimate,
    estimate_from,
)
from smartplay_tools.evaluation.runs.executors import WAITING_AT_ONCE
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.plan import Plan, cell_name, player_of, prices_in_tables
from smartplay_tools.evaluation.runs.players import PlayerConfig, given_prices
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.terminal import Console, say
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import duration, short

CUT_SHARE = 0.05
"""The share of cut tool results that is worth a warning."""

FACTS: tuple[Callable[[CellConfig], Any], ...] = (
    player_of,
    lambda cell: cell.budget.describe() or "default",
    *map(attrgetter, RULES),
)
"""What cells of a game can differ in; a row is named by that in which they do."""


def print_estimate(
    plan: Plan, players: Sequence[PlayerConfig], options: RunOptions, *, reply_tokens: int | None, as_json: bool
) -> None:
    """Print the estimate of a plan, or of the shard of it that would be played."""
    plan = plan if options.shard is None else plan.shard(*options.shard)
    prices = {**prices_in_tables(plan.cells), **given_prices(players), **(options.prices or {})}
    estimates = estimate(plan, prices, reply_tokens=reply_tokens)
    hours = _hours(estimates, players, options.workers)
    if as_json:
        print_json([{**asdict(each), "cell": each.cell.model_dump(mode="json")} for each in estimates])
        return
    print_table(table_console(), _table(estimates))
    for line in _sentences(estimates, options.caps, hours):
        say(line)


def _table(estimates: Sequence[Estimate]) -> TextTable:
    differing = [fact for fact in FACTS if len({fact(each.cell) for each in estimates}) > 1] or [player_of]

    def rows(members: Sequence[Estimate]) -> Iterator[tuple[str, ...]]:
        for each in members:
            name = ", ".join(str(fact(each.cell)) for fact in differing)
            used = _figures(each.episodes, each.calls, each.prompt_tokens, each.reply_tokens, each.cost)
            yield f"  {name}", *used

    games = grouped(estimates, lambda each: each.cell.game)
    shown = sections((game, rows(members)) for game, members in games.items())
    if len(estimates) > 1:
        calls, prompts, replies = (
            _sum([getattr(each, name) for each in estimates]) for name in ("calls", "prompt_tokens", "reply_tokens")
        )
        episodes = sum(each.episodes for each in estimates)
        shown += (("all", *_figures(episodes, calls, prompts, replies, _total_cost(estimates))),)
    return TextTable("", columns("game and player", "episodes", "calls", "prompts", "replies", "USD"), shown)


def _figures(episodes: int, calls: Range, prompts: Range, replies: Range, cost: Range | None) -> list[str]:
    tokens = [_span(figure, _short) for figure in (calls, prompts, replies)]
    return [f"{episodes:,}", *tokens, "unknown" if cost is None else _span(cost, "{:,.2f}".format)]


def _span(figure: Range, show: Callable[[float], str]) -> str:
    low, high = show(figure.low), show(figure.high)
    return low if low == high else f"{low}-{high}"


def _short(value: float) -> str:
    return short(round(value))


def _sum(ranges: Sequence[Range]) -> Range:
    return reduce(add, ranges, Range(0, 0, 0))


def _total_cost(estimates: Sequence[Estimate]) -> Range | None:
    costs = [each.cost for each in estimates if each.cost is not None]
    return _sum(costs) if len(costs) == len(estimates) else None


def _hours(estimates: Sequence[Estimate], players: Sequence[PlayerConfig], workers: int | None) -> tuple[Range, int]:
    """The hours of a run, and the most episodes at a time.

    A player with its own limit (`concurrency`) may take longer than all the others together.
    """
    slots = workers or WAITING_AT_ONCE
    limits = {config.name: config.concurrency for config in players}
    most, seconds = {}, {}
    for player, own in grouped(estimates, lambda each: player_of(each.cell)).items():
        limit = limits.get(player) or WAITING_AT_ONCE * 1000
        most[player] = max(1, min(slots, limit, sum(each.episodes for each in own)))
        seconds[player] = _sum([each.call_seconds for each in own])
    at_once = max(1, min(slots, sum(most.values())))

    def hours(end: Callable[[Range], float]) -> float:
        longest = max((end(taken) / most[player] for player, taken in seconds.items()), default=0.0)
        return max(longest, end(_sum(list(seconds.values()))) / at_once) / 3600

    return Range(*map(hours, map(attrgetter, ("low", "expected", "high")))), at_once


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
    sentences += _against_cap("--run-tokens", caps.tokens, tokens, _short)
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
        used = [_span(figure, _short) for figure in (each.calls, each.prompt_tokens + each.reply_tokens)]
        dollars = "unknown" if each.cost is None else _span(each.cost, "{:,.2f}".format)
        table.add_row(cell_name(each.cell), str(len(played)), str(each.episodes), *used, dollars)
    console.print(table)
    tokens = _span(_sum([each.prompt_tokens + each.reply_tokens for each in estimates]), _short)
    cost, (hours, at_once) = _total_cost(estimates), _hours(estimates, players, options.workers)
    say(
        f"The whole run: {tokens} tokens, {'cost unknown' if cost is None else _span(cost, '${:,.2f}'.format)}, "
        f"about {duration(3600 * hours.expected)} with {at_once} episodes at a time. Ranges are from what it would "
        "take if all episodes were as the smallest of their cell in the pilot to the same for the largest. "
        "The same command without --pilot continues and keeps these episodes.",
        err=True,
    )
