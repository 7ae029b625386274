"""What cells cost under the rules of caches: an episode, a point of score, and which window is cheapest where.

The figures are models, made from records (`costs.charges`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from smartplay_tools.evaluation.analysis.beside import EARLY, Beside, early_notes, ends_of
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, columns
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell
from smartplay_tools.evaluation.analysis.names import family_titles, window_names
from smartplay_tools.evaluation.analysis.numbers import NOTHING, dollars, percent
from smartplay_tools.evaluation.analysis.pairs import sample, score
from smartplay_tools.evaluation.analysis.windows import family
from smartplay_tools.evaluation.costs.charges import Charge
from smartplay_tools.evaluation.costs.tariffs import Tariff
from smartplay_tools.records.rows import Row, is_managed
from smartplay_tools.types.groups import grouped
from smartplay_tools.types.quantities import short

UNIT = "costs are of an episode, in uncached tokens of the input, replies included; in USD where the column is a model"
AREA = "area: the mean score while money is spent, up to the cost of the player's dearest episode at the game"
MODEL = "a model of a bill, computed from the prompts on record; docs/context-cost.md has the definition"


@dataclass(frozen=True)
class CellCost:
    """What an episode of a cell costs, as means over its episodes."""

    cell: PlayedCell
    title: str
    """What it has in common with the other windows of its player at its game."""
    window: str
    episodes: int
    uncounted: int
    """Episodes without prompts on record, which are in no mean."""
    ends: Mapping[str, int]
    """How many of these episodes ended before their game did, by the reason."""
    steps: float
    score: float
    """The mean, as of every other table: of worlds or chains, where these have several episodes."""
    tokens: float
    """Budget tokens of prompts and replies."""
    costs: tuple[float, ...]
    """One for each tariff."""
    shares: tuple[tuple[float, float], ...]
    """The shares of prompt tokens that are read and written, for each tariff."""
    early: tuple[float, ...]
    """The mean score while money is spent, up to the cost of the dearest episode of the player at the game."""

    @property
    def marked(self) -> str:
        """The window, marked where episodes ended early."""
        return self.window + EARLY * bool(self.ends)


def cell_costs(rows: Iterable[Row], charged: Mapping[str, Sequence[Charge] | None], *, run: str = "") -> list[CellCost]:
    """Return what every cell of a run costs; `charged` has its episodes by key, `run` is the run's name, if needed."""
    played = [
        (cell, members, [(row, charge) for row, charge in pairs if charge is not None and not is_managed(row)])
        for cell, members in by_cell(rows)
        for pairs in [[(row, charged.get(row["key"])) for row in members]]
    ]
    played = [(cell, members, pairs) for cell, members, pairs in played if pairs]
    dearest: dict[bytes, list[float]] = {}
    for cell, _, pairs in played:
        for _, each in pairs:
            most = dearest.setdefault(family(cell), [0.0] * len(each))
            dearest[family(cell)] = [max(pair) for pair in zip(most, (c.cost for c in each), strict=True)]
    costs = []
    cells = [cell for cell, _, _ in played]
    named = zip(played, family_titles(cells), window_names(cells), strict=True)
    for (cell, members, pairs), title, name in named:
        by_tariff = list(zip(*(each for _, each in pairs), strict=True))
        scores = [score(row) for row, _ in pairs]
        costs.append(
            CellCost(
                cell=cell,
                title=", ".join(filter(None, [run, title])),
                window=name or "the default",
                episodes=len(pairs),
                uncounted=len(members) - len(pairs),
                ends=ends_of(row for row, _ in pairs),
                steps=fmean(row["steps"] for row, _ in pairs),
                score=fmean(sample([row for row, _ in pairs], score).values),
                tokens=fmean(row["tokens"]["prompt"] + row["tokens"]["reply"] for row, _ in pairs),
                costs=tuple(fmean(charge.cost for charge in charges) for charges in by_tariff),
                shares=tuple(map(_shares, by_tariff)),
                early=tuple(
                    fmean(_early(charge, score, most) for charge, score in zip(charges, scores, strict=True))
                    for charges, most in zip(by_tariff, dearest[family(cell)], strict=True)
                ),
            )
        )
    return costs


def cost_tables(cells: Sequence[CellCost], tariffs: Sequence[Tariff]) -> list[TextTable]:
    """Return the tables of costs: which window is cheapest under each tariff, and everything about every cell."""
    return [*flip_table(cells, tariffs), rules_table(cells, tariffs)]


def rules_table(cells: Sequence[CellCost], tariffs: Sequence[Tariff]) -> TextTable:
    """Return what every cell costs with a line for each tariff: an episode, a point of score, what is read and written.

    The cost of a point is left empty where the mean score is not above 0.
    """
    rows: list[tuple[str, ...]] = []
    for cell in cells:
        scored = f"score {cell.score:.4g} in {cell.steps:,.4g} steps"
        rows.append((f"{cell.title}, {cell.marked}: {scored}, {short(cell.tokens)} tokens",))
        figures = zip(tariffs, cell.costs, cell.early, cell.shares, strict=True)
        for tariff, cost, early, (read, written) in figures:
            point = _amount(cost / cell.score, tariff) if cell.score > 0 else NOTHING
            shares = percent(read), percent(written)
            rows.append((f"  {tariff.label}", _amount(cost, tariff), point, f"{early:.4g}", *shares))
    headings = columns("rule", "an episode", "a point", "area", "read", "written")
    notes = [UNIT, MODEL, AREA, "read, written: of the tokens of prompts"]
    return TextTable("what an episode and a point of score cost", headings, tuple(rows), (*notes, *_left_out(cells)))


def flip_table(cells: Sequence[CellCost], tariffs: Sequence[Tariff]) -> list[TextTable]:
    """Return which window is cheapest under each tariff; nothing if no player has several at a game."""
    rows: list[tuple[str, ...]] = []
    for title, members in _families(cells):
        if len(members) < 2:
            continue
        rows.append((title,))
        for at, tariff in enumerate(tariffs):
            costs = [cell.costs[at] for cell in members]
            first, last = members[costs.index(min(costs))], members[costs.index(max(costs))]
            figures = (_amount(first.costs[at], tariff), last.marked, _amount(last.costs[at], tariff))
            rows.append((f"  {tariff.label}", first.marked, *figures))
    words = Column("cheapest", words=True), Column("cost"), Column("dearest", words=True), Column("cost")
    notes = tuple(early_notes(map(_beside, cells)))
    return (
        [TextTable("which window is cheapest", (Column("rule", words=True), *words), tuple(rows), notes)]
        if rows
        else []
    )


def cost_rows(cells: Sequence[CellCost], tariffs: Sequence[Tariff]) -> list[dict[str, Any]]:
    """Return a flat row for every cell and tariff, with numbers in full precision."""
    return [
        {
            "game": cell.cell.game,
            "player": cell.cell.player,
            "cell": cell.title,
            "window": cell.window,
            "episodes": cell.episodes,
            "score": cell.score,
            "steps": cell.steps,
            "ended_early": sum(cell.ends.values()),
            "tokens": cell.tokens,
            "rule": tariff.rule.name,
            "tariff": tariff.label,
            "marks": "+".join(tariff.marks) if isinstance(tariff.rule.marks, int) else "auto",
            "unit": "tokens" if tariff.price is None else "USD",
            "cost": cost,
            "area": early,
            "read_share": read,
            "written_share": written,
            "cost_per_point": cost / cell.score if cell.score > 0 else None,
        }
        for cell in cells
        for cost, early, (read, written), tariff in zip(cell.costs, cell.early, cell.shares, tariffs, strict=True)
    ]


def _families(cells: Sequence[CellCost]) -> list[tuple[str, list[CellCost]]]:
    families = grouped(cells, lambda cell: (cell.title, family(cell.cell)))
    return [(title, members) for (title, _), members in families.items()]


def _amount(cost: float, tariff: Tariff) -> str:
    return short(cost) if tariff.price is None else dollars(cost)


def _left_out(cells: Sequence[CellCost]) -> list[str]:
    """What a reader has to know of these episodes: which are left out, and which ended early."""
    uncounted = sum(cell.uncounted for cell in cells)
    told = f"{uncounted} episodes have no usage or not what the model saw on record and are left out"
    return [*([told] if uncounted else []), *early_notes(map(_beside, cells))]


def _beside(cell: CellCost) -> Beside:
    return Beside(cell.cell.game, cell.score, cell.score, cell.steps, cell.ends)


def _early(charge: Charge, score: float, money: float) -> float:
    """The mean score of an episode while this much money is spent; its last score stays."""
    return (charge.area + score * (money - charge.cost)) / money if money else score


def _shares(charges: Sequence[Charge]) -> tuple[float, float]:
    prompt = sum(charge.prompt for charge in charges) or 1
    return sum(charge.hit for charge in charges) / prompt, sum(charge.written for charge in charges) / prompt
