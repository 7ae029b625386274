"""What can be sent to other processes: players and games that they can import.

A worker imports what a task names. It imports a script again, as `multiprocessing` does, but it cannot import a
notebook: what is defined there is known in the notebook's process only, and is played there.
"""

from __future__ import annotations

import pickle
import sys

from smartplay_tools.evaluation.runs.attempt import Task
from smartplay_tools.evaluation.runs.plan import player_of
from smartplay_tools.games.specs import GAMES

ELSEWHERE = ("processes", "ray")
"""Executors whose attempts are made in other processes."""


def why_only_here(task: Task) -> str | None:
    """Return why a task's player can be made in this process only, as a sentence; None if it can be made elsewhere."""
    player = player_of(task.planned.cell)
    if _is_without_file() and getattr(task.player.factory, "__module__", None) == "__main__":
        return (
            f"The player {player!r} is defined in this notebook, which worker processes cannot import; have it in a "
            'module, or ask for executor="inline".'
        )
    try:
        pickle.dumps(task)
    except Exception as error:
        return (
            f"The player {player!r} cannot be sent to worker processes ({error}); have it in a module under its name, "
            'or ask for executor="inline".'
        )
    return None


def is_known_only_here(game: str) -> bool:
    """Return whether a game was registered by the code of a notebook, and so in no other process."""
    return _is_without_file() and not GAMES.is_declared(game)


def _is_without_file() -> bool:
    """Whether the main program is a notebook or an interactive session, and so no file that could be imported."""
    return getattr(sys.modules["__main__"], "__file__", None) is None
