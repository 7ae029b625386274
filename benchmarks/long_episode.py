"""What a turn of a long episode costs: memory, and time by how much its prompt shows.

    python benchmarks/long_episode.py

An episode of 20,000 turns is played under each of three caps. Its memory is measured by `tracemalloc` in one run, and
the time of the processor in another, in quarters of the episode: figures that grow would show what grows with it.
"""

from __future__ import annotations

import itertools
import statistics
import time
import tracemalloc

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp

TURNS, QUARTERS, CAPS = 20_000, 4, (2_000, 8_000, 32_000)


def played(cap: int, *, traced: bool) -> tuple[list[float], int]:
    """For each quarter the bytes of a turn, or its microseconds; and how many turns the last one shows."""
    budget = sp.Budget(prompt_tokens=cap, tool_calls=None, stalled_turns=None)
    found, times, was = list[float](), list[float](), 0
    if traced:
        tracemalloc.start()
    with sp.Episode("RockPaperScissorBasic-v0", seed=1, budget=budget) as episode:
        conversation = sp.Conversation(episode)
        for turn in itertools.count(1):
            begun = time.process_time()
            conversation.prompt()
            conversation.receive(sp.call("observe", text=f"Turn {turn}."))
            times.append(time.process_time() - begun)
            if turn % (TURNS // QUARTERS) == 0:
                now = tracemalloc.get_traced_memory()[0] if traced else 0
                found.append((now - was) / len(times) if traced else 1e6 * statistics.median(times))
                times, was = [], now
            if turn == TURNS:
                break
        shown = len(conversation.view.selection)
    tracemalloc.stop()
    return found, shown


def main() -> None:
    table = Table("prompt_tokens", "turns shown", "bytes of a turn, by quarters", "microseconds of a turn, by quarters")
    for cap in CAPS:
        times, shown = played(cap, traced=False)
        sizes, _ = played(cap, traced=True)
        columns = [" ".join(f"{each:,.0f}" for each in column) for column in (sizes, times)]
        table.add_row(f"{cap:,}", f"{shown:,}", *columns)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
