"""The texts: the observation of a state, and the composition of a manual.

The observation is less precise than it seems. Distances are between cells, so half a cell is invisible; a diagonal
distance is the sum of both axes; and if two things have the same name, only the nearer is listed. The player has to
find out which one that is by watching it move.
"""

from __future__ import annotations

from collections.abc import Sequence

from smartplay_tools.games.base import read_text, with_action_list
from smartplay_tools.games.messenger.rules import ENTITIES, Game, Place, State

ACTIONS = ("Move North", "Move South", "Move West", "Move East", "Do Nothing")

STATUS = ("You (agent) don't have the message.", "You (agent) already have the message.")
DEAD = "Environment Error."
"""The original's observation of a dead avatar, the result of a bug there (docs/fidelity.md)."""
CAUGHT = "You were caught: you met an enemy, or the goal without the message."
"""The sentence that `text="corrected"` has instead."""


def names_by_role(game: Game, roles: int) -> tuple[str, ...]:
    """Return the name of each role; the decoys of level 3 have the names of message and goal."""
    return (*game, game.message, game.goal)[:roles]


def describe(state: State, names: Sequence[str], action: int | None = None, *, corrected: bool = False) -> str:
    """The observation: the action taken, if any, whether the agent has the message, and what it sees."""
    did = "" if action is None else f"You took action {ACTIONS[action]}.\n\n"
    if state.avatar is None:
        return f"{did}{CAUGHT}" if corrected else DEAD
    return f"{did}{STATUS[state.has_message]}\n\n{_sight(state.places, names, state.avatar)}"


def _sight(places: Sequence[Place | None], names: Sequence[str], avatar: Place) -> str:
    """List the nearest thing of every name, in the fixed order of the entities."""
    avatar_x, avatar_y = avatar[0] // 2, avatar[1] // 2
    nearest: dict[str, tuple[int, int, int]] = {}
    for name, place in zip(names, places, strict=True):
        if place is None:
            continue
        south, east = place[1] // 2 - avatar_y, place[0] // 2 - avatar_x
        seen = (abs(south) + abs(east), south, east)  # ties: the northern, then the western
        if name not in nearest or seen < nearest[name]:
            nearest[name] = seen
    if not nearest:
        return "You see nothing away from you."
    return "\n".join(["You see:", *(_line(name, *nearest[name]) for name in sorted(nearest, key=_ORDER.__getitem__))])


_ORDER = {name: position for position, name in enumerate(ENTITIES)}


def _line(name: str, distance: int, south: int, east: int) -> str:
    if distance == 0:
        return f"- {name} 0 steps with you"
    parts = ["north" if south < 0 else "south"] if south else []
    if east:
        parts.append("west" if east < 0 else "east")
    return f"- {name} {distance} steps to your {'-'.join(parts)}"


def compose(sentences: Sequence[str]) -> str:
    """The manual: the game's context, the sentences about this episode's entities, the advice, the actions."""
    context, advice = read_text(__package__, "context.txt"), read_text(__package__, "advice.txt")
    return with_action_list("\n\n".join(filter(None, [context, "\n".join(sentences), advice])), ACTIONS)
