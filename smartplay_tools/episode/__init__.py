"""An episode: one game played once, through tool calls that are answered, counted and recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.episode.cells import cell_config as cell_config
    from smartplay_tools.episode.config import CellConfig as CellConfig, EpisodeConfig as EpisodeConfig
    from smartplay_tools.episode.episode import (
        Episode as Episode,
        NewListener as NewListener,
        add_listener as add_listener,
    )
    from smartplay_tools.episode.ledger import Listener as Listener
    from smartplay_tools.episode.stats import EpisodeStats as EpisodeStats
    from smartplay_tools.episode.tools import tool_specs as tool_specs
    from smartplay_tools.tool_formats.functions import (
        AsyncGameTools as AsyncGameTools,
        GameTools as GameTools,
        tool_functions as tool_functions,
    )
    from smartplay_tools.tool_formats.schemas import schema as schema

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
