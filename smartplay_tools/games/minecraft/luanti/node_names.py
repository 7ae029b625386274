"""The names of Luanti's nodes in observations.

A node that also exists in Minecraft has Minecraft's name, so that a player's knowledge of Minecraft helps; any other
keeps its own title. As in the embedded engine, the paper's texts show display names, which are the same for all kinds
of trees and flowers, and the corrected texts name the kind.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from smartplay_tools.games.minecraft.observation import TextMode, displayed
from smartplay_tools.games.minecraft.text import LONGEST_NAME
from smartplay_tools.types.tables import read_table

_KINDS: Mapping[str, str] = read_table(__package__, "nodes.toml")
"""Node to name in corrected texts. Other nodes are called by their title."""


def display_name(node: str, title: str, mode: TextMode) -> str:
    """The name of a node; `title` is what Luanti calls it in its inventory."""
    kind = _KINDS.get(node) or _plain(title) or _plain(node)
    return kind if mode == "corrected" else displayed(kind)


def _plain(title: str) -> str:
    """The first line of a title in lower case, without escape sequences."""
    words = re.sub(r"\x1b\([^)]*\)|\x1b.", "", title).partition("\n")[0].lower()
    return " ".join(re.sub(r"[^!-~]|[,:_]", " ", words).split())[:LONGEST_NAME]
