"""The names of players with a model behind them, such as `openai:MODEL`."""

from __future__ import annotations

from smartplay_tools.registry import is_in_file

BLIND = "blind"
"""The player `blind:PATH`, which has no model behind it."""


def is_model(name: str) -> bool:
    """Return whether a name is that of a player with a model behind it, such as `openai:MODEL`."""
    return ":" in name and not is_in_file(name) and not name.startswith(f"{BLIND}:")
