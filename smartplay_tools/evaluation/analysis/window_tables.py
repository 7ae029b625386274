"""A sweep as a table: every window, compared with the full context of its family.

The names of series and cells in figures and tables, as short as possible but distinct.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter

from smartplay_tools.evaluation.analysis.formats import (
    NOTHING,
    TextTable,
    columns,
    decimals_of,
    dollars,
    interval_notes,
    percent,
    with_interval,
)
from smartplay_tools.evaluation.analysis.grouping import USUAL, PlayedCell, in_words
from smartplay_tools.evaluation.analysis.headline import CUT, MANY_CUTS, is_much_cut
from smartplay_tools.evaluation.analysis.windows import LIMITS, WINDOW, WindowComparison
from smartplay_tools.evaluation.quantities import short
from smartplay_tools.records.rows import grouped
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import STRATEGIES, Budget, ResolvedBudget


def series_name(comparison: WindowComparison, among: Sequence[WindowComparison]) -> str:
    """Return the player, and whatever else distinguishes its cells from others of the same game in the figure."""
    own = _facts(comparison.cell)
    rivals = [other.cell for other in among if other.cell.game == comparison.cell.game]
    facts = [_facts(rival) for rival in rivals]
    differing = [f"{name} {own[name]}" for name in own if len({each[name] for each in facts}) > 1]
    return ", ".join([comparison.cell.player, *differing, *_in_words(comparison.cell, _differing_limits(rivals))])


def _facts(cell: PlayedCell) -> dict[str, str]:
    others = {name: getattr(cell, name) for name in ("engine", "tokenizer", "options", "player_options")}
    return {name: str(value) for name, value in {**cell.rules, **others}.items()}


def strategy_name(cell: PlayedCell) -> str:
    """Return what the budget of a cell does with the past, which may be dropping alone."""
    return _part(cell, STRATEGIES).describe() or Budget().words()["beyond_history"]


def family_titles(cells: Sequence[PlayedCell]) -> list[str]:
    """Return what each cell has in common with those that differ only in their window: game, player, unusual rules.

    Engine, options and tokenizer follow where they tell the families of a player at a game apart.
    """
    rivals = grouped(cells, lambda cell: (cell.game, cell.player))
    made = {key: [*map(_made, members)] for key, members in rivals.items()}
    return [", ".join(_title(cell, made[cell.game, cell.player])) for cell in cells]


def _title(cell: PlayedCell, made: Sequence[Sequence[str]]) -> Iterator[str]:
    yield from (cell.game, cell.player)
    yield from (f"{name} {value}" for name, value in cell.rules.items() if value != USUAL[name])
    yield from (words for words in _made(cell) if not all(words in each for each in made))


def _made(cell: PlayedCell) -> list[str]:
    """What a cell is of beside its rules and its budget, in words."""
    given = [*in_words(cell.options), *in_words(cell.player_options)]
    return [f"engine {cell.engine}", f"tokenizer {cell.tokenizer}", *given]


def window_name(cell: PlayedCell) -> str:
    """Return a description of a cell's window: history 5, prompts <= 1,000, slack 0.5."""
    return _part(cell, WINDOW).describe()


def window_names(cells: Sequence[PlayedCell]) -> list[str]:
    """Return a description of each cell's window; those with the same one are told apart by their other caps."""
    groups = grouped(cells, lambda cell: (cell.game, cell.player))
    differing = {player: _differing_limits(members) for player, members in groups.items()}
    return [", ".join([window_name(cell), *_in_words(cell, differing[cell.game, cell.player])]) for cell in cells]


def _differing_limits(cells: Sequence[PlayedCell]) -> list[str]:
    """The caps, other than of the window, in which cells that have the same window differ."""
    varied = [name for name in LIMITS if len({cell.budget[name] for cell in cells}) > 1]
    same = grouped(cells, _window_key).values() if varied else ()
    return [name for name in varied if any(len({cell.budget[name] for cell in members}) > 1 for members in same)]


def _window_key(cell: PlayedCell) -> bytes:
    return canonical_json([*_facts(cell).values(), cell.player, *(cell.budget[name] for name in WINDOW)])


def _in_words(cell: PlayedCell, limits: Iterable[str]) -> list[str]:
    words = ResolvedBudget(**cell.budget).words()
    return [words[name] for name in limits]


def _part(cell: PlayedCell, fields: Iterable[str]) -> Budget:
    return Budget(**{name: cell.budget[name] for name in fields})


NOTES = (
    "+-: to full context, paired by seed; [ ]: 95 % interval",
    "tokens: prompts and replies of an episode; stable: of its prompts, in a prefix that did not change",
    "*: on the game's Pareto front of score against tokens",
)
TOGETHER = "the intervals of the {compared} differences hold together in 95 of 100 sweeps (Bonferroni)"
SINGLE = "the intervals of the {compared} differences hold each by itself: of twenty, one is expected to miss"
COST_NOTE = "$: on the front of score against cost; USD: of an episode"
CUT_NOTE = (
    f"{CUT}: at least {MANY_CUTS:.0%} of the tool results were cut, so the difference is not one of memory alone; "
    "docs/experiments.md lists the caps from which on nothing is cut"
)


def windows_table(comparisons: Sequence[WindowComparison], *, single: bool = False) -> TextTable:
    """Return the table of a sweep, with a heading for each family of cells.

    The intervals of differences hold together, or with `single` each by itself.
    """
    differences = [c.differences.get("score") if single else c.together for c in comparisons]
    compared = sum(difference is not None for difference in differences)
    priced = any("cost" in c.means and c.means["cost"].mean for c in comparisons)
    rows: list[tuple[str, ...]] = []
    titled = zip(family_titles([c.cell for c in comparisons]), comparisons, strict=True)
    for title, pairs in grouped(titled, itemgetter(0)).items():
        members = [comparison for _, comparison in pairs]
        decimals = decimals_of(c.means["score"] for c in members)
        rows.append((title,))
        for name, comparison in zip(window_names([c.cell for c in members]), members, strict=True):
            rows.append((f"  {name}", *_figures(comparison, decimals, priced=priced, single=single)))
    headings = columns("window", "n", "score", "+-", "tokens", "stable", *(["USD"] if priced else []), "")
    held = (SINGLE if single else TOGETHER).format(compared=compared)
    notes = [
        *([held] if compared > 1 else []),
        *NOTES,
        *interval_notes([*(c.means["score"] for c in comparisons), *differences]),
        *([COST_NOTE] if priced else []),
        *([CUT_NOTE] if any(map(is_cut, comparisons)) else []),
    ]
    return TextTable("windows", headings, tuple(rows), tuple(notes))


def is_cut(comparison: WindowComparison) -> bool:
    """Whether too many results of a cell were cut for its score to measure its window alone."""
    return is_much_cut(comparison.cut_share)


def _figures(comparison: WindowComparison, decimals: int, *, priced: bool, single: bool) -> tuple[str, ...]:
    means = comparison.means
    share, cost = means.get("prefix_share"), means.get("cost")
    difference = comparison.differences.get("score") if single else comparison.together
    compared = "no pairs" if difference is None else with_interval(difference, decimals, sign="+")
    marks = ("*" if comparison.on_token_front else "") + ("$" if priced and comparison.on_cost_front else "")
    return (
        f"{comparison.episodes}",
        with_interval(means["score"], decimals),
        "full context" if comparison.is_full else compared,
        short(means["tokens"].mean),
        NOTHING if share is None else percent(share.mean),
        *([NOTHING if cost is None else dollars(cost.mean)] if priced else []),
        marks + CUT * is_cut(comparison),
    )
