"""How often the ranges of `--dry-run` are right: `python benchmarks/estimates.py [GAME ...]`.

Every game is estimated and then played, by the rule player and by a player whose replies are 300 tokens long, which
represents a model. A cell is right if its actual use is within the estimated ranges. The aim is 9 of 10 cells.
"""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.estimate import Range, estimate
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.runner import run_plan

TRIALS = 3
REPLY_TOKENS = 300
CAPS = (None, 2000)
"""Prompt caps, each a cell."""


class LongReplies:
    """Plays legal actions at random, reads the manual first, and says 300 tokens each time."""

    name = "scripted:long"

    def __init__(self, *, seed: int, **options: Any) -> None:
        self._random = random.Random(seed)

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        """Return a move with many words."""
        numbers = [line.partition(".")[0] for line in prompt.tools[1].description.splitlines()[1:]]
        read = len(prompt.messages) == 2
        name, arguments = ("read_manual", "{}") if read else ("act", f'{{"action": "{self._random.choice(numbers)}"}}')
        call = {"id": "1", "type": "function", "function": {"name": name, "arguments": arguments}}
        return sp.Reply({"role": "assistant", "content": "so " * (REPLY_TOKENS - 10), "tool_calls": [call]})


def main(games: list[str]) -> None:
    """Estimate and play, and print what was said beside what it took."""
    budgets = [sp.Budget(prompt_tokens=cap) for cap in CAPS]
    cells = make_cells(games or list(sp.GAMES), ["rule", LongReplies.name], budgets)
    plan = plan_episodes(cells, trials=TRIALS)
    estimates = estimate(plan, {}, reply_tokens=REPLY_TOKENS)
    with tempfile.TemporaryDirectory() as folder:
        run = run_plan(plan, Path(folder) / "run", {LongReplies.name: LongReplies})
        places = {episode.key: episode.place for episode in plan.episodes}
        took: dict[int, dict[str, int]] = {}
        for row in run.rows:
            sums = took.setdefault(places[row["key"]], {"calls": 0, "prompts": 0, "replies": 0})
            sums["calls"] += row["turns"]
            sums["prompts"] += row["tokens"]["prompt"]
            sums["replies"] += row["tokens"]["reply"]
    right = []
    for place, expected in enumerate(estimates):
        ranges = {"calls": expected.calls, "prompts": expected.prompt_tokens, "replies": expected.reply_tokens}
        hits = {name: ranges[name].low <= took[place][name] <= ranges[name].high for name in ranges}
        right.append(all(hits.values()))
        marks = "  ".join(f"{name} {_show(ranges[name], took[place][name], hits[name])}" for name in ranges)
        print(
            f"{'right' if right[-1] else 'WRONG'}  {expected.cell.game}, {expected.cell.player}, "
            f"cap {expected.cell.budget.prompt_tokens}:  {marks}"
        )
    print(
        f"{sum(right)} of {len(right)} cells were within their range ({sum(right) / len(right):.0%}); the aim is 90 %"
    )


def _show(estimate: Range, took: int, hit: bool) -> str:
    return f"{estimate.low:,.0f} to {estimate.high:,.0f}, took {took:,}{'' if hit else ' (!)'}"


if __name__ == "__main__":
    main(sys.argv[1:])
