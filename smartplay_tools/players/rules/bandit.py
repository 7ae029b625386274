"""Rules for the bandit: try each machine, then pull the one with the best mean of the visible rewards.

One imagined win and one imagined loss are added to the visible results of each machine, so that a good machine that
loses its first pull is tried again.

Earlier games can teach how often a better and a worse machine win, but not which is which: their order is random. With
this carried over, the rules pull the machine that is more probably the better one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.memory import earlier, line, recall
from smartplay_tools.types.messages import Message

PULL = re.compile(r"You pulled slot machine (\d+), you received reward (-?\d+)\.")


def plays(reading: Reading) -> bool:
    """Whether the actions are slot machines."""
    return all(action.startswith("Pull slot machine") for action in reading.actions)


Pulls = dict[int, tuple[int, int]]
"""For every machine: the number of pulls, and the sum of their rewards."""


def decide(reading: Reading) -> Message:
    """Pull a machine that has no visible result, else the one with the best mean."""
    return pull(reading, count_pulls(reading, {}))


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Decide by all pulls that are remembered or visible, and return the memory that covers them."""
    memory = recall(reading)
    kept = {int(machine): tuple(counts) for machine, counts in (memory.facts or {}).get("machines", {}).items()}
    machines = count_pulls(memory.since, kept)
    facts: dict[str, Any] = {"clock": sum(pulls for pulls, _ in machines.values()), "machines": machines}
    if (ranks := _ranks(reading)) is None:
        return pull(reading, machines), line(facts)
    return _pull_likely(reading, machines, ranks), line({**facts, "ranks": ranks})


Ranks = list[list[int]]
"""Pulls and the sum of their rewards of the better machines of the games before, and of the worse ones."""


def _ranks(reading: Reading) -> Ranks | None:
    """Return what earlier games have taught, None for nothing: the last game's pulls, added to what it knew already."""
    if (before := earlier(reading)) is None:
        return None
    counts = [list(counts) for counts in before.facts.get("machines", {}).values()]
    if (match := PULL.search(before.text)) and int(match[1]) <= len(counts):  # its notes were older than its last pull
        counts[int(match[1]) - 1][0] += 1
        counts[int(match[1]) - 1][1] += int(match[2])
    ranks: Ranks = before.facts.get("ranks", [[0, 0], [0, 0]])
    if len(counts) != len(ranks) or not all(pulls for pulls, _ in counts):
        return ranks
    best_first = sorted(counts, reverse=True)  # the one that was pulled more was found to be the better one
    return [[own[at] + rank[at] for at in range(2)] for own, rank in zip(best_first, ranks, strict=True)]


def _pull_likely(reading: Reading, counts: Mapping[int, tuple[int, int]], ranks: Ranks) -> Message:
    """Pull the machine that is more probably the better one, by how often such machines have won before."""
    better, worse = ((pulls + reward + 2) / (2 * pulls + 4) for pulls, reward in ranks)

    def evidence(machine: int) -> float:
        pulls, reward = counts[machine]
        wins = (pulls + reward) / 2
        return wins * math.log(better / worse) + (pulls - wins) * math.log((1 - better) / (1 - worse))

    return call("act", action=reading.actions[max(counts, key=evidence) - 1])


def count_pulls(reading: Reading, earlier: Pulls) -> Pulls:
    """Return the known pulls and rewards with the visible ones added."""
    counts = {machine: earlier.get(machine, (0, 0)) for machine in range(1, len(reading.actions) + 1)}
    for observation in reading.observations:
        if (match := PULL.search(observation)) and (machine := int(match[1])) in counts:
            pulls, total = counts[machine]
            counts[machine] = pulls + 1, total + int(match[2])
    return counts


def pull(reading: Reading, counts: Pulls) -> Message:
    """Pull a machine that was never pulled, else the one with the best mean."""
    untried = [machine for machine, (pulls, _) in counts.items() if not pulls]
    best = untried[0] if untried else max(counts, key=lambda machine: counts[machine][1] / (counts[machine][0] + 2))
    return call("act", action=reading.actions[best - 1])
