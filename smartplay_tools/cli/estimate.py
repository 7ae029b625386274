"""The estimate of a run's use before it is played (`--dry-run`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import reduce
from operator import add

from smartplay_tools.cli.show import print_json, print_table, table_console
from smartplay_tools.evaluation.analysis.formats import ShownColumn, TextTable, figures_table
from smartplay_tools.evaluation.runs.estimate import Estimate, Range, estimate
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.plan import Plan, cell_name, player_of, prices_in_tables
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.terminal import say
from smartplay_tools.types.quantities import short

CUT_SHARE = 0.05
"""The share of cut tool results that is worth a warning."""


def print_estimate(plan: Plan, options: RunOptions, *, reply_tokens: int | None, as_json: bool) -> None:
    """Print the estimate of a plan, or of the shard of it that would be played."""
    plan = plan if options.shard is None else plan.shard(*options.shard)
    prices = {**prices_in_tables(plan.cells), **(options.prices or {})}
    estimates = estimate(plan, prices, reply_tokens=reply_tokens)
    if as_json:
        print_json([{**asdict(each), "cell": each.cell.model_dump(mode="json")} for each in estimates])
        return
    print_table(table_console(), _table(estimates))
    for line in _sentences(estimates, options.caps):
        say(line)


FIGURES: Sequence[ShownColumn[Estimate]] = (
    ("episodes", lambda each: f"{each.episodes:,}"),
    ("calls", lambda each: _span(each.calls, _short)),
    ("prompts", lambda each: _span(each.prompt_tokens, _short)),
    ("replies", lambda each: _span(each.reply_tokens, _short)),
    ("USD", lambda each: "unknown" if each.cost is None else _span(each.cost, "{:,.2f}".format)),
)


def _table(estimates: Sequence[Estimate]) -> TextTable:
    games: dict[str, list[tuple[str, Estimate]]] = {}
    for each in estimates:
        name = ", ".join(filter(None, (player_of(each.cell), each.cell.describe())))
        games.setdefault(each.cell.game, []).append((name, each))
    table = figures_table("", "game and player", games, lambda _: FIGURES)
    if len(estimates) < 2:
        return table
    total = reduce(add, estimates)
    return replace(table, rows=(*table.rows, ("all", *(show(total) for _, show in FIGURES))))


def _span(figure: Range, show: Callable[[float], str]) -> str:
    low, high = show(figure.low), show(figure.high)
    return low if low == high else f"{low}-{high}"


def _short(value: float) -> str:
    return short(round(value))


def _sentences(estimates: Sequence[Estimate], caps: Caps) -> list[str]:
    if not estimates:
        return ["This part of the run has no episode."]
    sentences = ["Tokens: from the shortest of the sampled episodes to the longest that the game allows."]
    lengths = sorted({each.reply_length for each in estimates if each.reply_length is not None})
    if lengths:
        span = " and ".join(f"{low} to {high}" if low < high else f"{low}" for low, high in lengths)
        sentences.append(
            f"A model's replies are assumed to have {span} tokens; --assume-reply-tokens changes this, "
            "--reply-tokens makes it a cap."
        )
    total = reduce(add, estimates)
    sentences += _against_cap("--run-tokens", caps.tokens, total.prompt_tokens + total.reply_tokens, _short)
    if total.cost is not None:
        sentences += _against_cap("--run-cost", caps.cost, total.cost, "${:,.2f}".format)
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
