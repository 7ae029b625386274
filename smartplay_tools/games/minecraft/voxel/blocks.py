"""Blocks: names, and what can be walked through."""

from __future__ import annotations

from enum import IntEnum, auto

import numpy as np

from smartplay_tools.games.minecraft.observation import TextMode, displayed


class Block(IntEnum):
    """What a cell holds."""

    AIR = 0
    BEDROCK = auto()
    STONE = auto()
    GRAVEL = auto()
    DIRT = auto()
    GRASS_BLOCK = auto()
    PODZOL = auto()
    MYCELIUM = auto()
    CLAY = auto()
    SAND = auto()
    SANDSTONE = auto()
    SNOW_BLOCK = auto()
    ICE = auto()
    PACKED_ICE = auto()
    MOSS_STONE = auto()
    OAK_WOOD = auto()
    BIRCH_WOOD = auto()
    DARK_OAK_WOOD = auto()
    SPRUCE_WOOD = auto()
    JUNGLE_WOOD = auto()
    ACACIA_WOOD = auto()
    OAK_LEAVES = auto()
    BIRCH_LEAVES = auto()
    DARK_OAK_LEAVES = auto()
    SPRUCE_LEAVES = auto()
    JUNGLE_LEAVES = auto()
    ACACIA_LEAVES = auto()
    MUSHROOM_BLOCK = auto()
    CACTUS = auto()
    MELON = auto()
    # The player can walk through all following blocks.
    WATER = auto()
    SNOW = auto()
    TALL_GRASS = auto()
    FERN = auto()
    DEAD_BUSH = auto()
    DANDELION = auto()
    POPPY = auto()
    BLUE_ORCHID = auto()
    BROWN_MUSHROOM = auto()
    RED_MUSHROOM = auto()
    LILY_PAD = auto()
    VINES = auto()


def _variety(block: Block) -> str:
    return block.name.lower().replace("_", " ")


NAMES: dict[TextMode, np.ndarray[tuple[int], np.dtype[np.str_]]] = {
    "paper": np.array([displayed(_variety(block)) for block in Block]),
    "corrected": np.array([_variety(block) for block in Block]),
}
"""Display names by block. In corrected texts, varieties have their own names."""

SOLID = bytes(Block.AIR < block < Block.WATER for block in Block)
"""By block: 1 if the player cannot enter it."""

SLIPPERY = bytes(block in (Block.ICE, Block.PACKED_ICE) for block in Block)
"""By block: 1 if feet slide on it."""
