"""Crafter's observation text, equal to the original's byte for byte, including its mistakes.

The mistakes: "able take" in the sentence about sleep, "1 steps", a status sentence that follows the action without a
space, and one sentence instead of the whole text wherever the original fails near the border of the map. The corrected
mode fixes what hides the game: near the border it describes what can be seen, and a death in sleep is reported.
"""

from __future__ import annotations

import functools

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.views import Sight
from smartplay_tools.games.crafter.world import cells_around, position

_COMPASS = {"move_left": "move_west", "move_right": "move_east", "move_up": "move_north", "move_down": "move_south"}
_ACTIONS_IN_WORDS = tuple(_COMPASS.get(action, action) for action in facts.ACTIONS)
ACTIONS = tuple(action.replace("_", " ").title() for action in _ACTIONS_IN_WORDS)
"""The actions by their names for a player, in the engine's order."""
NUMBERED_ACTIONS = (*ACTIONS[1:], ACTIONS[0])
"""The actions in the order of the manual, which begins with Move West and ends with Noop."""

_TOOK = tuple(f"You took action {action}." for action in _ACTIONS_IN_WORDS)
_ASLEEP = "You are sleeping, and will not be able take actions until energy is full.\n\n"
_DEAD = "You died.\n\n"
_NOTHING_SEEN = "You see nothing away from you."
_NO_INVENTORY = "You have nothing in your inventory."
OUT_OF_MAP = "Error, you are out of the map."

# The view, nearest cell first and, at the same distance, western columns before eastern and north before south.
_COLUMNS, _ROWS = facts.VIEW
_CELLS = [(i // _ROWS - _COLUMNS // 2, i % _ROWS - _ROWS // 2) for i in range(_COLUMNS * _ROWS)]
_NEAREST_FIRST = sorted(range(len(_CELLS)), key=lambda i: (abs(_CELLS[i][0]) + abs(_CELLS[i][1]), i))
_ORDER = bytes(_NEAREST_FIRST)
_FILL = bytes(256 - len(_CELLS))


def _direction(dx: int, dy: int) -> str:
    parts = ("north" if dy < 0 else "south" if dy > 0 else "", "west" if dx < 0 else "east" if dx > 0 else "")
    return "-".join(part for part in parts if part)


_LINES = [
    [
        f"\n- {name} {abs(dx) + abs(dy)} steps to your {_direction(dx, dy)}"
        for dx, dy in (_CELLS[i] for i in _NEAREST_FIRST)
    ]
    for name in facts.NAMES
]
"""The line about a thing, by its id and by the rank of its cell in the order above."""
_MENTIONED = frozenset(range(1, len(facts.NAMES))) - {facts.PLAYER}
"""What a line can be about: anything on the map except the player."""


def describe(sight: Sight, action: int | None = None, *, dead: bool = False, corrected: bool = False) -> str:
    """The observation after an action of the engine, or after the reset if there was none."""
    surface, at = sight.surface, sight.at
    faced = surface[at + sight.facing]
    if not corrected and (not faced or _too_close_to_border(at)):
        return OUT_OF_MAP
    # In the original, sleep hides a death: a zombie strikes after the player's turn, in which it would have woken up.
    asleep = sight.sleeping and not (dead and corrected)
    status = _ASLEEP if asleep else _DEAD if dead else ""
    amounts = _amounts(*sight.inventory.values())
    text = f"{status}\n\n{_view(surface, at)}\n\nYou face {facts.NAMES[faced]} at your front.\n\n{amounts}"
    return text.strip() if action is None else _TOOK[action] + text


def _too_close_to_border(at: int) -> bool:
    """Whether the original's view would begin at a negative index, which is the other end of the map."""
    x, y = position(at)
    return x < _COLUMNS // 2 or y < _ROWS // 2


def _view(surface: bytes | bytearray, at: int) -> str:
    # Used as a table for `translate`, the view gives its cells in the wanted order at once.
    nearest_first = _ORDER.translate(cells_around(surface, at) + _FILL)
    lines = [_LINES[name][nearest_first.index(name)] for name in sorted(set(nearest_first)) if name in _MENTIONED]
    return "You see:" + "".join(lines) if lines else _NOTHING_SEEN


@functools.lru_cache(maxsize=4096)
def _amounts(*amounts: int) -> str:
    """Vitals and items; cached, because the amounts rarely change from step to step."""
    vitals = [f"- {name}: {amount}/{facts.MOST}" for name, amount in zip(facts.VITALS, amounts, strict=False)]
    items = [f"- {name}: {n}" for name, n in zip(facts.ITEMS, amounts[len(facts.VITALS) :], strict=True) if n]
    inventory = ["Your inventory:", *items] if items else [_NO_INVENTORY]
    return "\n".join(["Your status:", *vitals, "", *inventory])
