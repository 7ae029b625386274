"""The commands `serve ...`, which serve players and games to other programs."""

from __future__ import annotations

import importlib
from typing import Annotated

import typer

from smartplay_tools.cli import options, serve_mcp, serve_window

ENDPOINT = "smartplay_openai"
"""The adapter that serves players; imported at first use."""

app = typer.Typer(help="Serve players and games to other programs.", no_args_is_help=True)


app.command("mcp")(serve_mcp.mcp)
app.command("window")(serve_window.window)


@app.command("openai")
def openai(
    player: Annotated[
        list[str] | None, typer.Option(help="The players that answer: rule, random, ...; repeatable.")
    ] = None,
    seed: options.Seed = 0,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8000,
    allow_host: options.AllowHost = None,
    allow_origin: options.AllowOrigin = None,
    api_key: Annotated[
        str | None, typer.Option(help="A key that requests must have.", envvar="SMARTPLAY_ENDPOINT_KEY")
    ] = None,
    context_tokens: Annotated[
        int | None, typer.Option(help="Refuse longer prompts with context_length_exceeded.", min=1)
    ] = None,
    busy_every: Annotated[
        int | None, typer.Option(help="Refuse one of this many requests with status 429.", min=2)
    ] = None,
) -> None:
    """Serve players of this package as OpenAI's chat completions and Responses; a request's model is a player's name.

    Example: smartplay-tools serve openai --player rule --port 8000
    """
    from rich.console import Console

    from smartplay_tools.players import get_player

    players = [get_player(name, seed=seed) for name in player or ["rule"]]
    adapter = importlib.import_module(ENDPOINT)
    limits = adapter.SimulatedLimits(context_tokens=context_tokens, busy_every=busy_every)
    names = {"hosts": allow_host or (), "origins": allow_origin or ()}
    endpoint = adapter.LocalEndpoint(*players, host=host, port=port, api_key=api_key, limits=limits, **names)
    console = Console()
    models = ", ".join(player.name for player in players)
    console.print(f"{endpoint.base_url} answers as {models}; stop with Ctrl-C.", highlight=False, soft_wrap=True)
    try:
        endpoint.run()
    except KeyboardInterrupt:
        console.print("stopped")
