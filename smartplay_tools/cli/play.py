"""The command `play`: one episode, shown as it happens.

The page of `--watch` is the site over the episode's record, served by the same process.
"""

from __future__ import annotations

import json
import tempfile
import threading
import time
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import typer

from smartplay_tools.cli import INTERRUPTED, options, runs
from smartplay_tools.cli.episode_options import EpisodeOptions, with_episode_options
from smartplay_tools.cli.show import FAILED, print_result, print_turn
from smartplay_tools.conversation import loop
from smartplay_tools.conversation.base import BaseConversation
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
from smartplay_tools.types.messages import text_of


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
    first: list[str] = []
    with ExitStack() as stack:
        path, page = stack.enter_context(_live_page(transcript)) if watch else (transcript, None)
        events: list[Event] = []
        new_episode = Episode(
            spec if steps is None else replace(spec, rollout=steps),
            seed=seed,
            transcript=path or events,
            player_options={name: value for name, value in given.items() if name != "base_url"},
            **settings,
        )
        for each in (who, second):
            if each is not None:  # a player may have connections to close
                enter_player(stack, each)
        with new_episode as played:
            if page is not None:
                played.begin(player=who.name, protocol=protocol)  # a record without an event is not a page yet
                say(f"The episode is shown at {page}", err=True)
                if open_browser:
                    webbrowser.open(page)
            interrupted = _run(played, who, protocol, second, console, pace, first)
        assert played.result is not None
        priced = {name: found for name, found in prices.items() if found}
        record = Record.read(path, priced) if path else Record(events, prices=priced)
        _print(played.result, record, as_json=as_json)
    has_failed = played.result.end_reason in FAILED  # the result says why
    if not has_failed:
        for warning in warnings(played.result.model_dump() | {"player": player}, lambda row: "".join(first)):
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


def _run(
    episode: Episode,
    player: Any,
    protocol: Any,
    second: Any,
    console: Console | None,
    pace: float,
    first: list[str],
) -> bool:
    """Play; return whether Ctrl-C stopped the episode, which its `with` then closes: what was played counts.

    The text of the first reply is put into `first`.
    """

    def after_a_turn(conversation: BaseConversation) -> None:
        if not first and conversation.latest_turn is not None:
            first.append(text_of(conversation.latest_turn.assistant))
        if console is not None:
            print_turn(console, conversation)
        time.sleep(pace)

    try:
        loop.play(episode, player, protocol=protocol, compactor_player=second, on_turn=after_a_turn)
    except KeyboardInterrupt:
        return True
    return False


@contextmanager
def _live_page(transcript: Path | None) -> Iterator[tuple[Path, str]]:
    """Serve the page of a record that is being written, and yield the record and the page's address.

    Without a `transcript` the record is a temporary file. Afterwards the page is served on until Ctrl-C.
    """
    from smartplay_tools.web.site import RunList, ViewServer
    from smartplay_tools.web.site.site_record import PLAYING, SiteRecord

    with tempfile.TemporaryDirectory() as folder:
        path = transcript or Path(folder) / "episode.jsonl"
        with ViewServer(RunList(always=[SiteRecord(path)])) as server:
            yield path, f"{server.url}episode/{quote(path.name)}/{PLAYING}"
            say("The page stays until Ctrl-C.", err=True)
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
