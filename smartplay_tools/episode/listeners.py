"""Listeners: functions that are called with every event of every episode of this process as it is recorded.

Tracing needs to know when events happen, which a record does not hold, in all episodes, whatever plays them. A listener
sees what a record holds, and can change nothing. Episodes without a transcript have listeners, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from smartplay_tools.transcript.events import Event

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode

Listener = Callable[[Event], None]
"""Called with each event of one episode, in the thread that records it."""

NewListener = Callable[["Episode"], Listener]
"""Called with each new episode; returns the listener of its events."""

_LISTENERS: list[NewListener] = []


def add_listener(new_listener: NewListener) -> Callable[[], None]:
    """Listen to every episode that this process makes from now on; return a function that stops it for later ones."""
    _LISTENERS.append(new_listener)
    return lambda: _LISTENERS.remove(new_listener)


def listeners_of(episode: Episode) -> list[Listener]:
    """Return the listeners of a new episode."""
    return [new_listener(episode) for new_listener in _LISTENERS]
