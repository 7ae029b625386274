"""Strategies that a budget names (`Budget.strategy`); `context.strategies.custom` has the list of their names.

provider_edits  what providers do to a long conversation on their servers
imported        what the compaction of other projects, in the adapters, has in common
retrieval       memories into which turns are written as they leave
blind           choices that know nothing of a game

A class for a field of a budget is in `context.strategies`.
"""
