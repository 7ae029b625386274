"""The functions of the compiled engine that Python calls, each over many worlds.

numba caches compiled functions, but only notices changes in the file of the called function itself. The functions
therefore have a digest of all their sources in their names, by which the files of the cache are named. So no file is
read that an earlier version of the package has left.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from numba import njit

from smartplay_tools.games.crafter.compiled.pictures import draw, scratch
from smartplay_tools.games.crafter.compiled.step import room_needed, step
from smartplay_tools.games.crafter.compiled.views import see_ids, see_symbols
from smartplay_tools.games.crafter.compiled.worldgen import begin_terrain, begin_world

_SOURCES = (
    *("balance.py", "facts.py", "noise.py", "observations.py", "pictures.py", "textures.py", "world.py", "worldgen.py"),
)
"""Further modules whose tables are compiled in."""


class Entries(NamedTuple):
    """The functions. `which` are the numbers of the worlds to work on; the others do not change."""

    begin_terrain: Callable[..., int]
    begin_world: Callable[..., int]
    step_worlds: Callable[..., tuple[int, int]]
    identify_worlds: Callable[..., None]
    symbolize_worlds: Callable[..., None]
    draw_worlds: Callable[..., None]


def _digest() -> str:
    """Digits that change when any of the source files changes."""
    here = Path(__file__).parent
    sources = [*sorted(here.glob("*.py")), *(here.parent / name for name in _SOURCES)]
    digest = hashlib.blake2b(digest_size=8)
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()


@functools.cache
def entries() -> Entries:
    """The functions, compiled or read from numba's cache when each is first called."""
    return _make(_digest())


def _make(digest: str) -> Entries:
    def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
        function.__qualname__ += f"_{digest}"
        made: Callable[..., Any] = njit(nogil=True, boundscheck=False, error_model="numpy", cache=True)(function)
        return made

    @compiled
    def begin_one_terrain(worlds: Any, number: int, seed: int, geometry: Any, terrain: Any, slack: float) -> int:
        return begin_terrain(worlds[number], seed, geometry[0], terrain[0], slack)

    @compiled
    def begin_one_world(
        worlds: Any, things: Any, near: Any, number: int, geometry: Any, start: Any, terrain: Any
    ) -> int:
        parts = worlds[number], things[number], near[number]
        count = begin_world(*parts, geometry[0], start, terrain[0])
        return max(count, room_needed(worlds[number]))

    @compiled
    def step_worlds(
        worlds: Any, things: Any, near: Any, which: Any, light: Any, actions: Any, rewards: Any
    ) -> tuple[int, int]:
        most, latest = 0, 0
        for i in range(len(which)):
            w = which[i]
            rewards[w] = step(worlds[w], things[w], near[w], light, actions[w])
            most, latest = max(most, room_needed(worlds[w])), max(latest, worlds[w].steps)
        return most, latest

    @compiled
    def identify_worlds(worlds: Any, which: Any, out: Any) -> None:
        for i in range(len(which)):
            see_ids(worlds[which[i]], out[which[i]])

    @compiled
    def symbolize_worlds(worlds: Any, things: Any, near: Any, which: Any, light: Any, out: Any) -> None:
        for i in range(len(which)):
            w = which[i]
            see_symbols(worlds[w], things[w], near[w], light, out[w])

    @compiled
    def draw_worlds(worlds: Any, things: Any, near: Any, which: Any, light: Any, tables: Any, out: Any) -> None:
        room = scratch()
        for i in range(len(which)):
            w = which[i]
            draw(worlds[w], things[w], near[w], light, tables, room, out[w])

    return Entries(begin_one_terrain, begin_one_world, step_worlds, identify_worlds, symbolize_worlds, draw_worlds)
