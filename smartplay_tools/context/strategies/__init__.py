"""Strategies: what becomes of the past, one class for each way to deal with it.

Each is a class in a file of its own: the field of `Budget` that asks for it, what it refuses, the tools it adds, the
tokens it reserves, what it hides, pins or asks for. `Strategies` creates the objects of one episode and combines them;
the window and the episode ask it, not the classes. To add one, write its class, list it in `KINDS` and add its field to
`Budget`.
"""

from smartplay_tools.context.strategies.ageing import drops_old_turns, turns_leave
from smartplay_tools.context.strategies.base import BudgetStrategy, StrategyTool, ToolAnswer, share_kept
from smartplay_tools.context.strategies.brought import load_strategy, register_strategy
from smartplay_tools.context.strategies.choices import Choice, Past, PastTurn, Strategy
from smartplay_tools.context.strategies.every import KINDS, Strategies, refusal
from smartplay_tools.context.strategies.memory import is_memory_tool
from smartplay_tools.context.strategies.summaries import Summaries, Summary, summaries_of

__all__ = [
    "KINDS",
    "BudgetStrategy",
    "Choice",
    "Past",
    "PastTurn",
    "Strategies",
    "Strategy",
    "StrategyTool",
    "Summaries",
    "Summary",
    "ToolAnswer",
    "drops_old_turns",
    "is_memory_tool",
    "load_strategy",
    "refusal",
    "register_strategy",
    "share_kept",
    "summaries_of",
    "turns_leave",
]
