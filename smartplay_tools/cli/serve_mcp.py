"""The command `serve mcp`: a game for MCP hosts, on stdio or over HTTP."""

from __future__ import annotations

import asyncio
import importlib
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import OF_RUNS, EpisodeOptions, with_episode_options
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.specs import get_spec
from smartplay_tools.streams import keep_streams
from smartplay_tools.terminal import say
from smartplay_tools.types import STRATEGIES

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode

NOT_ENFORCED = (
    *("prompt_tokens", "reply_tokens", "episode_tokens", "episode_cost", "cost_rule", "slack", "batch", "protocol"),
    *STRATEGIES,
    *OF_RUNS,
)
"""Options that cannot be enforced where the host decides what the model sees."""

PATIENCE = 10.0
"""Seconds in which another server that plays the same record may end."""

ADAPTER = "smartplay_mcp"
"""The adapter that serves games; imported at first use."""


@with_episode_options(without=NOT_ENFORCED)
def mcp(
    game: options.Game,
    seed: options.Seed = 0,
    transcript: Annotated[
        Path | None, typer.Option(help="On stdio: the file of the record. If it exists, its episode is continued.")
    ] = None,
    http: Annotated[bool, typer.Option("--http", help="Serve many episodes over HTTP, not one on stdio.")] = False,
    host: options.Host = "127.0.0.1",
    port: options.Port = 8000,
    allow_host: options.AllowHost = None,
    allow_origin: options.AllowOrigin = None,
    token: Annotated[str | None, typer.Option(help="The bearer token of agents.", envvar="SMARTPLAY_MCP_TOKEN")] = None,
    episodes: Annotated[
        int, typer.Option(help="Open this many episodes at the start, with consecutive seeds.", min=0)
    ] = 1,
    most: Annotated[int, typer.Option(help="How many episodes may be open.", min=1)] = 1000,
    idle: Annotated[float, typer.Option(help="Close an episode after this many seconds without a call.")] = 1800.0,
    out: Annotated[
        Path | None, typer.Option(help="A folder for the transcripts; episodes then survive a restart.")
    ] = None,
    *,
    episode: EpisodeOptions,
) -> None:
    """Serve a game to MCP hosts: one episode on stdio or, with --http, many episodes with an address each.

    Example: smartplay-tools serve mcp Hanoi3Disk-v0 --seed 7
    """
    if http and transcript is not None:
        raise InvalidArgumentError("--transcript records the episode on stdio; with --http, give a folder by --out.")
    if out is not None and not http:
        raise InvalidArgumentError("--out is for episodes over HTTP; on stdio, give the record's file by --transcript.")
    settings = {**episode.conditions, **episode.options}
    if not http:
        with keep_streams():
            get_spec(game)  # no record imports its game's file
            _serve_one(importlib.import_module(ADAPTER), game, transcript, seed=seed, **settings)
        return
    get_spec(game)
    adapter = importlib.import_module(ADAPTER)
    from smartplay_tools.web import EpisodeStore

    store = EpisodeStore(folder=out, most=most, idle=idle)
    names = {"hosts": allow_host or (), "origins": allow_origin or ()}
    server = adapter.HttpServer(store, host=host, port=port, token=token, **names)
    for number in range(episodes):
        handle = store.open(game, seed=seed + number, **settings)
        say(f"{server.url}/mcp/{handle}  seed {seed + number}")
    say("Stop with Ctrl-C.")
    server.run()


def _serve_one(adapter: Any, game: str, transcript: Path | None, /, **settings: Any) -> None:
    """Serve one episode on standard input and output."""
    with ExitStack() as held:

        def make() -> Episode:
            if transcript is not None:
                held.enter_context(_only_server_of(transcript))
            opened: Episode = adapter.open_episode(game, transcript=transcript, **settings)
            return opened

        opened = asyncio.run(adapter.serve_stdio(make))
        if transcript is None:
            opened.close()  # otherwise the record stays open, and the next start continues it


def _only_server_of(record: Path) -> AbstractContextManager[object]:
    """Wait until no other server plays a record, because two at once would write over each other; `with` lets it go.

    A host that starts a server for each call starts several at once, each of which ends after its call.
    """
    from filelock import FileLock, Timeout

    record.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(f"{record}.lock", timeout=PATIENCE, thread_local=False)  # released in another thread
    try:
        return lock.acquire()
    except Timeout:
        raise InvalidArgumentError(
            f"Another server plays the episode of {record}; stop that one, or name another file."
        ) from None
