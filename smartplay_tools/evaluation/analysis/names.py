"""The names of series and cells in figures and tables, as short as possible but distinct."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from smartplay_tools.evaluation.analysis.grouping import USUAL, PlayedCell, in_words
from smartplay_tools.evaluation.analysis.windows import LIMITS, WINDOW, WindowComparison
from smartplay_tools.types import STRATEGIES, Budget, ResolvedBudget
from smartplay_tools.types.groups import grouped


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


def way_name(cell: PlayedCell) -> str:
    """Return the strategy of a cell and, if there is any, its slack."""
    slack = cell.budget["slack"]
    return strategy_name(cell) + (f", slack {slack:g}" if slack else "")


def apart(labels: Sequence[str]) -> tuple[list[str], str]:
    """Return labels without the parts that all of them have, and these parts."""
    parts = [label.split(", ") if label else [] for label in labels]
    shared = [part for part in (parts[0] if parts else []) if all(part in other for other in parts)]
    return [", ".join(part for part in own if part not in shared) for own in parts], ", ".join(shared)


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
    yield from _made_apart(cell, made)


def _made_apart(cell: PlayedCell, made: Sequence[Sequence[str]]) -> Iterator[str]:
    """What of `_made` tells a cell apart from its rivals, of which `made` is given."""
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
    names = [", ".join([window_name(cell), *_in_words(cell, differing[cell.game, cell.player])]) for cell in cells]
    return _with_paths(names, cells)


def _with_paths(names: Sequence[str], cells: Sequence[PlayedCell]) -> list[str]:
    """Names with the path of the strategy where strategies of one file name in several folders have the same."""
    keys = [(cell.game, cell.player, name) for cell, name in zip(cells, names, strict=True)]
    alike = grouped(zip(keys, cells, strict=True), lambda pair: pair[0])
    several = {key for key, own in alike.items() if len({cell.budget.get("strategy") for _, cell in own}) > 1}
    named = zip(keys, cells, strict=True)
    return [f"{key[-1]}, {cell.budget['strategy']}" if key in several else key[-1] for key, cell in named]


def _differing_limits(cells: Sequence[PlayedCell]) -> list[str]:
    """The caps, other than of the window, in which cells that have the same window differ."""
    varied = [name for name in LIMITS if len({cell.budget[name] for cell in cells}) > 1]
    same = grouped(cells, lambda cell: cell.key(without=cell.budget.keys() - WINDOW)).values() if varied else ()
    return [name for name in varied if any(len({cell.budget[name] for cell in members}) > 1 for members in same)]


def _in_words(cell: PlayedCell, limits: Iterable[str]) -> list[str]:
    words = ResolvedBudget(**cell.budget).words()
    return [words[name] for name in limits]


def _part(cell: PlayedCell, fields: Iterable[str]) -> Budget:
    return Budget(**{name: cell.budget[name] for name in fields})
