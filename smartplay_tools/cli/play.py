"""The command `play`: one episode, shown as it happens."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import typer

from smartplay_tools.cli import INTERRUPTED, options, runs
from smartplay_tools.cli.episode_options import EpisodeOptions, with_episode_options
from smartplay_tools.cli.show import FAILED, print_result, print_turn
from smartplay_tools.conversation import loop
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs.players import check_no_credentials
from smartplay_tools.games.specs import get_spec
from smartplay_tools.players import get_player, is_model
from smartplay_tools.players.opening import enter_player
from smartplay_tools.players.player_registry import second_name, second_player, without_second
from smartplay_tools.providers.prices import find_price
from smartplay_tools.records.record import Record
from smartplay_tools.records.rows import warnings
from smartplay_tools.streams import own_output
from smartplay_tools.terminal import Console, say
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import EpisodeResult


@with_episode_options()
def play(
    game: options.Game,
    player: Annotated[
        str, typer.Option(help="Who plays: rule, random, human, openai:MODEL, or FILE.py:CLASS for one of yours.")
    ] = "rule",
    base_url: options.BaseUrl = None,
    player_option: options.PlayerOptions = None,
    price: runs.Prices = None,
    seed: options.Seed = 0,
    steps: Annotated[int | None, typer.Option(min=1, help="Stop after N steps.")] = None,
    transcript: options.TranscriptFile = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the result only.")] = False,
    as_json: options.Json = False,
    *,
    episode: EpisodeOptions,
) -> None:
    """Play one episode and show its calls, observations, prompt tokens and result.

    Example: smartplay-tools play Hanoi3Disk-v0 --player rule --seed 7 --prompt-tokens 700
    """
    given = _player_options(player, base_url, player_option)
    second = second_player(given, seed=seed)
    who = get_player(player, seed=seed, **without_second(given))
    known = runs.prices(price)
    prices = {getattr(who, "name", player): known.get(player) or find_price(player, given)}
    if (answering := second_name(given)) is not None:
        prices.setdefault(answering, known.get(answering) or find_price(answering, {}))
    settings = {**episode.conditions, **episode.options}
    protocol, spec = settings.pop("protocol"), get_spec(game)
    # A person has a screen, and would see here what has left the window.
    silent = quiet or as_json or getattr(who, "interactive", False)
    console = None if silent else Console()
    events: list[Event] = []
    with ExitStack() as stack:
        new_episode = Episode(
            spec if steps is None else replace(spec, rollout=steps),
            seed=seed,
            transcript=transcript or events,
            player_options={name: value for name, value in given.items() if name != "base_url"},
            **settings,
        )
        for each in (who, second):
            if each is not None:  # a player may have connections to close
                enter_player(stack, each)
        with new_episode as played:
            interrupted = _run(played, who, protocol, second, console)
    assert played.result is not None
    priced = {name: found for name, found in prices.items() if found}
    record = Record.read(transcript, priced) if transcript else Record(events, prices=priced)
    _print(played.result, record, as_json=as_json)
    has_failed = played.result.end_reason in FAILED  # the result says why
    if not has_failed:
        for warning in warnings(played.result.model_dump() | {"player": player}, lambda row: record.first_reply):
            say(warning, err=True)
    if interrupted or has_failed:
        raise typer.Exit(INTERRUPTED if interrupted else 1)


def _player_options(name: str, base_url: str | None, pairs: list[str] | None) -> dict[str, Any]:
    """The options of the player; a server, which only models have, is refused for others."""
    if base_url is not None and not is_model(name):
        raise InvalidArgumentError(f"--base-url is only for models, such as openai:MODEL; {name} needs no server.")
    (config,) = runs.player_configs([name], None if base_url is None else [base_url], pairs)
    check_no_credentials("--player-option", config.options)
    return config.options


def _print(result: EpisodeResult, record: Record, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(result.model_dump(mode="json"), indent=2), file=own_output())
    else:
        print_result(Console(), result, record.cost, record.question_cost)


def _run(episode: Episode, player: Any, protocol: Any, second: Any, console: Console | None) -> bool:
    """Play; return whether Ctrl-C stopped the episode, which its `with` then closes: what was played counts."""
    shown = {} if console is None else {"on_turn": partial(print_turn, console)}
    try:
        loop.play(episode, player, protocol=protocol, compactor_player=second, **shown)
    except KeyboardInterrupt:
        return True
    return False
