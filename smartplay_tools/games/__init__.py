"""The games and their settings. Each game is a module or folder with three parts: rules, text and environment.

base            `TextGame`, what all games share
gymnasium_game  `GymnasiumGame`, a text game around a Gymnasium environment
game_registry   `GameSpec`, a setting, and the registry of settings by id, including those of other packages
specs           the settings of the benchmark, and of the game lockers
paper_tables    the paper's tables

Nothing is imported here before it is asked for; a setting names its class as a string.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame as TextGame, with_action_list as with_action_list
    from smartplay_tools.games.game_registry import GameSpec as GameSpec
    from smartplay_tools.games.gymnasium_game import GymnasiumGame as GymnasiumGame
    from smartplay_tools.games.paper_tables import PAPER_RESULTS as PAPER_RESULTS
    from smartplay_tools.games.specs import (
        GAMES as GAMES,
        get_spec as get_spec,
        lockers_setting as lockers_setting,
        register as register,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
