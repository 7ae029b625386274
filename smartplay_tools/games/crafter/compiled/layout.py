"""The memory layout of a compiled world: one record of fixed size, and a separate array of the things on its map.

A record has every number of a world that `fast.FastEngine` keeps in objects: two maps (laid out as in `world`), the
player, the chunks and the state of the random stream. Many worlds are one array of records: a world is copied by
assigning a row, pickled as bytes, and stepped without touching the memory of another.

The number of things varies, so they are in a second array with a row for each world. A row lists them in the order of
arrival, which is the order of their turns. A thing that leaves the map is marked as removed; marked things are dropped
whenever the list of near things is rebuilt, every `RELIST_STEPS` steps.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.balance import light
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, AREA, CARRIED, CHUNKS, LENGTH, NAMES
from smartplay_tools.games.crafter.world import COLUMN, MARGIN

Records = NDArray[np.void]
"""An array of one of the record types below."""

MAP = (AREA + 2 * MARGIN) * COLUMN
"""The number of cells of a map, including its margin."""
KEY = 624
"""The number of words in the state of a Mersenne Twister."""
MOST_ADDED = 3 * CHUNKS * CHUNKS + 1
"""The most things that a step adds, arrows aside: one of each kind in each chunk, and a plant."""

_CHUNK_COUNTS = ("i2", (CHUNKS * CHUNKS,))

THING = np.dtype(
    [
        ("at", "i2"),
        ("heading", "i2"),
        ("clock", "i2"),
        ("kind", "u1"),
        ("health", "u1"),
        ("entered", "i4"),  # when it came into its chunk: a count of all such events of its world
        ("removed", "u1"),
    ],
    align=True,
)

WORLD = np.dtype(
    [
        # The random stream, and its state before the last night's draws, which a picture repeats.
        ("key", "u4", (KEY,)),
        ("word", "i4"),
        ("night_word", "i4"),
        ("night_key", "u4", (KEY,)),
        # The maps.
        ("ground", "u1", (MAP,)),
        ("surface", "u1", (MAP,)),
        # The chunks that something has been in, in the order of the first visit, and the counts of each.
        ("visited", "u1", (CHUNKS * CHUNKS,)),
        ("visits", "u1", (CHUNKS * CHUNKS,)),
        ("chunk_count", "i4"),
        ("grass", *_CHUNK_COUNTS),
        ("paths", *_CHUNK_COUNTS),
        ("counts", "i2", (len(NAMES), CHUNKS * CHUNKS)),
        # The player.
        ("at", "i4"),
        ("facing", "i4"),
        ("inventory", "i4", (len(CARRIED),)),
        ("achievements", "i4", (len(ACHIEVEMENTS),)),
        ("unlocked", "i4"),
        ("sleeping", "i4"),
        ("hunger", "f8"),
        ("thirst", "f8"),
        ("recovery", "f8"),
        ("fatigue", "i4"),
        ("last_health", "i4"),
        # The rest.
        ("steps", "i4"),
        ("rewarded_health", "i4"),
        ("thing_count", "i4"),
        ("near_count", "i4"),
        ("entries", "i4"),
    ],
    align=True,
)

LIGHT = np.dtype([("daylight", "f8"), ("night", "i4"), ("zombies", "i4"), ("cows", "i4")], align=True)


@functools.cache
def light_table(days: int = 1) -> Records:
    """The light by step, for `days` times the usual length of an episode."""
    table = np.zeros(days * LENGTH + 1, LIGHT)
    for step in range(len(table)):
        table[step] = light(step)
    table.setflags(write=False)
    return table


def one_record(**arrays: NDArray[Any]) -> Records:
    """One record with copies of some arrays.

    As an argument of a kernel it is one address, where each array would be an object whose references are counted. The
    compiler knows the shapes.
    """
    record = np.zeros(1, np.dtype([(name, array.dtype, array.shape) for name, array in arrays.items()], align=True))
    for name, array in arrays.items():
        record[0][name] = array
    return record


def id_table(ids: tuple[int, ...]) -> NDArray[Any]:
    """For each id in `facts.NAMES`, whether it is one of `ids`."""
    table = np.zeros(len(NAMES), np.uint8)
    table[list(ids)] = 1
    return table
