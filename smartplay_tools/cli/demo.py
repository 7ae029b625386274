"""The command `demo`: real games, real tool calls, tight budgets, verified records. No key, no network."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from smartplay_tools import playing
from smartplay_tools.cli.show import TurnPrinter, compact_table
from smartplay_tools.conversation import Conversation
from smartplay_tools.episode import Episode
from smartplay_tools.players.rule import RulePlayer
from smartplay_tools.records import Budget, EpisodeResult
from smartplay_tools.replay import replay

GAMES = {"BanditTwoArmedHighLowFixed-v0": 700, "RockPaperScissorBasic-v0": 800, "Hanoi3Disk-v0": 600}
"""Each game with a prompt cap that its conversation outgrows."""

SHOWN_TURNS = 4
"""Turns of each game that are printed in full; the others would look the same."""


def demo(
    out: Annotated[Path | None, typer.Option(help="Folder for the transcripts; a new one if not given.")] = None,
    seed: Annotated[int, typer.Option(help="The source of all randomness.")] = 7,
) -> None:
    """Play a bandit, Rock Paper Scissors and Hanoi to the end through tool calls, and verify the records by replay.

    Example: smartplay-tools demo
    """
    console = Console()
    folder = out or Path(tempfile.mkdtemp(prefix="smartplay-demo-"))
    table = compact_table("game", "score", "human", "prompts", "dropped", "tokens", "replay")
    failed = False
    for game, cap in GAMES.items():
        console.rule(f"{game}, prompts of at most {cap} tokens", align="left")
        watch = _Watch(console)
        path = folder / f"{game}.jsonl"
        with Episode(game, seed=seed, budget=Budget(prompt_tokens=cap), transcript=path) as episode:
            result = playing.play(episode, RulePlayer(), on_turn=watch)
        found = replay(path)
        failed = failed or not found.identical
        table.add_row(*_row(result, cap, watch), "identical" if found.identical else found.differences[0])
    console.rule("results", align="left")
    console.print("[dim]prompts: the largest of its cap; dropped: the most turns that a prompt left out[/]")
    console.print(table)
    for game in GAMES:
        console.print(f"transcript: {folder / game}.jsonl", highlight=False, soft_wrap=True)
    if failed:
        raise typer.Exit(1)


class _Watch:
    """Prints the first turns, and keeps what the window did in all of them."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._print = TurnPrinter(console)
        self.largest = self.dropped = 0

    def __call__(self, conversation: Conversation) -> None:
        assert conversation.view is not None
        self.largest = max(self.largest, conversation.view.tokens)
        self.dropped = max(self.dropped, conversation.view.dropped_turns)
        number = conversation.episode.tally.turns - 1
        if number < SHOWN_TURNS or conversation.result is not None:
            self._print(conversation)
        elif number == SHOWN_TURNS:
            self._console.print("[dim]...[/]")


def _row(result: EpisodeResult, cap: int, watch: _Watch) -> list[str]:
    return [
        result.game,
        f"{result.score:g}",
        "" if result.normalized_score is None else f"{result.normalized_score:.0%}",
        f"{watch.largest}/{cap}",
        str(watch.dropped),
        f"{result.tokens.prompt + result.tokens.reply:,}",
    ]
