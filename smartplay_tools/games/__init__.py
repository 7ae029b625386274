"""The games and their settings. Each game is a module or folder with three parts: rules, text and environment.

base           `TextGame`, what all games share
specs          the settings of the benchmark
game_registry  settings by id, including those of other packages
paper_tables   the paper's tables

Nothing is imported here before it is asked for; a setting names its class as a string.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame, with_action_list
    from smartplay_tools.games.paper_tables import PAPER_RESULTS
    from smartplay_tools.games.specs import GAMES, GameSpec, get_spec, register

__all__ = ["GAMES", "PAPER_RESULTS", "GameSpec", "TextGame", "get_spec", "register", "with_action_list"]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            "base": ("TextGame", "with_action_list"),
            "paper_tables": ("PAPER_RESULTS",),
            "specs": ("GAMES", "GameSpec", "get_spec", "register"),
        },
    )
