"""The command `view`: a site over run folders, on this machine, and a game that a person plays there."""

from __future__ import annotations

import webbrowser
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import BUDGET, OTHERS, RULES, EpisodeOptions, with_episode_options
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.terminal import say

if TYPE_CHECKING:
    from smartplay_tools.web.site import BrowserGames

_option = partial(typer.Option, rich_help_panel="Play in the browser")
RECORDED = Path("human")
ANY = "any"
"""In place of a game: the page lets the person choose."""

FOR_PLAY = (*BUDGET, *RULES, *OTHERS, "seed", "pictures")
"""Options that say what is played."""


@with_episode_options()
def view(
    context: typer.Context,
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FOLDER]...", help="Run folders, or folders of some; by default this one.", show_default=False
        ),
    ] = None,
    play: Annotated[
        str | None,
        _option(
            metavar="GAME",
            help="Play this game in the browser as a model would; any lets you choose.",
        ),
    ] = None,
    out: Annotated[Path, _option(help="The folder of the run that you play; continued if it is there.")] = RECORDED,
    seed: Annotated[int, _option(help="The seed of the run that you play.", min=0)] = 0,
    pictures: Annotated[bool, _option("--pictures", help="Offer the game's pictures, if it has any.")] = False,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8010,
    allow_host: options.AllowHost = None,
    token: Annotated[
        str | None,
        typer.Option(
            help="The token that visitors need; drawn if the address is not local.", envvar="SMARTPLAY_VIEW_TOKEN"
        ),
    ] = None,
    plugins: options.Plugins = False,
    game: options.GameFiles = None,
    open_browser: Annotated[bool, typer.Option("--open", help="Open the site in a browser.")] = False,
    *,
    episode: EpisodeOptions,
) -> None:
    """Serve a site over run folders on this machine: runs, episodes, and what is being played now.

    The site is read-only. Other machines reach it only with --host, --allow-host and a token. With --play, you play a
    game there under an agent's window and budget, which the episode options set.

    Example: smartplay-tools view runs
    """
    from smartplay_tools.web.site import RunList, ViewServer

    playing, begin, to_play = _playing(context, play, out, episode, seed=seed, pictures=pictures)
    options.import_games(game)
    own = () if playing is None else (playing.folder,)
    runs = RunList(folders or ([] if playing else [Path()]), own=own)
    where: dict[str, Any] = {"host": host, "port": port, "token": token, "hosts": allow_host or ()}
    server = ViewServer(runs, play=playing, plugins=plugins, **where)
    count = len(runs.current())
    counted = "1 run" if count == 1 else f"{count} runs" if count else "No run yet (new ones appear)"
    served = counted if playing is None else f"{counted}, and {to_play} to play (recorded in {out}),"
    # The first address has the token; its page passes it on.
    entry = f"{server.url}{begin}" if server.entry == server.url else server.entry
    say(f"{served} at {entry} - Ctrl-C stops.", err=True)
    with playing or nullcontext():
        if open_browser:
            webbrowser.open(entry)
        server.run()


def _playing(
    context: typer.Context, play: str | None, out: Path, episode: EpisodeOptions, **how: Any
) -> tuple[BrowserGames | None, str, str]:
    """The games to play, if any, the page where they begin, and their name: one, or all that are here."""
    if play is None:
        given = options.on_command_line(context)
        for name in (*FOR_PLAY, "out"):
            if name in given:
                raise InvalidArgumentError(f"--{name.replace('_', '-')} is for --play GAME, which is missing.")
        return None, "", ""
    from smartplay_tools.games.specs import GAMES
    from smartplay_tools.web.site import BrowserGames

    how |= {"budget": episode.budget, **episode.of_cells}
    games = [name for name in GAMES if GAMES.is_loaded(name)] if play == ANY else [play]
    return BrowserGames(games, out, **how), "play", "games" if play == ANY else play
