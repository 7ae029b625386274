"""Sweeps: runs that play the same episodes with every window of a grid, to measure the effect of smaller contexts.

A grid is the axes that vary (fields of the budget, manual, observation) x players x games. Every cell has the same
seeds, because the seed of a trial depends only on the run's seed, the game and the trial, so cells can be compared in
pairs (`analysis.windows`). A sweep is a run like any other: it can be resumed, capped, sharded and replayed, and runs
in parallel. In addition to the run's files its folder has

    table.csv    a row for each episode (`analysis.tables`)
    summary.csv  a row for each cell (`analysis.windows.as_row`)
    figures/     the figures, as PNG, SVG and PDF (`figures`)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any, Self, Unpack

from smartplay_tools.context.strategies.custom import load_strategy, refused_with
from smartplay_tools.episode.budgets import refused_strategy
from smartplay_tools.episode.config import CellConfig, Rules
from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.evaluation.analysis.formats import rows_to_csv, to_html
from smartplay_tools.evaluation.analysis.tables import write_csv
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import WindowComparison, as_row, compare_windows
from smartplay_tools.evaluation.runs.plan import cell_name, check_playable, make_cells, plan_episodes, player_of
from smartplay_tools.evaluation.runs.players import PlayerConfig, Players, read_players
from smartplay_tools.evaluation.runs.run_options import RunKeywords, RunOptions
from smartplay_tools.evaluation.runs.runner import Run, run_plan
from smartplay_tools.evaluation.suites import suite_games
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.games.specs import get_spec
from smartplay_tools.types import Budget

SUMMARY = "summary.csv"
"""The file of a sweep's cells in its folder."""

RULE_AXES = ("manual", "observation")
"""The rules that a sweep can vary."""

AXES = (*Budget.model_fields, *RULE_AXES)
"""What a sweep can vary."""


@dataclass(frozen=True, repr=False)
class Sweep(Run):
    """A sweep, as returned by `sweep`: a run of a grid, with its comparisons."""

    left_out: tuple[str, ...] = ()
    """A sentence for every combination of the grid that cannot be enforced and was not played."""

    @classmethod
    def of(cls, run: Run, cells: Grid) -> Self:
        """Return a run of a grid as a sweep."""
        return cls(**vars(run), left_out=cells.left_out)

    def _repr_html_(self) -> str:
        table = to_html([windows_table(self.comparisons)]) if self.comparisons else ""
        return f"<p>{len(self.rows)} of {self.planned} episodes finished</p>\n{table}"

    @cached_property
    def comparisons(self) -> list[WindowComparison]:
        """The comparison of every cell with the reference of its family."""
        return compare_windows(self.rows)

    @property
    def summary(self) -> list[dict[str, Any]]:
        """A flat row for every cell: means, paired differences, their intervals, the fronts."""
        return [as_row(comparison) for comparison in self.comparisons]

    def write(self) -> list[Path]:
        """Write tables and figures into the run's folder and return their paths.

        Figures need the extra `evaluation`; without it they are left out.
        """
        folder = self.folder.path
        written = [folder / "table.csv", folder / SUMMARY]
        write_csv(self.rows, written[0])
        written[1].write_text(rows_to_csv(self.summary), encoding="utf-8", newline="")
        try:
            from smartplay_tools.evaluation.analysis.figures.run import write_figures

            written += write_figures(self.rows, folder / "figures")
        except MissingExtraError:
            pass
        return written


@dataclass(frozen=True)
class Grid:
    """The cells of a grid."""

    cells: list[CellConfig]
    """Game by game, player by player, and within them from the first values to the last."""
    left_out: tuple[str, ...]
    """A sentence for every combination that cannot be enforced."""


def grid(
    games: Sequence[str],
    players: Sequence[str | PlayerConfig],
    *,
    vary: Mapping[str, Sequence[Any]] | None = None,
    budget: Budget | None = None,
    **rules: Any,
) -> Grid:
    """Return the cells of a grid.

    `vary` has lists of values by axis (`AXES`); `budget` holds the fields that do not vary, `rules` are those of
    `make_cells`. A value that is named twice, or by a number and as "game", makes one cell. Combinations whose strategy
    cannot be enforced, such as summaries at slack 0, are left out and named.
    """
    games, axes = suite_games(None, games), _axes(vary or {})
    varied = {name: axes.pop(name, ()) or [rules.pop(name, getattr(Rules(), name))] for name in RULE_AXES}
    fixed = dict(budget or Budget())
    budgets = [Budget(**fixed | dict(zip(axes, values, strict=True))) for values in product(*axes.values())]
    protocol = rules.get("protocol", "tools")
    left_out: list[str] = []

    def enforceable(spec: GameSpec, observation: str) -> list[Budget]:
        allowed = []
        for each in budgets:
            which = {"context": "window", "protocol": protocol, "observation": observation}
            reason = refused_strategy(each, spec, **which)
            if reason is None and each.strategy is not None:
                reason = refused_with(load_strategy(each.strategy).make, each)
            if reason:
                left_out.append(f"{spec.id}, {each.describe()}: {reason}")
            else:
                allowed.append(each)
        return allowed

    wanted: list[CellConfig] = []
    for values in product(*varied.values()):
        chosen = dict(zip(varied, values, strict=True))
        allowed = partial(enforceable, observation=chosen["observation"])
        wanted += make_cells(games, players, allowed, **chosen, **rules)
    files = [(spec.id, spec.sha256) for spec in map(get_spec, games)]
    names = [player if isinstance(player, str) else player.name for player in players]
    wanted.sort(key=lambda cell: (files.index((cell.game, cell.game_sha256)), names.index(player_of(cell))))
    cells: dict[str, CellConfig] = {}
    for cell in wanted:
        try:
            if cell.budget.strategies:  # prompts that are too small for the game alone are refused by planning
                check_playable(cell)
            cells.setdefault(_identity(cell), cell)
        except InvalidArgumentError as error:
            left_out.append(f"{cell_name(cell)}: {error}")
    if not cells:
        raise InvalidArgumentError("The grid has no combination that can be played. " + " ".join(left_out))
    return Grid(list(cells.values()), tuple(dict.fromkeys(left_out)))


def _axes(vary: Mapping[str, Sequence[Any]]) -> dict[str, Sequence[Any]]:
    """Return the axes in their order."""
    if unknown := ", ".join(name for name in vary if name not in AXES):
        raise InvalidArgumentError(f"A sweep cannot vary {unknown}; its axes are {', '.join(AXES)}.")
    for name, values in vary.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not values:
            raise InvalidArgumentError(f"{name} must be a list of at least one value, such as [{values!r}].")
    return {name: vary[name] for name in AXES if name in vary}


def sweep(
    games: Sequence[str],
    players: Players,
    *,
    out: str | Path,
    vary: Mapping[str, Sequence[Any]] | None = None,
    budget: Budget | None = None,
    trials: int | None = None,
    seed: int = 0,
    **options: Unpack[RunKeywords],
) -> Sweep:
    """Play a grid of windows on paired seeds, and keep the records in the folder `out`. The same call again resumes it.

    `games`, `players`, `trials` (episodes of every cell) and all arguments that are not named here are those of
    `evaluate`. `vary` has lists of values for fields of `Budget`, where None means no limit, for `manual` and for
    `observation`: `vary={"history": [1, 5], "prompt_tokens": [700, None]}`. `budget` holds the fields that are the same
    in every cell. Combinations that cannot be enforced are left out and named (`Sweep.left_out`). Tables and figures
    are written only by `Sweep.write`.
    """
    if not games or not players:
        raise InvalidArgumentError("Name at least one game and one player.")
    run_options, rules = RunOptions.split(options)
    configs = read_players(players)
    cells = grid(games, configs, vary=vary, budget=budget, **rules)
    run = run_plan(plan_episodes(cells.cells, trials=trials, seed=seed), out, configs, run_options)
    return Sweep.of(run, cells)


def _identity(cell: CellConfig) -> str:
    """A key that is equal for cells with the same episodes: the cell, with "game" replaced by the number of steps."""
    history = cell.setting.history if cell.budget.history == "game" else cell.budget.history
    return cell.model_copy(update={"budget": cell.budget.model_copy(update={"history": history})}).digest
