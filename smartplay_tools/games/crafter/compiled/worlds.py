"""Many compiled worlds as one object."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.crafter.compiled.entry import entries
from smartplay_tools.games.crafter.compiled.layout import THING, WORLD, Records, light_table
from smartplay_tools.games.crafter.compiled.noise import SLACK, geometry
from smartplay_tools.games.crafter.compiled.pictures import tables
from smartplay_tools.games.crafter.compiled.terrain import new_terrain
from smartplay_tools.games.crafter.facts import ACHIEVEMENTS, AREA, ARROW, CARRIED, LENGTH, NIGHT_PIXELS
from smartplay_tools.games.crafter.observations import IMAGE, SEMANTIC
from smartplay_tools.games.crafter.stream import twister_bytes, world_seed
from smartplay_tools.games.crafter.views import CENTER, Scene, Sight, body_texture, thing_texture
from smartplay_tools.games.crafter.world import (
    CHUNK_OF,
    COLUMN,
    DIRECTIONS,
    IN_VIEW,
    MARGIN,
    cells_around,
    position,
    without_margin,
)
from smartplay_tools.games.crafter.worldgen import FROM_CENTER, nearness
from smartplay_tools.games.crafter.worlds import Numbers

_ROOM = 512
"""The number of things that a world has room for at first."""


_LOCAL = threading.local()


def _terrain() -> Records:
    """The buffers of this thread for making worlds."""
    if not hasattr(_LOCAL, "terrain"):
        _LOCAL.terrain = new_terrain()
    terrain: Records = _LOCAL.terrain
    return terrain


class CompiledWorlds:
    """The implementation of `worlds.Worlds` with numba, in one thread or several."""

    def __init__(self, count: int, threads: int = 1) -> None:
        self.count = count
        self.rewards = np.zeros(count)
        self._records: Records = np.zeros(count, WORLD)
        self._things: Records = np.zeros((count, 0), THING)
        self._near = np.zeros((count, 0), np.int16)
        self._make_room(_ROOM)
        self._light = light_table()
        self._threads = threads
        self._pool: ThreadPoolExecutor | None = None

    def _make_room(self, room: int) -> None:
        """Make room for this many things in every world; existing things are kept."""
        things, near = np.zeros((self.count, room), THING), np.zeros((self.count, room), np.int16)
        had = self._things.shape[1]
        things[:, :had], near[:, :had] = self._things, self._near
        self._things, self._near = things, near

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_pool": None, "_light": len(self._light)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._light = light_table(state["_light"] // LENGTH)

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _share(self, work: Callable[[Numbers], Any], which: Numbers) -> list[Any]:
        """Let every thread do its share of the work."""
        if self._threads == 1 or len(which) == 1:
            return [work(which)]
        shares = [share for share in np.array_split(which, self._threads) if len(share)]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="crafter")
        return list(self._pool.map(work, shares))

    # Playing.

    def begin(self, which: Numbers, seeds: Sequence[int], episodes: Sequence[int]) -> None:
        """Make new worlds, each for an episode of a seed."""
        drawn = np.zeros(self.count, np.uint32)
        drawn[which] = [world_seed(seed, episode) for seed, episode in zip(seeds, episodes, strict=True)]
        todo = which
        while len(todo):
            needed = max(self._share(lambda share: self._begin(share, drawn), todo))
            # A world with more things than fit was left unfinished. This is rare, so all worlds are made again.
            todo = todo if needed > self._things.shape[1] else todo[:0]
            if len(todo):
                self._make_room(2 * needed)

    def _begin(self, which: Numbers, seeds: NDArray[np.uint32]) -> int:
        make, worlds, terrain, needed = entries(), (self._records, self._things, self._near), _terrain(), 0
        for number in which.tolist():
            self._records[number : number + 1].view(np.uint8).fill(0)
            unsure = make.begin_terrain(self._records, number, int(seeds[number]), geometry(), terrain, SLACK)
            near = terrain["starts"][0, :unsure]
            # The exponential in it has to be numpy's.
            if unsure:
                near = nearness(near, FROM_CENTER[terrain["cells"][0, :unsure]])
            needed = max(needed, make.begin_world(*worlds, number, geometry(), near, terrain))
        return needed

    def step(self, which: Numbers, actions: NDArray[np.int64]) -> None:
        """Play an action in each world in `which`; their rewards are then in `rewards`."""

        def work(share: Numbers) -> tuple[int, int]:
            worlds = self._records, self._things, self._near
            return entries().step_worlds(*worlds, share, self._light, actions, self.rewards)

        for needed, latest in self._share(work, which):
            if needed > self._things.shape[1]:
                self._make_room(2 * needed)
            if latest + 1 >= len(self._light):
                self._light = light_table(2 * (len(self._light) // LENGTH))

    # The state.

    @property
    def steps(self) -> NDArray[np.int32]:
        """The steps of each world since it began."""
        return self._field("steps")

    @property
    def carried(self) -> NDArray[np.int32]:
        """Vitals and items of each player, health first."""
        return self._field("inventory")

    @property
    def health(self) -> NDArray[np.int32]:
        """The health of each player; at 0 it is dead."""
        health: NDArray[np.int32] = self._records["inventory"][:, 0].copy()
        return health

    @property
    def achievements(self) -> NDArray[np.int32]:
        """How often each player reached each achievement."""
        return self._field("achievements")

    @property
    def positions(self) -> NDArray[np.int64]:
        """Where each player is, x and y."""
        at = self._field("at")
        return np.stack([at // COLUMN - MARGIN, at % COLUMN - MARGIN], axis=1).astype(np.int64)

    def _field(self, name: str) -> NDArray[Any]:
        field: NDArray[Any] = self._records[name].copy()
        return field

    # Observations and pictures.

    def observe(self, observation: str, which: Numbers, out: NDArray[Any]) -> None:
        """Write an observation (other than text) of each world in `which` into its row of `out`."""
        worlds, make = (self._records, self._things, self._near), entries()

        def work(share: Numbers) -> None:
            if observation == IMAGE:
                make.draw_worlds(*worlds, share, self._light, tables(), out)
            elif observation == SEMANTIC:
                make.identify_worlds(self._records, share, out)
            else:
                make.symbolize_worlds(*worlds, share, self._light, out)

        self._share(work, which)

    def semantic_map(self, number: int) -> NDArray[np.uint8]:
        """The ids of a whole map, by x and y."""
        cells = np.frombuffer(without_margin(self._records[number]["surface"]), np.uint8)
        return cells.reshape(AREA, AREA)

    def sight(self, number: int) -> Sight:
        """The part of a world's state that the observation text describes."""
        record = self._records[number]
        carried = dict(zip(CARRIED, record["inventory"].tolist(), strict=True))
        return Sight(
            record["surface"].tobytes(), int(record["at"]), int(record["facing"]), carried, bool(record["sleeping"])
        )

    def scene(self, number: int) -> Scene:
        """The part of a world's state that a picture shows."""
        record, sight, now = self._records[number], self.sight(number), self._light[self._records[number]["steps"]]
        body = body_texture(sight.facing, sleeping=sight.sleeping)
        things = [
            (thing_texture(int(thing["kind"]), int(thing["clock"]), int(thing["heading"])), *cell)
            for thing in self._things_of(number)
            if (cell := IN_VIEW.get(int(thing["at"]) - sight.at)) is not None
        ]
        return Scene(
            ground=cells_around(record["ground"].tobytes(), sight.at),
            things=[(body, *CENTER), *things],
            position=position(sight.at),
            inventory=sight.inventory,
            sleeping=sight.sleeping,
            daylight=float(now["daylight"]),
            grain=self._grain(number) if now["night"] else None,
        )

    def _things_of(self, number: int) -> Records:
        things: Records = self._things[number, : self._records[number]["thing_count"]]
        return things[things["removed"] == 0]

    def _grain(self, number: int) -> NDArray[np.float64]:
        """The draws of the last night, repeated."""
        record = self._records[number]
        stream = np.random.RandomState()
        night = {"key": record["night_key"], "pos": int(record["night_word"])}
        stream.set_state({"bit_generator": "MT19937", "state": night})
        return stream.random_sample(NIGHT_PIXELS)

    def state(self, number: int) -> Any:
        """The whole state of a world except the random stream, as JSON; the same for every engine."""
        record, things = self._records[number], self._things_of(number)
        counters = [float(record[name]) for name in ("hunger", "thirst", "fatigue", "recovery")]
        reached = {name: int(n) for name, n in zip(ACHIEVEMENTS, record["achievements"], strict=True) if n}
        player = [
            position(int(record["at"])),
            DIRECTIONS.index(int(record["facing"])),
            record["inventory"].tolist(),
            reached,
            bool(record["sleeping"]),
            counters,
            int(record["last_health"]),
        ]
        chunk_of = [CHUNK_OF[at] for at in things["at"].tolist()]
        by_entry = np.argsort(things["entered"], kind="stable").tolist()
        chunks = [
            [chunk, [n for n in by_entry if chunk_of[n] == chunk]]
            for chunk in record["visits"][: record["chunk_count"]].tolist()
        ]
        rows = [
            [kind, *position(at), health, clock, DIRECTIONS.index(heading) if kind == ARROW else 0]
            for at, heading, clock, kind, health, *_ in things.tolist()
        ]
        ground = without_margin(record["ground"]).hex()
        return [int(record["steps"]), int(record["rewarded_health"]), player, [ground, rows, chunks]]

    def fingerprint(self, number: int) -> bytes:
        """The state of a world's random stream."""
        record = self._records[number]
        return twister_bytes({"key": record["key"], "pos": record["word"]})
