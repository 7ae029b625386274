"""Pictures of what the rays of the view hit: a pixel for each ray, in the colour of its block or animal.

The view has 17 x 17 rays, so a picture shows what the text can say of it, no less and no more: what is there, in which
direction and, by its brightness, how far away. What the text says beyond the view (position, biome, the blocks around)
is not in it. Colours are whole numbers, so the same rays give the same picture everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.observation import VIEW, VIEW_RANGE, Observation
from smartplay_tools.types.tables import read_table

SCALE = 12
"""How many times the pixels are enlarged: a picture has 204 x 204, because models read smaller ones badly."""

DIMMEST = 96
"""The brightness, of 256, of things at the farthest visible distance."""

_COLOURS = read_table(__package__, "colours.toml")
BLOCKS, ANIMALS = ({name: tuple(_COLOURS[kind][name]) for name in _COLOURS[kind]} for kind in ("blocks", "animals"))
"""The colours of blocks at hand and of animals, by their names in corrected texts."""


def draw(seen: Observation) -> NDArray[np.uint8]:
    """Draw the view: rows from the top x columns from the left x red, green and blue."""
    # The first ray is the cursor's. Those of the view go from the right to the left, from below upwards.
    blocks, animals = seen.ray_blocks[1:].tolist(), seen.ray_entities[1:].tolist()
    is_animal = seen.ray_entities[1:] != "null"
    colours = [ANIMALS[name] if name != "null" else BLOCKS[block] for block, name in zip(blocks, animals, strict=True)]
    away = np.where(is_animal, seen.ray_entity_distances[1:], seen.ray_block_distances[1:]).astype(np.int32)
    brightness = 256 - (256 - DIMMEST) * away // int(VIEW_RANGE)
    brightness[~is_animal & (seen.ray_blocks[1:] == "air")] = 256
    pixels = np.array(colours, np.int32) * brightness[:, None] // 256
    return pixels.astype(np.uint8).reshape(VIEW, VIEW, 3)[::-1, ::-1]
