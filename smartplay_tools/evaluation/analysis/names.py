"""The names of series and cells in figures and tables, as short as possible but distinct."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from smartplay_tools.evaluation.analysis.grouping import PlayedCell
from smartplay_tools.evaluation.analysis.windows import WINDOW, WindowComparison
from smartplay_tools.types import STRATEGIES, Budget


def series_name(comparison: WindowComparison, among: Sequence[WindowComparison]) -> str:
    """Return the player, and whatever else distinguishes its cells from others of the same game in the figure."""
    own = _facts(comparison.cell)
    rivals = [_facts(other.cell) for other in among if other.cell.game == comparison.cell.game]
    differing = [name for name in own if len({rival[name] for rival in rivals}) > 1]
    return ", ".join([comparison.cell.player, *(f"{name} {own[name]}" for name in differing)])


def _facts(cell: PlayedCell) -> dict[str, str]:
    others = {name: getattr(cell, name) for name in ("engine", "tokenizer", "options", "player_options")}
    return {name: str(value) for name, value in {**cell.rules, **others}.items()}


def strategy_name(cell: PlayedCell) -> str:
    """Return what the budget of a cell does with the past, which may be dropping alone."""
    return _part(cell, STRATEGIES).describe() or Budget().words()["beyond_history"]


def window_name(cell: PlayedCell) -> str:
    """Return a description of a cell's window: history 5, prompts <= 1,000, slack 0.5."""
    return _part(cell, WINDOW).describe()


def _part(cell: PlayedCell, fields: Iterable[str]) -> Budget:
    return Budget(**{name: cell.budget[name] for name in fields})
