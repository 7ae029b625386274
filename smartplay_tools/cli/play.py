"""The command `play`: one episode, shown as it happens."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.console import Console

from smartplay_tools import playing
from smartplay_tools.cli import options
from smartplay_tools.cli.show import TurnPrinter, print_result
from smartplay_tools.episode import Episode
from smartplay_tools.players import get_player
from smartplay_tools.records import EpisodeResult, Player

FAILED = ("player_error", "game_error")


def play(
    game: options.Game,
    player: Annotated[str, typer.Option(help="Who plays: rule, random, ...")] = "rule",
    seed: options.Seed = 0,
    transcript: options.TranscriptFile = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print the result only.")] = False,
    as_json: options.Json = False,
    history: options.History = "game",
    prompt_tokens: options.PromptTokens = "none",
    reply_tokens: options.ReplyTokens = "none",
    episode_tokens: options.EpisodeTokens = "none",
    result_tokens: options.ResultTokens = "auto",
    tool_calls: options.ToolCalls = "game",
    slack: options.Slack = 0.0,
    manual: options.Manual = "tool",
    engine: options.Engine = None,
    batch: options.Batch = "all",
    tokenizer: options.TokenizerName = None,
    option: options.GameOptions = None,
) -> None:
    """Play one episode and show it: calls, observations, the prompt against its cap, the result.

    Example: smartplay-tools play Hanoi3Disk-v0 --player rule --seed 7 --prompt-tokens 700
    """
    budget = options.budget(
        history=history,
        prompt_tokens=prompt_tokens,
        reply_tokens=reply_tokens,
        episode_tokens=episode_tokens,
        result_tokens=result_tokens,
        tool_calls=tool_calls,
        slack=slack,
    )
    who = get_player(player, seed=seed)
    modes: dict[str, Any] = {"manual": manual, "batch": batch, "engine": engine, "tokenizer": tokenizer}
    console = Console()
    watch = None if quiet or as_json else TurnPrinter(console)
    with Episode(
        game, seed=seed, budget=budget, transcript=transcript, **modes, **options.game_options(option)
    ) as episode:
        result = _run(episode, who, watch)
    if as_json:
        print(result.model_dump_json(indent=2))
    else:
        print_result(console, result)
    if result.end_reason in FAILED:
        raise typer.Exit(1)


def _run(episode: Episode, player: Any, watch: TurnPrinter | None) -> EpisodeResult:
    if isinstance(player, Player):
        return playing.play(episode, player, on_turn=watch)
    import asyncio

    return asyncio.run(playing.aplay(episode, player, on_turn=watch))
