"""The path of a Minecraft player, and the land around it.

With every engine an observation begins with the player's coordinates, so a path needs no server. The embedded world's
climate is a function of its seed, so for that engine the land can be drawn as well, including parts that were not seen.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from smartplay_tools.games.minecraft.game import Minecraft
from smartplay_tools.games.minecraft.voxel.climate import SPACING, Biome, biomes, climate
from smartplay_tools.games.minecraft.voxel.engine import VoxelEngine
from smartplay_tools.records.record import Record

FROM_TEXT = "The path is read from the coordinates in the observations."
WITH_LAND = (
    FROM_TEXT + " The land is computed from the world's seed; the player has never seen this map. "
    "A square is {spacing} x {spacing} blocks."
)

MARGIN = 48
"""Blocks of land around the path."""
NARROWEST = 0.6
"""The shorter side of the map, as a share of the longer."""
LONGEST_SIDE = 160
"""The most squares along a side of a map; their size follows from it."""

_COORDINATES = re.compile(r"^Coordinate \((-?[\d.]+),(-?[\d.]+),(-?[\d.]+)\)\. Facing ([a-z-]+)\.", re.MULTILINE)


def draw_walk(record: Record) -> dict[str, Any]:
    """Return the positions by step and, for the embedded world, the land around them."""
    config, positions = record.config, _positions(record)
    if not positions:
        return {"kind": None, "source": "No drawing: no observation has coordinates."}
    land: dict[str, Any] = {}
    if config.engine == "voxel":
        game = config.spec.make(**config.options, engine="voxel", history=0)
        assert isinstance(game, Minecraft)
        game.reset(seed=config.seed)
        assert isinstance(game.world, VoxelEngine)
        x, y, z = game.world.position
        positions.setdefault(0, (round(x, 2), round(y, 2), round(z, 2), "south"))
        land = _land(game.world.world.seed, [(x, z) for x, _, z, _ in positions.values()])
        land["goal"] = sorted(Biome(number).name for number in game.goal.biomes if number in set(Biome))
    walk = [positions.get(step) for step in range(max(positions) + 1)]
    source = WITH_LAND.format(spacing=land["spacing"]) if land else FROM_TEXT
    return {"kind": "minecraft", "source": source, "walk": walk, **land}


def _positions(record: Record) -> dict[int, tuple[float, float, float, str]]:
    """Return x, y, z and the heading for each observation that has coordinates."""
    texts: dict[int, str] = {}
    for head in record.heads:
        if "observation" in head:
            texts[0] = head["observation"]
    for call in record.calls:
        if (step := call["data"].get("observation_step")) is not None:
            texts[step] = call["text"]
    # If the host manages the context, a text has past observations first, so the last coordinates count.
    matches = {step: _COORDINATES.findall(text) for step, text in texts.items()}
    return {step: (float(m[-1][0]), float(m[-1][1]), float(m[-1][2]), m[-1][3]) for step, m in matches.items() if m}


def _land(seed: int, places: Sequence[tuple[float, float]]) -> dict[str, Any]:
    low, high = np.min(places, axis=0) - MARGIN, np.max(places, axis=0) + MARGIN
    longest = float((high - low).max())
    # A straight path has some land on both sides, too.
    narrow = np.maximum(NARROWEST * longest - (high - low), 0) / 2
    (west, north), (east, south) = low - narrow, high + narrow
    spacing = SPACING * -(-int(longest) // (SPACING * LONGEST_SIDE))
    left, top = int(west // spacing), int(north // spacing)
    x = np.arange(left, int(east // spacing) + 1) * spacing + spacing // 2
    z = np.arange(top, int(south // spacing) + 1) * spacing + spacing // 2
    squares = biomes(climate(seed, x[:, None], z[None, :]))
    names = [Biome(number).name for number in np.unique(squares)]
    letters = {Biome[name].value: chr(ord("a") + at) for at, name in enumerate(names)}
    rows = ["".join(letters[number] for number in row) for row in squares.T.tolist()]
    return {"spacing": spacing, "corner": [left * spacing, top * spacing], "biomes": names, "rows": rows}
