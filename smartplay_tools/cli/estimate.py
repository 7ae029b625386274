"""The estimate of a run's use before it is played (`--dry-run`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import reduce
from operator import add, attrgetter
from typing import Any

from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.episode.config import RULES, CellConfig
from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.evaluation.runs.estimate import (
    Estimate,
    Range,
    estimate,
)
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.plan import Plan, cell_name, player_of, prices_in_tables
from smartplay_tools.evaluation.runs.players import PlayerConfig, given_prices
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.terminal import say
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

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
    if as_json:
        print_json([{**asdict(each), "cell": each.cell.model_dump(mode="json")} for each in estimates])
        return
    print_table(table_console(), _table(estimates))
    for line in _sentences(estimates, options.caps):
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


def _sentences(estimates: Sequence[Estimate], caps: Caps) -> list[str]:
    sentences = ["Tokens: from the shortest of the sampled episodes to the longest that the game allows."]
    lengths = sorted({each.reply_length for each in estimates if each.reply_length is not None})
    if lengths:
        span = " and ".join(f"{low} to {high}" if low < high else f"{low}" for low, high in lengths)
        sentences.append(
            f"A model's replies are assumed to have {span} tokens; --assume-reply-tokens changes this, "
            "--reply-tokens makes it a cap."
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
