"""The command `serve window`: a game's own context window behind OpenAI's interface, for any agent."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import EpisodeOptions, with_episode_options

ADAPTER = "smartplay_openai"
"""The adapter that serves windows; imported at first use."""


@with_episode_options(without=("protocol",))
def window(
    game: options.Game,
    player: Annotated[str, typer.Option(help="Who plays: openai:MODEL, anthropic:MODEL, rule, ...")] = "rule",
    base_url: options.BaseUrl = None,
    seed: options.Seed = 0,
    episodes: Annotated[int, typer.Option(help="Open N episodes, with consecutive seeds.", min=0)] = 1,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8000,
    allow_host: options.AllowHost = None,
    allow_origin: options.AllowOrigin = None,
    token: Annotated[
        str | None, typer.Option(help="The API key that agents send.", envvar="SMARTPLAY_WINDOW_TOKEN")
    ] = None,
    closing: Annotated[
        str, typer.Option(help="The tool with which an agent's framework closes a run.")
    ] = "final_answer",
    most: Annotated[int, typer.Option(help="How many episodes may be open.", min=1)] = 1000,
    idle: Annotated[float, typer.Option(help="Close an episode after N seconds without a request.")] = 1800.0,
    out: Annotated[
        Path | None, typer.Option(help="A folder for the transcripts; episodes then outlive a restart.")
    ] = None,
    *,
    episode: EpisodeOptions,
) -> None:
    """Serve a game's window as a model: an agent that uses it plays under the exact budget.

    The model of --player sees the window and nothing else. An agent's base_url is the address that is printed, its
    model smartplay/HANDLE, its tools those of the MCP address.

    Example: smartplay-tools serve window Hanoi3Disk-v0 --player openai:gpt-4o-mini --prompt-tokens 2000
    """
    from rich.console import Console

    from smartplay_tools.players import get_player

    where = {} if base_url is None else {"base_url": base_url}
    first = get_player(player, seed=seed, **where)
    one_for_all = getattr(first, "serves_many", False)
    players: Any = first if one_for_all else lambda of_seed: get_player(player, seed=of_seed, **where)
    settings: dict[str, Any] = {"budget": episode.budget, "engine": episode.engine, "tokenizer": episode.tokenizer}
    settings |= {**episode.rules, **episode.options}
    names = {"hosts": allow_host or (), "origins": allow_origin or ()}
    endpoint = importlib.import_module(ADAPTER).WindowEndpoint(
        players, host=host, port=port, token=token, closing=closing, folder=out, most=most, idle=idle, **names
    )
    console = Console()
    line = f"base_url {endpoint.base_url}  ({player} plays; stop with Ctrl-C)"
    console.print(line, highlight=False, soft_wrap=True)
    for number in range(episodes):
        handle = endpoint.open(game, seed=seed + number, **settings)
        line = f"model {endpoint.model(handle)}  MCP {endpoint.mcp_url(handle)}  seed {seed + number}"
        console.print(line, highlight=False, soft_wrap=True)
    endpoint.run()
