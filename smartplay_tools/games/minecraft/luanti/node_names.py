"""The names of Luanti's nodes in observations.

A node that also exists in Minecraft has Minecraft's name, so that a player's knowledge of Minecraft helps; any other
keeps its own title. As in the embedded engine, the paper's texts show display names, which are the same for all kinds
of trees and flowers, and the corrected texts name the kind.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from smartplay_tools.games.minecraft.observation import TextMode, displayed
from smartplay_tools.games.minecraft.text import LONGEST_NAME

_TREES = {"": "oak", "jungle": "jungle", "pine_": "spruce", "acacia_": "acacia", "aspen_": "birch"}
_FLOWERS = {
    "dandelion_yellow": "dandelion",
    "dandelion_white": "oxeye daisy",
    "rose": "poppy",
    "tulip": "orange tulip",
    "tulip_black": "black tulip",
    "viola": "allium",
    "geranium": "blue orchid",
    "chrysanthemum_green": "green chrysanthemum",
}

_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "air": "air",
        **{f"default:{tree}tree": f"{kind} wood" for tree, kind in _TREES.items()},
        **{f"default:{tree}leaves": f"{kind} leaves" for tree, kind in _TREES.items()},
        "default:pine_needles": "spruce leaves",
        "default:bush_stem": "oak wood",
        "default:bush_leaves": "oak leaves",
        "default:acacia_bush_stem": "acacia wood",
        "default:acacia_bush_leaves": "acacia leaves",
        "default:pine_bush_stem": "spruce wood",
        "default:pine_bush_needles": "spruce leaves",
        **{f"flowers:{flower}": kind for flower, kind in _FLOWERS.items()},
        "flowers:mushroom_brown": "brown mushroom",
        "flowers:mushroom_red": "red mushroom",
        "flowers:waterlily": "lily pad",
        "flowers:waterlily_waving": "lily pad",
        "default:dirt_with_grass": "grass block",
        "default:dirt_with_snow": "snowy grass block",
        "default:dirt_with_coniferous_litter": "podzol",
        "default:snow": "snow",
        "default:snowblock": "snow block",
        "default:ice": "ice",
        "default:cave_ice": "packed ice",
        "default:water_source": "water",
        "default:water_flowing": "water",
        "default:river_water_source": "water",
        "default:river_water_flowing": "water",
        "default:lava_source": "lava",
        "default:lava_flowing": "lava",
        "default:mossycobble": "moss stone",
        "default:stone_with_coal": "coal ore",
        "default:stone_with_iron": "iron ore",
        "default:stone_with_gold": "gold ore",
        "default:stone_with_diamond": "diamond ore",
        "default:dry_shrub": "dead bush",
        "default:papyrus": "sugar canes",
        "default:junglegrass": "tall grass",
        **{f"default:grass_{height}": "tall grass" for height in range(1, 6)},
        **{f"default:fern_{height}": "fern" for height in range(1, 4)},
        "default:sand_with_kelp": "sand",
    }
)
"""Node to name in corrected texts. Other nodes are called by their title."""


def display_name(node: str, title: str, mode: TextMode) -> str:
    """The name of a node; `title` is what Luanti calls it in its inventory."""
    kind = _KINDS.get(node) or _plain(title) or _plain(node)
    return kind if mode == "corrected" else displayed(kind)


def _plain(title: str) -> str:
    """The first line of a title in lower case, without escape sequences."""
    words = re.sub(r"\x1b\([^)]*\)|\x1b.", "", title).partition("\n")[0].lower()
    return " ".join(re.sub(r"[^!-~]|[,:_]", " ", words).split())[:LONGEST_NAME]
