"""Rules for the bandit: try each machine, then pull the one with the best mean of the visible rewards.

One imagined win and one imagined loss are added to the visible results of each machine, so that a good machine that
loses its first pull is tried again.
"""

from __future__ import annotations

import re

from smartplay_tools.messages import Message
from smartplay_tools.players.reading import Reading, call
from smartplay_tools.players.rules.memory import line, recall

PULL = re.compile(r"You pulled slot machine (\d+), you received reward (-?\d+)\.")


def plays(reading: Reading) -> bool:
    """Whether the actions are slot machines."""
    return all(action.startswith("Pull slot machine") for action in reading.actions)


Pulls = dict[int, tuple[int, int]]
"""For every machine: the number of pulls, and the sum of their rewards."""


def decide(reading: Reading) -> Message:
    """Pull a machine of which nothing is visible, else the one with the best mean."""
    return pull(reading, count_pulls(reading, {}))


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Decide by all pulls that are remembered or visible, and return the memory that covers them."""
    memory = recall(reading)
    kept = {int(machine): tuple(counts) for machine, counts in (memory.facts or {}).get("machines", {}).items()}
    machines = count_pulls(memory.since, kept)
    facts = {"clock": sum(pulls for pulls, _ in machines.values()), "machines": machines}
    return pull(reading, machines), line(facts)


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
