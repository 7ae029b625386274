"""The cost of a turn: prompt, reply and step, beside the floor of what no library could leave out.

    python benchmarks/turn.py [--rounds 6]

A turn is a prompt, the reply of the player `random`, and its step. It is measured under a cap of 2,000 tokens, with and
without a transcript, from turn 20 to turn 150. The floor of a turn is the step with its text, the tokens of the new
text and, with a transcript, one line of JSON written to the null device and one sha256 of 6,000 bytes, about as many as
a prompt has. Episodes and floors take turns in one run. All figures are microseconds of the processor, and medians;
ratios count, because machines differ. Crafter's turn with a transcript is to cost at most 4 times its floor.

One table compares turns with pictures and without. Another shows how a turn without cap and history grows: with the
messages that are shown, and with nothing else. `long_episode.py` has the same under caps.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
import random
import statistics
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp
from smartplay_tools.context.tokens import get_tokenizer

GAMES = {
    "BanditTwoArmedHighLowFixed-v0": 2,
    "RockPaperScissorBasic-v0": 2,
    "Hanoi3Disk-v0": 2,
    "MessengerL2-v0": 8,
    "Crafter-v0": 2,
    "MinedojoCreative0-v0": 1,
}
"""The games, and how many episodes of each are played in a round: those of MESSENGER are short."""

PICTURED = ("Crafter-v0", "MinedojoCreative0-v0")
CAP, FIRST, LONGEST = 2_000, 20, 150
HASHED = b"x" * 6_000
SHOWN = (100, 200, 1_000, 2_000)
AROUND = 50
"""How many turns are measured at a length."""


class Times:
    """Microseconds of the processor between calls of `lap`."""

    def __init__(self) -> None:
        self.laps: list[float] = []
        self._before: int | None = None

    def lap(self, *_: object) -> None:
        """Note the time since the lap before."""
        now = time.thread_time_ns()
        if self._before is not None:
            self.laps.append((now - self._before) / 1e3)
        self._before = time.thread_time_ns()


def turns(game: str, seed: int, folder: Path | None, observation: str = "text") -> list[float]:
    """The time of every turn of an episode from `FIRST` on; of a shorter one, of every turn but the first."""
    times = Times()
    transcript = None if folder is None else folder / f"{game}-{seed}-{time.monotonic_ns()}.jsonl"
    budget = sp.Budget(prompt_tokens=CAP, tool_calls=LONGEST)
    with sp.Episode(game, seed=seed, budget=budget, transcript=transcript, observation=observation) as episode:
        sp.play(episode, sp.get_player("random", seed=seed), on_turn=times.lap)
    return measured(times.laps)


def measured(laps: list[float]) -> list[float]:
    """The turns that count; an episode of MESSENGER may end before it has come to them."""
    return laps[FIRST - 1 :] or laps


def floors(game: str, seed: int, folder: Path | None) -> list[float]:
    """The time of the floor of every turn of an episode."""
    count, rng = get_tokenizer().count, random.Random(seed)
    text_game = sp.GAMES[game].make(history=0)
    text_game.reset(seed=seed)
    times = Times()
    with Path(os.devnull).open("wb", buffering=0) as file:
        for turn in range(LONGEST):
            action = rng.randrange(len(text_game.actions))
            name = text_game.actions[action]
            times.lap()
            text, reward, terminated, truncated = text_game.advance(action)
            _ = count(text) + count(name)
            if folder is not None:
                line = {"turn": turn, "name": "act", "arguments": name, "text": text, "reward": reward}
                file.write(json.dumps(line).encode() + b"\n")
                hashlib.sha256(HASHED).hexdigest()
            times.lap()
            if terminated or truncated:
                break
    text_game.close()
    return measured(times.laps[::2])


def every_game(rounds: int) -> Table:
    """A turn of every game beside its floor, with and without a transcript."""
    columns = ("game", "floor", "turn", "ratio", "floor, transcript", "turn, transcript", "ratio")
    table = Table(*columns, title=f"A turn under a cap of {CAP:,} tokens, microseconds", title_justify="left")
    for game, episodes in GAMES.items():
        row = [game]
        with tempfile.TemporaryDirectory() as name:
            for kind, folder in enumerate((None, Path(name))):
                floor: list[float] = []
                turn: list[float] = []
                # Seeds of their own, because the tokens of texts that were counted before cost nothing.
                for seed in range(kind * rounds * episodes, (kind + 1) * rounds * episodes):
                    floor += floors(game, seed, folder)
                    turn += turns(game, seed, folder)
                least, ours = statistics.median(floor), statistics.median(turn)
                row += [f"{least:,.0f}", f"{ours:,.0f}", f"{ours / least:.1f}"]
        table.add_row(*row)
    return table


def without_a_cap() -> Table:
    """A turn of an endless episode whose prompts hold everything."""
    table = Table("turns", "messages shown", "microseconds", "microseconds a message")
    table.title, table.title_justify = "A turn without cap and history", "left"
    times, budget = Times(), sp.Budget(history=None, tool_calls=SHOWN[-1])
    spec = dataclasses.replace(sp.GAMES["RockPaperScissorBasic-v0"], rollout=10**9)
    with sp.Episode(spec, seed=1, budget=budget) as episode:
        sp.play(episode, sp.get_player("random", seed=1), on_turn=times.lap)
    for length in SHOWN:
        # The last turn has the result of the episode to make.
        microseconds, shown = statistics.median(times.laps[length - AROUND - 2 : length - 2]), 2 * length
        table.add_row(f"{length:,}", f"{shown:,}", f"{microseconds:,.0f}", f"{microseconds / shown:.2f}")
    return table


def with_pictures(rounds: int) -> Table:
    """A turn of the games with pictures, whose observations are words, pictures, or both."""
    forms = ("text", "picture", "both")
    table = Table("game", *forms, "a picture's share", title="A turn with pictures, microseconds", title_justify="left")
    for game in PICTURED:
        laps: dict[str, list[float]] = {form: [] for form in forms}
        for seed in range(4 * rounds):
            for number, form in enumerate(forms, start=1):
                # A text that was counted before costs less, so no two episodes of a game have the same world.
                laps[form] += turns(game, 1_000 * number + seed, None, form)
        medians = {form: statistics.median(times) for form, times in laps.items()}
        shown = (f"{medians[form]:,.0f}" for form in forms)
        table.add_row(game, *shown, f"{medians['both'] - medians['text']:,.0f}")
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=6, help="how many rounds of episodes a game is measured")
    rounds = parser.parse_args().rounds
    get_tokenizer().count("The tokenizer is loaded before anything is measured.")
    console = Console(width=120)
    console.print(every_game(rounds))
    console.print(with_pictures(rounds))
    console.print(without_a_cap())


if __name__ == "__main__":
    main()
