"""The parser of MESSENGER's observations."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SeenEntities:
    """The content of an observation."""

    action: str | None
    """The action before it; None at the start."""
    has_message: bool
    things: Mapping[str, tuple[int, str]]
    """Name -> distance in cells, direction."""

    @classmethod
    def of(cls, text: str) -> SeenEntities:
        """Parse an observation."""
        action = re.search(r"^You took action (.+)\.$", text, flags=re.MULTILINE)
        things = re.findall(r"^- (\w+) (\d+) steps (?:to your |with )([\w-]+)$", text, flags=re.MULTILINE)
        return cls(
            action[1] if action else None,
            "already have the message" in text,
            {name: (int(distance), direction) for name, distance, direction in things},
        )
