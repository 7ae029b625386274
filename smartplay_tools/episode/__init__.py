"""An episode: one game played once, through tool calls that are answered, counted and recorded."""

from smartplay_tools.episode.cells import cell_config
from smartplay_tools.episode.config import CellConfig, EpisodeConfig
from smartplay_tools.episode.episode import Episode, NewListener, add_listener
from smartplay_tools.episode.factory import EpisodeFactory, RewardName, reward_of
from smartplay_tools.episode.ledger import Listener
from smartplay_tools.episode.stats import EpisodeStats
from smartplay_tools.episode.tools import AsyncGameTools, GameTools, schema, tool_functions, tool_specs

__all__ = [
    "AsyncGameTools",
    "CellConfig",
    "Episode",
    "EpisodeConfig",
    "EpisodeFactory",
    "EpisodeStats",
    "GameTools",
    "Listener",
    "NewListener",
    "RewardName",
    "add_listener",
    "cell_config",
    "reward_of",
    "schema",
    "tool_functions",
    "tool_specs",
]
