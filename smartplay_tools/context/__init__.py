"""The context of a model: the words around a game, their tokens, turns, and the window that selects those to show.

prompts/     the texts that this library adds around the games, by version
tokens/      budget tokens: exact and offline
turns        a turn: a reply, its calls and their results
strategies/  what happens to the past, one class for each way
window       the window: levels, counts, prompts
newest       which turns it shows by itself
choosing     what it shows where a strategy chooses; `compacting` where a compactor rewrites
compaction   compactors: what they are given, and how code that does not yield becomes one
rewriting    the history that a compactor rewrites: messages of the conversation, and new ones
view         what a prompt shows
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.context.compaction import (
        Compactor as Compactor,
        ContextOverflowError as ContextOverflowError,
        GivenHistory as GivenHistory,
        Room as Room,
        asked as asked,
    )
    from smartplay_tools.context.turns import Item as Item, Turn as Turn, TurnBuilder as TurnBuilder
    from smartplay_tools.context.view import Selection as Selection, View as View
    from smartplay_tools.context.window import ContextWindow as ContextWindow

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
