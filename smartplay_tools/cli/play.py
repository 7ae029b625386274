"""The command `play`: one episode, shown as it happens."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from smartplay_tools.cli import options
from smartplay_tools.cli.episode_options import EpisodeOptions, with_episode_options
from smartplay_tools.cli.frames import FrameWriter, picture_options
from smartplay_tools.cli.show import TurnPrinter, print_result
from smartplay_tools.cli.watch import live_page
from smartplay_tools.conversation import loop
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.specs import GameSpec, get_spec
from smartplay_tools.players import get_player, is_model
from smartplay_tools.types import AsyncPlayer, Player

FAILED = ("player_error", "game_error")
INTERRUPTED = 130
"""The exit code of a program that Ctrl-C has stopped."""


@with_episode_options()
def play(
    game: options.Game,
    player: Annotated[
        str, typer.Option(help="Who plays: rule, random, human, openai:MODEL, or FILE.py:CLASS for one of yours.")
    ] = "rule",
    base_url: Annotated[str | None, typer.Option(help="Base URL of the server of openai:MODEL.")] = None,
    seed: options.Seed = 0,
    steps: Annotated[int | None, typer.Option(min=1, help="Stop after N steps.")] = None,
    transcript: options.TranscriptFile = None,
    frames: Annotated[Path | None, typer.Option(help="Write a PNG picture of every step into this folder.")] = None,
    watch: Annotated[
        bool, typer.Option("--watch", help="Show the episode live in a browser; Ctrl-C ends that.")
    ] = False,
    pace: Annotated[float, typer.Option(min=0, help="Seconds to wait after every turn, for those who watch.")] = 0.0,
    open_browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page of --watch.")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the result only.")] = False,
    as_json: options.Json = False,
    *,
    episode: EpisodeOptions,
) -> None:
    """Play one episode and show its calls, observations, prompt tokens and result.

    Example: smartplay-tools play Hanoi3Disk-v0 --player rule --seed 7 --prompt-tokens 700
    """
    who = _player(player, seed, base_url)
    rules: dict[str, Any] = dict(episode.rules)
    protocol = rules.pop("protocol")
    console = Console()
    # A person has a screen, and would see here what has left the window.
    silent = quiet or as_json or getattr(who, "interactive", False)
    printer = None if silent else TurnPrinter(console)
    interrupted = False
    with ExitStack() as stack:
        if watch:
            transcript = stack.enter_context(live_page(transcript, open_browser=open_browser))
        new_episode = Episode(
            _spec(game, steps),
            seed=seed,
            budget=episode.budget,
            engine=episode.engine,
            tokenizer=episode.tokenizer,
            transcript=transcript,
            **{**rules, **episode.options, **(picture_options(game) if frames else {})},
        )
        # A player may have connections to close.
        with who if isinstance(who, AbstractContextManager) else nullcontext(), new_episode as played:
            if frames:
                played.on_step(FrameWriter(frames, played.game))
            try:
                _run(played, who, protocol, printer, pace)
            except KeyboardInterrupt:
                interrupted = True
        _show(console, played, as_json=as_json)
    result = played.result
    assert result is not None
    if interrupted:
        raise typer.Exit(INTERRUPTED)
    if result.end_reason in FAILED:
        raise typer.Exit(1)


def _player(name: str, seed: int, base_url: str | None) -> Player | AsyncPlayer:
    if base_url is None:
        return get_player(name, seed=seed)
    if not is_model(name):
        raise InvalidArgumentError(f"--base-url is only for models, such as openai:MODEL; {name} needs no server.")
    return get_player(name, seed=seed, base_url=base_url)


def _run(episode: Episode, player: Any, protocol: Any, printer: TurnPrinter | None, pace: float) -> None:
    """Play; Ctrl-C leaves an episode that its `with` closes, and what was played counts."""

    def after_a_turn(conversation: BaseConversation) -> None:
        if printer is not None:
            printer(conversation)
        time.sleep(pace)

    loop.play(episode, player, protocol=protocol, on_turn=after_a_turn)


def _show(console: Console, played: Episode, *, as_json: bool) -> None:
    assert played.result is not None
    if as_json:
        print(played.result.model_dump_json(indent=2))
    else:
        print_result(console, played.result)


def _spec(game: str, steps: int | None) -> GameSpec:
    """Return the setting, with another number of steps if one is given."""
    spec = get_spec(game)
    return spec if steps is None else replace(spec, rollout=steps)
