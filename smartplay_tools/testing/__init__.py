"""Contract tests of games and of strategies, for everybody who adds one: what tools, budgets and records rely on."""

from smartplay_tools.testing.game_checks import CHECKS, check_game, plays_to_its_end, random_walk
from smartplay_tools.testing.strategy_checks import check_strategy

__all__ = ["CHECKS", "check_game", "check_strategy", "plays_to_its_end", "random_walk"]
