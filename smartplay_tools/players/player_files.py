"""Players in a file: `FILE.py:CLASS` names a class of yours on the command line, without a package around it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from smartplay_tools.registry import read_file


def load_from_file(name: str) -> Callable[..., Any]:
    """Return a function that makes the player `FILE.py:CLASS`, without `seed` if its constructor takes none."""
    factory = read_file(name)

    def make(*, seed: int, **options: Any) -> Any:
        return factory(**({"seed": seed} if takes_seed(factory) else {}), **options)

    return make


def takes_seed(factory: Callable[..., Any]) -> bool:
    """Return whether a factory of players takes `seed`; True if its signature is not known."""
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return True
    return any(parameter.name == "seed" or parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters)
