"""The answers to the questions of the experiment, as tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from statistics import fmean

from context_questions import CONTROL, QUESTIONS
from page_tables import (
    EPISODES,
    GAME,
    PLAYER,
    SCORE,
    STABLE,
    TOKENS,
    Column,
    Line,
    comparison_table,
    difference,
    interval,
    markdown_table,
)

from smartplay_tools.evaluation.analysis.beside import EARLY, ends_of
from smartplay_tools.evaluation.analysis.decisions import mde
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.names import strategy_name
from smartplay_tools.evaluation.analysis.pairs import MEASURES, differences, paired_difference, tokens
from smartplay_tools.evaluation.costs.tariffs import Tariff, tariffs_of
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types import STRATEGIES
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

TARIFFS: dict[str, list[Tariff]] = {
    "strategies": tariffs_of(["none", "anthropic-512", "vllm"]),
    "money": [
        *tariffs_of(["none", "openai-5-5", "openai-5-6", "anthropic-512"]),
        *(
            replace(tariff, label="anthropic-512, one mark")
            for tariff in tariffs_of(["anthropic-512"], marks=["stable"])
        ),
        *tariffs_of(["anthropic-4096", "gemini-3", "deepseek-4", "vllm"]),
    ],
}
"""The rules of caches under which the episodes of a question are priced, in uncached tokens of the input."""


def table(name: str, rows: Sequence[Row]) -> str:
    """The answer to a question, in Markdown."""
    if name == "money":
        return _money(rows)
    along = {"slack": ("slack",), "strategies": tuple(STRATEGIES)}.get(name, ("history", "prompt_tokens", "slack"))
    varied = {"prompt-tokens": "prompt_tokens", "slack": "slack"}.get(name, "history")
    place: Column = varied.replace("_", " "), lambda line: _limit(line.compared.cell.budget[varied])
    less = "difference [95 %]"
    further: list[Column] = []
    if name == "slack":
        further = [("gain (percentage points)", lambda line: _points(line.compared.differences.get("prefix_share")))]
    if name == "strategies":
        place, less = ("cap: strategy", _strategy), "less dropping [95 %]"
        further = [(rule.label, partial(_cost_under, at)) for at, rule in enumerate(TARIFFS[name])]
    effect: Column = less, difference(lambda each: _difference(each.differences.get("score")))
    columns = [GAME, PLAYER, place, EPISODES, SCORE, effect, TOKENS, STABLE, *further]
    more = {"history": _control, "crafter": _notes, "messenger": _notes}.get(name)
    shown = comparison_table(rows, along, columns, without=[CONTROL] if name == "history" else [])
    return "\n".join([shown, *(["", *more(rows)] if more else [])])


def _strategy(line: Line) -> str:
    cell = line.compared.cell
    return f"{_limit(cell.budget['prompt_tokens'])}: {strategy_name(cell)}"


def _cost_under(at: int, line: Line) -> str:
    return short(fmean(row["costs"][at] for row in line.rows))


def _money(rows: Sequence[Row]) -> str:
    """What an episode of every window costs under the rules of caches, the least of a game and a rule in bold."""
    rules = TARIFFS["money"]
    headings = ("game", "player", "cap, slack", "episodes", "steps", "score", "tokens", *(rule.label for rule in rules))
    lines: list[tuple[str, ...]] = []
    for game, cells in grouped(by_cell(rows), lambda group: group[0].game).items():
        costs = [[fmean(row["costs"][at] for row in own) for at in range(len(rules))] for _, own in cells]
        least = list(map(min, *costs))
        for (cell, own), amounts in zip(cells, costs, strict=True):
            window = f"{_limit(cell.budget['prompt_tokens'])}, {cell.budget['slack']:g}"
            score, used = fmean(row["score"] for row in own), fmean(map(tokens, own))
            steps = f"{fmean(row['steps'] for row in own):,.0f}{EARLY * bool(ends_of(own))}"
            facts = (f"`{game}`", cell.player, window, str(len(own)), steps, f"{score:,.4g}", short(used))
            bold = ("**" if amount == best else "" for amount, best in zip(amounts, least, strict=True))
            lines.append((*facts, *(f"{mark}{short(own)}{mark}" for mark, own in zip(bold, amounts, strict=True))))
    return markdown_table(headings, lines)


def _control(rows: Sequence[Row]) -> list[str]:
    """How often the control scores differently from full context, seed by seed."""
    cells = [(cell, own) for cell, own in by_cell(rows) if cell.player == CONTROL]
    widest = max(QUESTIONS["history"]["vary"]["history"])
    full = {cell.game: own for cell, own in cells if cell.budget["history"] == widest}
    others = [(cell, own) for cell, own in cells if cell.budget["history"] != widest]
    pairs = [pair for cell, own in others for pair in differences(own, full[cell.game], MEASURES["score"])]
    changed = sum(difference != 0 for difference in pairs)
    return [f"The control, `{CONTROL}`: {len(pairs):,} pairs, of which {changed} differ in score."] if pairs else []


def _notes(rows: Sequence[Row]) -> list[str]:
    """The effect of notes with each history, seed by seed."""
    headings = ("history", "game", "pairs", "score of rule-notes less that of rule [95 %]")
    lines: list[tuple[str, ...]] = []
    with_notes, without = (
        {(cell.game, cell.budget["history"]): own for cell, own in by_cell(rows) if cell.player == name}
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


def _points(estimate: MeanEstimate | None) -> str:
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    mean, low, high = (f"{100 * share:+.1f}" for share in (estimate.mean, estimate.low, estimate.high))
    return mean if low == high else f"{mean} [{low}, {high}]"
