"""What `recall` costs: a turn that does not call it, and its answers after thousands of turns, the first one included.

    python benchmarks/recall.py [--turns 10000]

An endless episode of Rock Paper Scissors is played under a cap of 2,000 tokens without the tool and with it, half an
episode of each in turn. Then the agent searches: each query is the first of an episode of its own, and is asked twice
more. An answer's time is that of the whole reply, from the message to the recorded result. All figures are microseconds
of the processor; those of turns are medians.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import time

from rich.console import Console
from rich.table import Table

import smartplay_tools as sp

GAME = "RockPaperScissorBasic-v0"
CAP, RECALL = 2_000, 200
QUERIES = ("4321", "lizard", "tie paper", "step after act chose rock new round")
"""What is searched: a step, a word that nothing has, two that are in many documents, and some that are in most."""


class Agent:
    """An endless episode and who plays it at random."""

    def __init__(self, turns: int, recall: int | None) -> None:
        budget = sp.Budget(
            prompt_tokens=CAP, history=None, recall_tokens=recall, tool_calls=turns + 100, stalled_turns=None
        )
        spec = dataclasses.replace(sp.GAMES[GAME], rollout=10**9)
        self._conversation = sp.Conversation(sp.Episode(spec, seed=1, budget=budget))
        self._player = sp.get_player("random", seed=1)

    def play(self, turns: int) -> list[float]:
        """Play some turns, and return the time of each."""
        times = []
        for _ in range(turns):
            before = time.thread_time_ns()
            prompt = self._conversation.prompt()
            assert prompt is not None
            self._conversation.receive(self._player.reply(prompt))
            times.append((time.thread_time_ns() - before) / 1e3)
        return times

    def ask(self, query: str) -> float:
        """Search, and return the time of the reply."""
        assert self._conversation.prompt() is not None
        message = sp.call("recall", query=query)
        before = time.thread_time_ns()
        (result,) = self._conversation.receive(message)
        took = (time.thread_time_ns() - before) / 1e3
        assert not result.is_error, result.text
        return took


def turns_of(turns: int) -> Table:
    """The time of a turn without the tool and with it, early and late."""
    table = Table("turns", "without", "with", "ratio", title="A turn that does not search, microseconds")
    without, having = Agent(turns, None), Agent(turns, RECALL)
    for half in range(2):
        (one, other), at = [statistics.median(agent.play(turns // 2)) for agent in (without, having)], half * turns // 2
        table.add_row(f"{at:,} to {at + turns // 2:,}", f"{one:,.1f}", f"{other:,.1f}", f"{other / one:.2f}")
    return table


def answers(turns: int) -> Table:
    """The time of the first answers of an episode."""
    table = Table("query", "first", "second", "third", title=f"An answer after {turns:,} turns, microseconds")
    for query in QUERIES:
        agent = Agent(turns, RECALL)
        agent.play(turns)
        table.add_row(query, *(f"{agent.ask(query):,.0f}" for _ in range(3)))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=10_000, help="the turns of an episode")
    turns = parser.parse_args().turns
    console = Console(width=120)
    console.print(turns_of(turns))
    console.print(answers(turns))


if __name__ == "__main__":
    main()
