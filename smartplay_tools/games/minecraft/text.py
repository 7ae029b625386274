"""The observation text, in the original's words.

The mode `paper` keeps the original's bugs: directions of seen things are computed from wrong angles, and the blocks
whose name comes first in the alphabet are treated as background and form a single group. The mode `corrected` computes
directions from the rays and groups all blocks alike. The text is otherwise the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.observation import NEAR, VIEW, VIEW_STEP, Observation, TextMode

COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")

BELOW = 1
"""The number of layers below the feet that are described; above them, all are."""

LONGEST_NAME = 48
"""No display name of the game is longer."""

LONGEST = 200 + (NEAR**3 + 2 * VIEW**2) * (LONGEST_NAME + 80)
"""An upper bound of an observation's lines: one for each block and each ray, and the lines around them."""

_AROUND = (NEAR, NEAR // 2 + 1 + BELOW, NEAR)
"""The blocks that are described, by x, y, z."""

_PLACES = np.indices(_AROUND).reshape(3, -1).tolist()
"""The coordinates of these blocks: for each axis a list by flat index."""


def describe(seen: Observation, mode: TextMode, action: str | None = None) -> str:
    """The observation after an action, or of a reset."""
    frame = [
        f"{_location(seen)}\n",
        _cursor(seen),
        _surroundings(seen, mode),
        _entities(seen, mode),
        _view(seen, mode),
    ]
    return ("" if action is None else f"You took action {action}.\n\n") + "\n".join(frame)


def components(names: NDArray[np.str_], *, ignored: frozenset[str], mode: TextMode) -> list[tuple[str, list[int]]]:
    """Connected groups of equal names as (name, flat indices), in the order of their first cells.

    Blocks connect through faces, the view's cells also through corners. In `paper` mode the alphabetically first name
    is one group, connected or not, and comes first, because the original's labelling treats it as background.
    """
    runs = _runs(names)
    background = min(runs)[0] if mode == "paper" else None
    groups: dict[int, tuple[str, list[int]]] = {}
    if background is not None and background not in ignored:
        groups[-1] = background, [cell for name, begin, end in runs if name == background for cell in range(begin, end)]
    runs = [run for run in runs if run[0] not in ignored and run[0] != background]
    for (name, begin, end), number in zip(runs, _connected(runs, names.shape), strict=True):
        groups.setdefault(number, (name, []))[1].extend(range(begin, end))
    return list(groups.values())


_Run = tuple[str, int, int]
"""A name and the flat indices of the first of its cells in a row, and of the first that follows them."""


def _runs(names: NDArray[np.str_]) -> list[_Run]:
    """The equal neighbours along the last axis, in order. There are few, which makes what follows fast."""
    begins = np.ones(names.shape, bool)
    np.not_equal(names[..., 1:], names[..., :-1], out=begins[..., 1:])
    first = np.flatnonzero(begins)
    at = first.tolist()
    return list(zip(names.ravel()[first].tolist(), at, [*at[1:], names.size], strict=True))


def _connected(runs: list[_Run], shape: tuple[int, ...]) -> list[int]:
    """For each run the number of the first run to which it is connected, directly or by way of others.

    Arrays this small have few runs: calls of SciPy's labelling, made for pictures, take longer than this loop.
    """
    rows, width, corners = shape[-2], shape[-1], len(shape) == 2
    groups = list(range(len(runs)))
    by_row: dict[int, list[tuple[str, int, int, int]]] = {}
    for number, (name, begin, end) in enumerate(runs):
        row = begin // width
        by_row.setdefault(row, []).append((name, begin, end, number))
        # The rows beside it that have been seen, one at most in each direction.
        before = [(row - 1, width)] if row % rows else []
        if row >= rows:
            before.append((row - rows, rows * width))
        for earlier, offset in before:
            low, high = begin - offset - corners, end - offset + corners
            for its_name, its_begin, its_end, other in by_row.get(earlier, ()):
                if its_begin < high and low < its_end and its_name == name:
                    group, its_group = _first(groups, number), _first(groups, other)
                    if group < its_group:
                        groups[its_group] = group
                    else:
                        groups[group] = its_group
    return [_first(groups, number) for number in range(len(runs))]


def _first(groups: list[int], number: int) -> int:
    """The first run of a group: every other one points to an earlier one."""
    while groups[number] != number:
        number = groups[number]
    return number


# Where the player is and what the cursor points at.


def _location(seen: Observation) -> str:
    x, y, z = seen.position.tolist()
    yaw = (seen.yaw + 180) % 360 - 180
    sector = (math.floor(yaw / 22.5) + 1) // 2 + 4
    look = " Looking up." if seen.pitch < 0 else " Looking down." if seen.pitch > 0 else ""
    return f"Coordinate ({x:.2f},{y:.2f},{z:.2f}). Facing {COMPASS[sector % 8]}.{look}"


def _cursor(seen: Observation) -> str:
    block = seen.ray_blocks[0]
    return "You're not aiming at any block." if block == "air" else f"You're aiming at {block}."


# Blocks around the player: the nearest group of each name.


def _surroundings(seen: Observation, mode: TextMode) -> str:
    # In the original's 32-bit numbers, rounding decides between groups that are equally far.
    number = np.float32 if mode == "paper" else np.float64
    middle = NEAR // 2
    nearest: dict[str, tuple[float, str]] = {}
    blocks = seen.blocks[:, middle - BELOW :, :]
    for name, cells in components(blocks, ignored=frozenset({"air"}), mode=mode):
        x, y, z = (number(sum(map(axis.__getitem__, cells))) / number(len(cells)) for axis in _PLACES)
        dx, dy, dz = x - middle, y - BELOW, z - middle
        distance = math.sqrt(dx**2 + dy**2 + dz**2)
        if distance and (name not in nearest or distance < nearest[name][0]):
            vertical = "above you " if dy > 0 else "below you " if dy < 0 else ""
            nearest[name] = distance, f"{vertical}to {_compass(south=float(dz), east=float(dx), at_least=0)}"
    lines = [f" - {name}, {distance:.2f} blocks away, {where}" for name, (distance, where) in nearest.items()]
    return "\n".join(["Around you:", *lines])


def _compass(*, south: float, east: float, at_least: float) -> str:
    words = [
        "south" if south > at_least else "north" if south < -at_least else "",
        "east" if east > at_least else "west" if east < -at_least else "",
    ]
    return "-".join(filter(None, words)) or "front"


# Things that the rays hit: every group, with its share of the view.


def _entities(seen: Observation, mode: TextMode) -> str:
    lines = _seen_things(seen, seen.ray_entities, seen.ray_entity_distances, frozenset({"null"}), mode)
    return "".join(f"{line}\n" for line in lines)


def _view(seen: Observation, mode: TextMode) -> str:
    lines = list(_seen_things(seen, seen.ray_blocks, seen.ray_block_distances, frozenset({"null", "air"}), mode))
    return "\n".join(["You see:", *lines]) if lines else ""


def _seen_things(
    seen: Observation, names: NDArray[np.str_], distances: NDArray[np.float32], ignored: frozenset[str], mode: TextMode
) -> Iterator[str]:
    direction: Callable[[Observation, int], str] = _paper_direction if mode == "paper" else _true_direction
    far = distances[1:].tolist()
    for name, cells in components(names[1:].reshape(VIEW, VIEW), ignored=ignored, mode=mode):
        nearest = min(cells, key=far.__getitem__)
        share = 100 * len(cells) / VIEW**2
        yield f" - {name}, {far[nearest]:.2f} blocks away, {direction(seen, nearest)}, taking {share:.0f}% of screen"


def _paper_direction(seen: Observation, cell: int) -> str:
    """The original's idea of a ray's direction.

    Its pitch spans 180 degrees where the rays span 96, and its yaw runs against the rays' and has the wrong sign, so
    that what is ahead is described as behind.
    """
    row, column = divmod(cell, VIEW)
    view = VIEW_STEP * (VIEW - 1)
    yaw = math.radians(column / (VIEW - 1) * view - view / 2 + seen.yaw)
    pitch = math.radians(row / (VIEW - 1) * 180 - 90 + seen.pitch)
    east, up, north = math.sin(yaw) * math.cos(pitch), math.sin(pitch), math.cos(yaw) * math.cos(pitch)
    return _direction(east, up, -north)


def _true_direction(seen: Observation, cell: int) -> str:
    east, up, south = seen.ray_directions[1 + cell].tolist()
    return _direction(east, up, south)


def _direction(east: float, up: float, south: float) -> str:
    vertical = "above you" if up > 0.2 else "below you" if up < -0.2 else "at your level"
    return f"{vertical} to {_compass(south=south, east=east, at_least=0.2)}"
