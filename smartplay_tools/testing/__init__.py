"""Contract tests of games and of strategies, for everybody who adds one: what tools, budgets and records rely on."""

from smartplay_tools.testing.game_checks import CHECKS, check_game, random_walk
from smartplay_tools.testing.strategy_checks import check_strategy

__all__ = ["CHECKS", "check_game", "check_strategy", "random_walk"]
