"""Players in a file: `FILE.py:CLASS` names a class of yours on the command line, without a package around it.

The name alone says where the class is, so it goes to worker processes as text, and each imports the file itself.
"""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, in_one_line


def is_in_file(name: str) -> bool:
    """Return whether a player's name is that of a class in a file."""
    return name.rpartition(":")[0].endswith(".py")


def load_from_file(name: str) -> Callable[..., Any]:
    """Return what makes the player `FILE.py:CLASS`. A class whose constructor takes no `seed` is made without one."""
    factory = read_file(name)

    def make(*, seed: int, **options: Any) -> Any:
        return factory(**({"seed": seed} if _takes_seed(factory) else {}), **options)

    return make


def read_file(name: str) -> Callable[..., Any]:
    """Import the file of `FILE.py:CLASS` and return the class; `InvalidArgumentError` if it is not there."""
    path, _, attribute = name.rpartition(":")
    held = getattr(_module(Path(path)), attribute, None)
    if not callable(held):
        raise InvalidArgumentError(f"{path} has no class {attribute!r}; name a player of it as {path}:CLASS.")
    read: Callable[..., Any] = held
    return read


def _module(path: Path) -> Any:
    """Return the module of a file, imported once in each process, with its folder among the places of imports."""
    name = f"smartplay_player_{sha256(str(path.resolve()).encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InvalidArgumentError(f"There is no file {path}; name a player of your own as FILE.py:CLASS.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    if (folder := str(path.resolve().parent)) not in sys.path:
        sys.path.append(folder)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the user's file does when it is imported
        del sys.modules[name]
        raise InvalidArgumentError(
            f"{path} cannot be imported: {type(error).__name__}: {in_one_line(error)}."
        ) from error
    return module


def _takes_seed(factory: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return True
    return any(parameter.name == "seed" or parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters)
