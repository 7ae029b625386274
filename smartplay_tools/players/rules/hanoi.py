"""Rules for Tower of Hanoi: the shortest solution from the latest visible configuration."""

from __future__ import annotations

import re

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.types.messages import Message

ROD = re.compile(r"^- ([ABC]): \|bottom, \[([\d, ]*)\], top\|$", flags=re.MULTILINE)
ACTION = re.compile(r"rod ([ABC]) to the top of rod ([ABC])")


def plays(reading: Reading) -> bool:
    """Whether the actions move disks between rods."""
    return all(ACTION.search(action) for action in reading.actions)


def decide(reading: Reading) -> Message:
    """Observe if no configuration is visible, or else make the next move of the shortest solution."""
    if not reading.observations:
        return call("observe")
    rod_of = {
        int(disk): rod for rod, disks in ROD.findall(reading.observations[-1]) for disk in re.findall(r"\d+", disks)
    }
    moves = {match[1] + match[2]: action for action in reading.actions if (match := ACTION.search(action))}
    action = moves.get(next_move(rod_of))
    if action is None:  # the configuration cannot be read, or is solved already
        return call("observe") if reading.seen[-1].tool != "observe" else call("act", action=reading.actions[0])
    return call("act", action=action)


def next_move(rod_of: dict[int, str], goal: str = "C") -> str:
    """Return the first move (source, then target) of the shortest solution that gathers all disks on `goal`.

    From the largest disk down: a disk that is already on the goal rod stays; any other has to move there, so the
    smaller ones must first be gathered on the third rod. The last disk that has to move is free to do so.
    """
    move = ""
    for disk in sorted(rod_of, reverse=True):
        rod = rod_of[disk]
        if rod != goal:
            move = rod + goal
            (goal,) = {"A", "B", "C"} - {rod, goal}
    return move
