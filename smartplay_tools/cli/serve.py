"""The commands `serve ...`, which serve players and games to other programs."""

from __future__ import annotations

import importlib
from typing import Annotated

import typer

from smartplay_tools.cli import options, serve_mcp, serve_window
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.terminal import say

ENDPOINT = "smartplay_gateway"
"""The adapter that serves players; imported at first use."""

app = typer.Typer(no_args_is_help=True)


app.command("mcp")(serve_mcp.mcp)
app.command("window")(serve_window.window)


@app.command("openai")
def openai(
    player: Annotated[
        list[str] | None, typer.Option(help="The players that answer: rule, local, local:FILE.gguf, ...; repeatable.")
    ] = None,
    player_option: options.PlayerOptions = None,
    name: Annotated[
        str | None,
        typer.Option(help="The name under which one player is served; its own if not given."),
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
) -> None:
    """Serve players of this package as OpenAI's chat completions and Responses; a request's model is a player's name.

    With `--player local`, a real model answers without a key, whose calls are well-formed by construction.

    Example: smartplay-tools serve openai --player rule --port 8000
    """
    from smartplay_tools.cli.runs import player_configs
    from smartplay_tools.players import get_player

    configs = player_configs(player or ["rule"], None, player_option)
    players = [get_player(config.name, seed=seed, **config.options) for config in configs]
    if name is not None:
        if len(players) > 1:
            raise InvalidArgumentError(f"--name is for one player, and these are {len(players)}.")
        players[0].name = name
    adapter = importlib.import_module(ENDPOINT)
    endpoint = adapter.LocalEndpoint(
        *players,
        context_tokens=context_tokens,
        host=host,
        port=port,
        api_key=api_key,
        hosts=allow_host or (),
        origins=allow_origin or (),
    )
    models = ", ".join(player.name for player in players)
    say(f"{endpoint.base_url} answers as {models}; stop with Ctrl-C.")
    try:
        endpoint.run()
    except KeyboardInterrupt:
        say("stopped")
