"""Pictures of what the rays of the view hit: a pixel for each ray, in the colour of its block or animal.

The view has 17 x 17 rays, so a picture shows what the text can say of it, no less and no more: what is there, in which
direction and, by its brightness, how far away. What the text says beyond the view (position, biome, the blocks around)
is not in it. Colours are whole numbers, so the same rays give the same picture everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.games.minecraft.observation import VIEW, VIEW_RANGE, Observation

SCALE = 12
"""How many times the pixels are enlarged: a picture has 204 x 204, because models read smaller ones badly."""

DIMMEST = 96
"""The brightness, of 256, of things at the farthest visible distance."""

_Colour = tuple[int, int, int]

BLOCKS: Mapping[str, _Colour] = {
    "air": (135, 190, 250),
    "bedrock": (60, 60, 60),
    "stone": (125, 125, 125),
    "gravel": (150, 140, 135),
    "dirt": (134, 96, 67),
    "grass block": (110, 170, 70),
    "podzol": (105, 75, 35),
    "mycelium": (125, 110, 125),
    "clay": (160, 166, 179),
    "sand": (220, 210, 160),
    "sandstone": (200, 185, 130),
    "snow block": (240, 250, 250),
    "ice": (160, 190, 255),
    "packed ice": (130, 165, 235),
    "moss stone": (95, 125, 95),
    "oak wood": (100, 80, 50),
    "birch wood": (215, 215, 205),
    "dark oak wood": (60, 45, 25),
    "spruce wood": (75, 55, 35),
    "jungle wood": (85, 70, 25),
    "acacia wood": (105, 100, 90),
    "oak leaves": (60, 120, 35),
    "birch leaves": (105, 140, 75),
    "dark oak leaves": (45, 95, 30),
    "spruce leaves": (55, 90, 60),
    "jungle leaves": (45, 140, 20),
    "acacia leaves": (125, 150, 40),
    "mushroom block": (200, 60, 50),
    "cactus": (20, 115, 35),
    "melon": (150, 160, 35),
    "water": (50, 80, 200),
    "snow": (225, 240, 245),
    "tall grass": (130, 195, 85),
    "fern": (90, 150, 75),
    "dead bush": (145, 105, 45),
    "dandelion": (250, 230, 50),
    "poppy": (230, 40, 30),
    "blue orchid": (40, 175, 250),
    "brown mushroom": (165, 125, 95),
    "red mushroom": (235, 75, 75),
    "lily pad": (30, 130, 50),
    "vines": (70, 130, 30),
}
"""The colour of a block at hand, by its name in corrected texts."""

ANIMALS: Mapping[str, _Colour] = {
    "chicken": (255, 250, 235),
    "cow": (85, 60, 45),
    "pig": (240, 165, 160),
    "sheep": (230, 225, 215),
    "horse": (170, 115, 60),
    "rabbit": (190, 160, 125),
    "wolf": (190, 185, 180),
    "ocelot": (245, 205, 90),
    "llama": (205, 180, 145),
    "mooshroom": (165, 15, 20),
    "squid": (35, 60, 90),
    "polarbear": (248, 246, 240),
}
"""The colour of an animal, by its name."""


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
