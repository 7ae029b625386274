"""The commands `sweep`, which plays the same episodes with every window of a grid, and `merge`, which joins shards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import runs
from smartplay_tools.cli.episode_options import GRID, EpisodeOptions, listed, with_episode_options
from smartplay_tools.cli.formats import FormatOption, print_tables
from smartplay_tools.cli.options import Format
from smartplay_tools.cli.results import print_next
from smartplay_tools.cli.show import table_console
from smartplay_tools.evaluation.analysis.remembering import remembering_tables
from smartplay_tools.evaluation.analysis.window_tables import points_tables, windows_table
from smartplay_tools.evaluation.runs.merge import merge as merge_parts
from smartplay_tools.evaluation.runs.plan import plan_episodes
from smartplay_tools.evaluation.runs.sweeps import AXES, Sweep, grid
from smartplay_tools.installation import install_command
from smartplay_tools.terminal import say


def _listed(name: str, text: str) -> Any:
    return typer.Option(name, metavar="LIST", help=text, rich_help_panel=GRID)


@with_episode_options(without=(), vary=AXES)
@runs.with_run_options(out="sweep")
def sweep(
    games: Annotated[str, _listed("--games", "Ids of settings.")],
    players: Annotated[str, _listed("--players", "Names of players.")] = "rule",
    form: FormatOption = Format.TEXT,
    *,
    run: runs.RunCommand,
    episode: EpisodeOptions,
) -> None:
    """Play a grid of context windows on the same seeds, and print what smaller windows cost and save.

    Example: smartplay-tools sweep --games BanditTwoArmedHighLowFixed-v0 --history 1,5,50 --trials 20 --out runs/sweep
    """
    configs = run.players(listed("--players", players))
    cells = grid(listed("--games", games), configs, vary=episode.vary, **episode.of_cells)
    form = Format.JSON if run.as_json else form
    for reason in cells.left_out:
        say(f"Left out: {reason}", err=True)
    done = run.play(plan_episodes(cells.cells, trials=run.trials, seed=run.seed), configs)
    if done is None:
        return
    swept = Sweep.of(done, cells)
    written = swept.write()
    shown = [windows_table(swept.comparisons), *points_tables(swept.comparisons)]
    tables = [*shown, *remembering_tables(swept.rows)]
    print_tables(form, tables, swept.summary, swept.summary)
    if form is Format.TEXT:
        _print_files(done.folder.path, written)
    runs.conclude(done, quiet=run.as_json)


def _print_files(folder: Path, written: Sequence[Path]) -> None:
    """Print what was written, and what to do next."""
    names = dict.fromkeys(path.relative_to(folder).parts[0] for path in sorted(written))
    say(f"In {folder}: {', '.join(names)}.")
    if "figures" not in names:
        say(f"For figures: {install_command('evaluation')}")
    print_next(table_console(), [folder])


def merge(
    parts: Annotated[list[Path], typer.Argument(help="Folders of the run's shards.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The new folder for the whole run.")],
) -> None:
    """Merge the shards of a run.

    It exits with code 1 if planned episodes are missing.

    Example: smartplay-tools merge runs/part1 runs/part2 --out runs/whole
    """
    whole = merge_parts(parts, out)
    finished, planned = len(whole.rows()), len(whole.manifest().episodes)
    say(f"{out}: {finished} of {planned} episodes are finished.")
    if finished < planned:
        raise typer.Exit(1)
