"""The command `view`: a site over run folders, on this machine, and a game that a person plays there."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import BUDGET, OTHERS, RULES, EpisodeOptions, with_episode_options
from smartplay_tools.errors import InvalidArgumentError

if TYPE_CHECKING:
    from smartplay_tools.evaluation.pages.view import RunList
    from smartplay_tools.evaluation.runs import BrowserGames, BrowserPlay

_PLAY = "Play in the browser"
ANY = "any"
"""In place of a game: the page lets the person choose."""

ONLY_FOR_PLAY = (*BUDGET, *RULES, *OTHERS, "out", "seed", "pictures")


@with_episode_options()
def view(
    context: typer.Context,
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FOLDER]...", help="Run folders, or folders that hold some; this one.", show_default=False
        ),
    ] = None,
    play: Annotated[
        str | None,
        typer.Option(
            metavar="GAME",
            help="Play this game in the browser, as a model would; any: choose.",
            rich_help_panel=_PLAY,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="The folder of the run that you play; continued if it is there.", rich_help_panel=_PLAY)
    ] = Path("human"),
    seed: Annotated[int, typer.Option(help="The seed of the run that you play.", min=0, rich_help_panel=_PLAY)] = 0,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Offer the game's pictures, if it has any.", rich_help_panel=_PLAY)
    ] = False,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8010,
    allow_host: options.AllowHost = None,
    token: Annotated[
        str | None,
        typer.Option(
            help="What a visitor has to show; drawn if the address is not local.", envvar="SMARTPLAY_VIEW_TOKEN"
        ),
    ] = None,
    plugins: options.Plugins = False,
    annotate: Annotated[
        bool, typer.Option("--annotate", help="Let visitors write notes about turns, kept beside the records.")
    ] = False,
    open_browser: Annotated[bool, typer.Option("--open", help="Open the site in a browser.")] = False,
    *,
    episode: EpisodeOptions,
) -> None:
    """Serve a site over run folders on this machine: runs, episodes, and what is being played now.

    The site is read-only. Other machines reach it only with --host, --allow-host and a token. With --play, you play a
    game in it under the window and the budget of an agent; the episode options are for that.

    Example: smartplay-tools view runs
    """
    from smartplay_tools.evaluation.pages.view import RunList, ViewServer

    playing = None if play is None else _play(play, out, seed, episode, pictures=pictures)
    if playing is None:
        _check_no_play(context)
        runs = RunList(folders or [Path()])
    else:
        runs = _runs_with(playing, folders or [])
    server = ViewServer(
        runs,
        host=host,
        port=port,
        token=token,
        hosts=allow_host or (),
        play=playing,
        plugins=plugins,
        annotate=annotate,
    )
    count = len(runs.current())
    counted = "1 run" if count == 1 else f"{count} runs" if count else "No run yet, but new ones appear,"
    to_play = "games" if play == ANY else play
    served = counted if playing is None else f"{counted}, and {to_play} to play (recorded in {out}),"
    typer.echo(f"{served} at {server.entry} - Ctrl-C stops.", err=True)
    with playing or nullcontext():
        if open_browser:
            webbrowser.open(server.entry)
        server.run()


def _runs_with(playing: BrowserPlay | BrowserGames, folders: Sequence[Path]) -> RunList:
    """The runs of a site in which a person plays, and those of other folders."""
    from smartplay_tools.evaluation.pages.view import RunList, SiteRun
    from smartplay_tools.evaluation.runs import BrowserPlay

    if isinstance(playing, BrowserPlay):
        own = playing.folder.path.resolve()
        return RunList(folders, always=[SiteRun(own, own.name)])
    playing.folder.mkdir(parents=True, exist_ok=True)
    return RunList([playing.folder, *folders])


def _play(game: str, out: Path, seed: int, episode: EpisodeOptions, *, pictures: bool) -> BrowserPlay | BrowserGames:
    from smartplay_tools.evaluation.runs import BrowserGames, BrowserPlay
    from smartplay_tools.games.specs import GAMES

    chosen: dict[str, Any] = {
        "budget": episode.budget,
        "seed": seed,
        "pictures": pictures,
        "options": episode.options,
        "engine": episode.engine,
        "tokenizer": episode.tokenizer,
        **episode.rules,
    }
    if game != ANY:
        return BrowserPlay(game, out, **chosen)
    return BrowserGames([name for name in GAMES if GAMES.is_loaded(name)], out, **chosen)


def _check_no_play(context: typer.Context) -> None:
    """Options that would have no effect are a mistake."""
    for name in ONLY_FOR_PLAY:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise InvalidArgumentError(f"--{name.replace('_', '-')} is for --play GAME, which is missing.")
