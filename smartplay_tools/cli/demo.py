"""The command `demo`: real games, real tool calls, tight budgets, verified records. No key, no network.

It ends with the replay page of the records, what the window did, and the next command.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from smartplay_tools.cli import options, program
from smartplay_tools.cli.show import compact_table, print_turn
from smartplay_tools.conversation import loop
from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.games.specs import get_spec
from smartplay_tools.players.player_registry import get_player
from smartplay_tools.records.replays import replay
from smartplay_tools.terminal import Console, say
from smartplay_tools.types import Budget, EpisodeResult, Player

GAMES = {"BanditTwoArmedHighLowFixed-v0": 700, "RockPaperScissorBasic-v0": 800, "Hanoi3Disk-v0": 600}
"""Each game with a prompt cap that is too small for its whole conversation."""

MODEL_SLACK = 0.5
"""With a player of your choice: a model does not have to read the whole prompt again in every turn."""

PROGRESS_SECONDS = 10.0
"""Between two lines that say how far a slow player is."""

SHOWN_TURNS = 4
"""Turns of each game that are printed in full; the others would look the same."""


def demo(
    out: Annotated[Path | None, typer.Option(help="Folder for the transcripts; a new one if not given.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of all randomness.")] = 7,
    name: Annotated[
        str | None,
        typer.Option(
            "--player",
            help="Play with this player instead, such as local:smollm2-135m-player: a real model.",
            show_default=False,
        ),
    ] = None,
    player_option: options.PlayerOptions = None,
) -> None:
    """Play a bandit, Rock Paper Scissors and Hanoi through tool calls, and verify the records by replay.

    Example: smartplay-tools demo
    """
    console = Console()
    folder = out or Path(tempfile.mkdtemp(prefix="smartplay-demo-"))
    failures = []
    given = options.key_values(player_option, "--player-option")
    if given and name is None:
        raise InvalidArgumentError("--player-option is for a player of your choice; name one with --player.")
    player = get_player(name or "rule", seed=seed, **given)
    if not isinstance(player, Player):
        raise InvalidArgumentError(f"The demo plays with a player that answers at once; {name} has to be awaited.")
    table = compact_table("game", "score", "human", "prompts", "dropped", "tokens", "replay")
    table.title = f"played by {player.name}"
    watch = _Watch(console)
    for game, cap in GAMES.items():
        budget = Budget(prompt_tokens=cap, slack=0 if name is None else MODEL_SLACK)
        console.rule(f"{game}, {player.name}, {budget.describe()}", align="left")
        path = folder / f"{game}.{player.name.replace(':', '-')}.jsonl"
        with Episode(game, seed=seed, budget=budget, transcript=path) as episode:
            result = loop.play(episode, player, on_turn=watch)
        replayed = replay(path)
        failures += replayed.differences[:1] if result.error is None else [f"{game}: {result.error}"]
        table.add_row(*_row(result, cap, watch), "identical" if replayed.identical else "differs")
    console.rule("results", align="left")
    note = "prompts: the largest, as a share of its cap; dropped: the most turns that a prompt left out"
    console.print(note, style="dim")
    console.print(table)
    for failure in failures:
        console.print(failure, style="red")
    if failures:
        raise typer.Exit(1)
    _conclude(folder, watch, name or "the rule player")


def _conclude(folder: Path, watch: _Watch, player: str) -> None:
    """Print what the window did, where to see the records, and the next command."""
    most = max(watch.largest[game] / cap for game, cap in GAMES.items())
    say(
        f"The window left out up to {max(watch.dropped.values())} turns of a prompt, no prompt was over its cap (the "
        f"largest is {most:.0%} of it), and {player} played on from what it could still see."
    )
    try:
        from smartplay_tools.evaluation.pages.report.page import write_report

        page = write_report(folder, folder / "demo.html", title="The demo").resolve().as_uri()
        say(f"Every turn as a picture, and what was in sight: {page}")
        say(f"Play yourself in the browser: {program()} view --play any")
    except MissingExtraError as error:
        say(f"The records are in {folder}.")
        say(str(error))
    say(f"Your model: {program()} play Hanoi3Disk-v0 --player openai:MODEL --prompt-tokens 600")
    say("Its key is read from OPENAI_API_KEY; --base-url names another server than OpenAI's.")


class _Watch:
    """Prints the first turns of each game and now and then how far a slow player is; collects figures of the window."""

    def __init__(self, console: Console) -> None:
        self._console, self._began, self._turns = console, time.perf_counter(), 0
        self._said = self._began
        self._left = {game: get_spec(game).rollout for game in GAMES}
        self.largest, self.dropped = dict.fromkeys(GAMES, 0), dict.fromkeys(GAMES, 0)
        """By game: the tokens of the largest prompt, and the most turns that one left out."""

    def __call__(self, conversation: BaseConversation) -> None:
        episode, view = conversation.episode, conversation.view
        assert view is not None
        game = episode.spec.id
        self._left[game] = 0 if episode.done else episode.spec.rollout - episode.stats.steps
        self._say_how_far()
        self.largest[game] = max(self.largest[game], view.tokens)
        self.dropped[game] = max(self.dropped[game], view.dropped_turns)
        number = episode.stats.turns - 1
        if number < SHOWN_TURNS or conversation.result is not None:
            print_turn(self._console, conversation)
        elif number == SHOWN_TURNS:
            self._console.print("...", style="dim")

    def _say_how_far(self) -> None:
        """Count a turn; say about how long the steps that are left take."""
        now = time.perf_counter()
        self._turns += 1
        if now - self._said >= PROGRESS_SECONDS:
            self._said, each = now, (now - self._began) / self._turns
            left = f"about {each * sum(self._left.values()):,.0f} s left"
            self._console.print(f"{self._turns} turns in {now - self._began:,.0f} s; {left}", style="dim")


def _row(result: EpisodeResult, cap: int, watch: _Watch) -> list[str]:
    return [
        result.game,
        f"{result.score:g}",
        "" if result.normalized_score is None else f"{result.normalized_score:.0%}",
        f"{watch.largest[result.game]}/{cap}",
        str(watch.dropped[result.game]),
        f"{result.tokens.prompt + result.tokens.reply:,}",
    ]
