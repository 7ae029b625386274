"""Rules for MESSENGER, in modules that are listed in the order in which a decision is made.

board   parses observations; tables of the geometry
manual  parses the sentences of the manual
casts   the possible meanings of all sentences together, with probabilities
belief  the possible places of everything, with probabilities
player  the value of each action, the decision, and the memory of a player that keeps one
"""

from smartplay_tools.players.rules.messenger.player import decide, plays, remember

__all__ = ["decide", "plays", "remember"]
