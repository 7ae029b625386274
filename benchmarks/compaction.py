"""A turn with a compactor that changes nothing, beside dropping: `python benchmarks/compaction.py`.

The two are played in turn, and the best of several rounds counts, because other programs disturb both. Memory is what
Python has allocated for the whole conversation.
"""

from __future__ import annotations

import time
import tracemalloc
from typing import Any

import smartplay_tools as sp
from smartplay_tools.players.prompt_reading import call

OBSERVE = call("observe")


class Unchanged:
    """Returns the history that it is given."""

    def compact(self, history: Any, room: Any) -> Any:
        """Change nothing."""
        return history


def played(strategy: str | None, turns: int) -> sp.Conversation:
    """Return a conversation after some turns under a cap, its record included."""
    limits: dict[str, Any] = dict.fromkeys(("history", "tool_calls", "stalled_turns"))
    budget = sp.Budget(prompt_tokens=1500, strategy=strategy, **limits)
    conversation = sp.Conversation(sp.Episode("RockPaperScissorBasic-v0", seed=1, budget=budget, transcript=[]))
    for _ in range(turns):
        turn(conversation)
    return conversation


def turn(conversation: sp.Conversation) -> None:
    """Make a prompt, and play its reply."""
    assert conversation.prompt() is not None
    conversation.receive(OBSERVE)


def main() -> None:
    """Print a row for each number of turns."""
    sp.register_strategy("unchanged", Unchanged)
    print("| turns | dropping | a compactor that changes nothing | ratio | memory |\n|---|---|---|---|---|")
    for turns in (100, 1000, 3000):
        both = [played(strategy, turns) for strategy in (None, "unchanged")]
        best = [1e9, 1e9]
        for _ in range(100):
            for at, conversation in enumerate(both):
                began = time.perf_counter()
                turn(conversation)
                best[at] = min(best[at], time.perf_counter() - began)
        sizes = []
        for strategy in (None, "unchanged"):
            tracemalloc.start()
            kept = played(strategy, turns)
            sizes.append(tracemalloc.get_traced_memory()[0])
            tracemalloc.stop()
            del kept
        micro = [1e6 * seconds for seconds in best]
        ratios = f"{best[1] / best[0]:.2f} | {sizes[1] / sizes[0]:.2f}"
        print(f"| {turns:,} | {micro[0]:.0f} us | {micro[1]:.0f} us | {ratios} |")


if __name__ == "__main__":
    main()
