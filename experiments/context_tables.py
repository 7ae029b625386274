"""The answers to the questions of the experiment, as tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from context_questions import CONTROL, QUESTIONS
from page_tables import Column, comparison_table, interval, markdown_table

from smartplay_tools.evaluation.analysis.decisions import mde
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate
from smartplay_tools.evaluation.analysis.money import CellCost, cell_costs
from smartplay_tools.evaluation.analysis.names import strategy_name
from smartplay_tools.evaluation.analysis.pairs import MEASURES, differences, paired_difference
from smartplay_tools.evaluation.analysis.windows import WindowComparison, compare_windows
from smartplay_tools.evaluation.costs.tariffs import Tariff, charge_records, tariffs_of
from smartplay_tools.evaluation.quantities import short
from smartplay_tools.evaluation.runs.sweeps import Sweep
from smartplay_tools.types import STRATEGIES


def table(name: str, played: Sweep) -> str:
    """The answer to a question, in Markdown."""
    along = {"slack": ("slack",), "strategies": tuple(STRATEGIES)}.get(name, ("history", "prompt_tokens", "slack"))
    comparisons = compare_windows(played.rows, along=along)
    if name == "strategies":
        return _strategies(played, comparisons)
    if name == "money":
        return _money(played)
    varied = {"prompt-tokens": "prompt_tokens", "slack": "slack"}.get(name, "history")
    columns = _columns((varied.replace("_", " "), lambda c: _limit(c.cell.budget[varied])), "difference [95 %]")
    if name == "slack":
        columns.append(("gain (percentage points)", lambda c: _points(c.differences.get("prefix_share"))))
    shown = [c for c in comparisons if name != "history" or c.cell.player != CONTROL]
    more = {"history": _control, "crafter": _notes, "messenger": _notes}.get(name)
    return "\n".join([comparison_table(columns, shown), *(["", *more(played)] if more else [])])


def _columns(place: Column, less: str) -> list[Column]:
    """The columns of every comparison of windows; `place` says which window it is, `less` what it is compared with."""
    return [
        ("game", lambda c: f"`{c.cell.game}`"),
        ("player", lambda c: c.cell.player),
        place,
        ("episodes", lambda c: str(c.episodes)),
        ("score [95 %]", lambda c: interval(c.means["score"])),
        (less, lambda c: "reference" if c.is_reference else _difference(c.differences.get("score"))),
        ("tokens an episode", lambda c: f"{c.means['tokens'].mean:,.0f}"),
        ("prefix-stable", lambda c: _percent(c.means["prefix_share"])),
    ]


def _strategies(played: Sweep, comparisons: Sequence[WindowComparison]) -> str:
    """Every strategy beside plain dropping under the same cap, and what it costs where prompts are cached."""
    costs = _costs(played, STRATEGY_RULES)
    place = "cap: strategy", lambda c: f"{_limit(c.cell.budget['prompt_tokens'])}: {strategy_name(c.cell)}"
    columns = _columns(place, "less dropping [95 %]")
    columns += [(tariff.label, partial(_cost_under, costs, at)) for at, tariff in enumerate(STRATEGY_RULES)]
    return comparison_table(columns, comparisons)


def _cost_under(costs: dict[bytes, CellCost], at: int, comparison: WindowComparison) -> str:
    return short(costs[comparison.cell.key()].costs[at])


def _money(played: Sweep) -> str:
    """What an episode of every window costs under the rules of caches, the least of a game and a rule in bold."""
    costs = list(_costs(played, MONEY_RULES).values())
    headings = ("game", "player", "cap, slack", "episodes", "score", "tokens", *(rule.label for rule in MONEY_RULES))
    lines: list[tuple[str, ...]] = []
    for cost in costs:
        rivals = [other for other in costs if other.cell.game == cost.cell.game]
        amounts = (
            f"**{short(own)}**" if own == min(other.costs[at] for other in rivals) else short(own)
            for at, own in enumerate(cost.costs)
        )
        window = f"{_limit(cost.cell.budget['prompt_tokens'])}, {cost.cell.budget['slack']:g}"
        facts = (f"`{cost.cell.game}`", cost.cell.player, window, str(cost.episodes), f"{cost.score:,.4g}")
        lines.append((*facts, short(cost.tokens), *amounts))
    return markdown_table(headings, lines)


def _costs(played: Sweep, tariffs: Sequence[Tariff]) -> dict[bytes, CellCost]:
    """What every cell costs."""
    records = {row["key"]: played.run.folder.transcript(row["key"]) for row in played.rows}
    return {cost.cell.key(): cost for cost in cell_costs(played.rows, charge_records(records, tariffs, {}))}


STRATEGY_RULES = tariffs_of(["none", "anthropic-512", "vllm"])
MONEY_RULES = [
    *tariffs_of(["none", "openai-5-5", "openai-5-6", "anthropic-512"]),
    *(replace(tariff, label="anthropic-512, one mark") for tariff in tariffs_of(["anthropic-512"], marks=["stable"])),
    *tariffs_of(["anthropic-4096", "gemini-3", "deepseek-4", "vllm"]),
]
"""The rules of the tables' columns; costs are in uncached tokens of the input."""


def _control(played: Sweep) -> list[str]:
    """How often the control scores differently from full context, seed by seed."""
    cells = [(cell, rows) for cell, rows in by_cell(played.rows) if cell.player == CONTROL]
    widest = max(QUESTIONS["history"]["vary"]["history"])
    full = {cell.game: rows for cell, rows in cells if cell.budget["history"] == widest}
    others = [(cell, rows) for cell, rows in cells if cell.budget["history"] != widest]
    pairs = [pair for cell, rows in others for pair in differences(rows, full[cell.game], MEASURES["score"])]
    changed = sum(difference != 0 for difference in pairs)
    return [f"The control, `{CONTROL}`: {len(pairs):,} pairs, of which {changed} differ in score."] if pairs else []


def _notes(played: Sweep) -> list[str]:
    """The effect of notes with each history, seed by seed."""
    headings = ("history", "game", "pairs", "score of rule-notes less that of rule [95 %]")
    lines: list[tuple[str, ...]] = []
    with_notes, without = (
        {(cell.game, cell.budget["history"]): rows for cell, rows in by_cell(played.rows) if cell.player == name}
        for name in ("rule-notes", "rule")
    )
    for game, history in with_notes:
        effect = paired_difference(with_notes[game, history], without.get((game, history), []), MEASURES["score"])
        if effect is not None:
            lines.append((str(history), f"`{game}`", str(effect.episodes), _difference(effect)))
    return [markdown_table(headings, lines)] if lines else []


def _limit(value: float | None) -> str:
    return "none" if value is None else f"{value:,g}"


def _difference(estimate: MeanEstimate | None) -> str:
    """A difference, with the smallest one that as many pairs would probably show (MDE) where 0 is not excluded."""
    text = interval(estimate, "+")
    if estimate is None or estimate.low is None or estimate.high is None or not estimate.low <= 0 <= estimate.high:
        return text
    if not estimate.sd:
        return text  # all pairs are equal, and the interval is what their number excludes
    least = mde(estimate.sd, estimate.episodes)
    return f"{text}, MDE {least:{',.0f' if least >= 100 else ',.2f'}}"


def _percent(estimate: MeanEstimate) -> str:
    return f"{100 * estimate.mean:.1f} %"


def _points(estimate: MeanEstimate | None) -> str:
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    mean, low, high = (f"{100 * share:+.1f}" for share in (estimate.mean, estimate.low, estimate.high))
    return mean if low == high else f"{mean} [{low}, {high}]"
