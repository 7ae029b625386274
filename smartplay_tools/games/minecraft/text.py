"""The observation text, in the original's words.

The mode `paper` keeps the original's bugs: directions of seen things are computed from wrong angles, and the blocks
whose name comes first in the alphabet are treated as background and form a single group. The mode `corrected` computes
directions from the rays and groups all blocks alike. The text is otherwise the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from smartplay_tools.games.minecraft.observation import NEAR, VIEW, VIEW_STEP, Observation, TextMode

COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")

BELOW = 1
"""The number of layers below the feet that are described; above them, all are."""

LONGEST_NAME = 48
"""No display name of the game is longer."""

LONGEST = 200 + (NEAR**3 + 2 * VIEW**2) * (LONGEST_NAME + 80)
"""An upper bound of an observation's lines: one for each block and each ray, and the lines around them."""

CHARACTERS = "".join(map(chr, range(32, 127))) + "\n"

_FACES = ndimage.generate_binary_structure(3, 1)
_ALL_NEIGHBOURS = ndimage.generate_binary_structure(2, 2)


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


@dataclass(frozen=True)
class Groups:
    """Connected groups of cells with equal names, in the order of their first cells."""

    names: list[str]
    cells: NDArray[np.intp]
    """Flat indices of the cells of all groups, ascending."""
    group: NDArray[np.intp]
    """For each of these cells its group."""

    @property
    def sizes(self) -> NDArray[np.intp]:
        """The number of cells of each group."""
        return np.bincount(self.group)


def groups(names: NDArray[np.str_], *, ignored: frozenset[str], mode: TextMode) -> Groups:
    """Group the cells of an array of names.

    Blocks connect through faces, the view's cells also through corners. In `paper` mode the alphabetically first name
    is one group, connected or not, and comes first, because the labelling treats it as background.
    """
    found, codes = _coded(names)
    wanted = [code for code, name in enumerate(found) if name not in ignored]
    background = mode == "paper" and 0 in wanted
    labels = _labels(codes, wanted[background:]).ravel()
    codes = codes.ravel()
    if background:
        labels[codes == 0] = labels.max() + 1
    cells = np.flatnonzero(labels)
    labels = labels[cells]
    # NumPy assigns one after the other, so that in reverse the first cell of each group is what remains.
    first = np.zeros(labels.max(initial=0) + 1, np.intp)
    first[labels[::-1]] = cells[::-1]
    order = np.append(first[1:-1], -1).argsort() if background else first[1:].argsort()
    place = np.empty(len(first), np.intp)
    place[1 + order] = np.arange(len(order))
    return Groups([found[code] for code in codes[first[1 + order]].tolist()], cells, place[labels])


def _coded(names: NDArray[np.str_]) -> tuple[list[str], NDArray[np.intp]]:
    """The names that there are, in alphabetical order, and the index of each cell's name."""
    flat = names.ravel()
    # Only the first of neighbours with one name is compared with all others.
    heads = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    heads = np.concatenate([[0], heads])
    found, codes = np.unique(flat[heads], return_inverse=True)
    return found.tolist(), codes.repeat(np.diff(heads, append=flat.size)).reshape(names.shape)


def _labels(codes: NDArray[np.intp], wanted: Sequence[int]) -> NDArray[np.intp]:
    """A number over 0 for every cell with one of these codes, the same for connected cells of one code."""
    if not wanted:
        return np.zeros(codes.shape, np.intp)
    # One plane beside the other, with a gap between them, because a call of the labelling costs more than its cells.
    planes = np.zeros((*codes.shape[:-1], len(wanted), codes.shape[-1] + 1), bool)
    planes[..., :-1] = codes[..., None, :] == np.array(wanted)[:, None]
    flat = planes.reshape(*codes.shape[:-1], -1)
    labels, _ = ndimage.label(flat, _FACES if codes.ndim == 3 else _ALL_NEIGHBOURS)
    together: NDArray[np.intp] = labels.reshape(planes.shape)[..., :-1].max(axis=-2).astype(np.intp)
    return together


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
    middle = NEAR // 2
    nearest: dict[str, tuple[float, str]] = {}
    blocks = seen.blocks[:, middle - BELOW :, :]
    found = groups(blocks, ignored=frozenset({"air"}), mode=mode)
    sizes = found.sizes
    middles = [np.bincount(found.group, axis) / sizes for axis in np.unravel_index(found.cells, blocks.shape)]
    for name, x, y, z in zip(found.names, *(axis.tolist() for axis in middles), strict=True):
        dx, dy, dz = x - middle, y - BELOW, z - middle
        distance = math.sqrt(dx**2 + dy**2 + dz**2)
        if distance and (name not in nearest or distance < nearest[name][0]):
            vertical = "above you " if dy > 0 else "below you " if dy < 0 else ""
            nearest[name] = distance, f"{vertical}to {_compass(south=dz, east=dx, at_least=0)}"
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
    distances = distances[1:]
    found = groups(names[1:].reshape(VIEW, VIEW), ignored=ignored, mode=mode)
    # As above, in reverse: the nearest cell of each group is what remains, the first of several.
    order = distances[found.cells].argsort(kind="stable")[::-1]
    nearest = np.zeros(len(found.names), np.intp)
    nearest[found.group[order]] = found.cells[order]
    values = nearest.tolist(), distances[nearest].tolist(), found.sizes.tolist()
    for name, cell, distance, size in zip(found.names, *values, strict=True):
        share = 100 * size / VIEW**2
        yield f" - {name}, {distance:.2f} blocks away, {direction(seen, cell)}, taking {share:.0f}% of screen"


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
