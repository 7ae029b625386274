"""The answers to the questions of the experiment, as tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean

from context_questions import CONTROL, QUESTIONS
from page_tables import (
    GAME,
    PLAYER,
    SCORE,
    STABLE,
    TOKENS,
    Column,
    Line,
    compared_lines,
    comparison_table,
    control_line,
    difference,
    interval,
    markdown_table,
    score_or,
    table_across,
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

ALIKE = ("MessengerL1-v0", "MessengerL2-v0")
"""Games in which no window is shown to matter, and which no table has."""


def table(name: str, rows: Sequence[Row]) -> str:
    """The answer to a question, in Markdown."""
    if name == "money":
        return _money(rows)
    effect: Column = "difference [95 %]", difference(lambda each: _difference(each.differences.get("score")))
    players = {row["player"] for row in rows} - ({CONTROL} if name == "history" else set())
    heads = [GAME, *([PLAYER] if len(players) > 1 else [])]
    if name == "strategies":
        rules = "/".join(rule.label for rule in TARIFFS[name])
        shown: list[Column] = [("less dropping [95 %]", score_or(effect[1])), (rules, _costs)]
        strategy: Column = "strategy", lambda line: strategy_name(line.compared.cell)
        return table_across(rows, tuple(STRATEGIES), [*heads, strategy], _cap, shown)
    along = ("slack",) if name == "slack" else ("history", "prompt_tokens", "slack")
    varied = {"prompt-tokens": "prompt_tokens", "slack": "slack"}.get(name, "history")
    place: Column = varied.replace("_", " "), lambda line: _limit(line.compared.cell.budget[varied])
    if players == {"rule", "rule-notes"}:
        return _with_notes([row for row in rows if row["game"] not in ALIKE], along, [GAME, place], effect)
    columns = [*heads, place, SCORE, effect, TOKENS, STABLE]
    table = comparison_table(rows, along, columns, without=[CONTROL] if name == "history" else [])
    return "\n".join([table, *(["", *_control(rows)] if name == "history" else [])])


def _cap(line: Line) -> str:
    return _limit(line.compared.cell.budget["prompt_tokens"])


def _costs(line: Line) -> str:
    costs = zip(*(row["costs"] for row in line.rows), strict=True)
    return "/".join(short(fmean(each)) for each in costs)


def _money(rows: Sequence[Row]) -> str:
    """What an episode of every window costs under the rules of caches, the least of a game and a rule in bold."""
    rules = TARIFFS["money"]
    headings = ("game", "cap, slack", "steps", "score", "tokens", *(rule.label for rule in rules))
    lines: list[tuple[str, ...]] = []
    for game, cells in grouped(by_cell(rows), lambda group: group[0].game).items():
        costs = [[fmean(row["costs"][at] for row in own) for at in range(len(rules))] for _, own in cells]
        least = list(map(min, *costs))
        for (cell, own), amounts in zip(cells, costs, strict=True):
            window = f"{_limit(cell.budget['prompt_tokens'])}, {cell.budget['slack']:g}"
            score, used = fmean(row["score"] for row in own), fmean(map(tokens, own))
            steps = f"{fmean(row['steps'] for row in own):,.0f}{EARLY * bool(ends_of(own))}"
            facts = (f"`{game}`", window, steps, f"{score:,.4g}", short(used))
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
    return [control_line(f"`{CONTROL}`", pairs)] if pairs else []


def _with_notes(rows: Sequence[Row], along: Sequence[str], places: Sequence[Column], effect: Column) -> str:
    """The score of `rule` with each history, and the effect of notes on it, seed by seed."""
    lines = compared_lines(rows, along)
    notes = {tuple(show(line) for _, show in places): line for line in lines if line.compared.cell.player != "rule"}
    table: list[list[str]] = []
    for line in lines:
        if line.compared.cell.player == "rule":
            place = [show(line) for _, show in places]
            other = notes[tuple(place)]
            less = paired_difference(other.rows, line.rows, MEASURES["score"])
            own = [show(line) for _, show in (SCORE, effect, TOKENS)]
            table.append([*place, *own, SCORE[1](other), TOKENS[1](other), _difference(less)])
    with_notes = ["rule-notes", TOKENS[0], "rule-notes less rule"]
    return markdown_table([*(name for name, _ in places), "rule", effect[0], TOKENS[0], *with_notes], table)


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
