"""The cases of the conformance tests, one module for each adapter; every module of this folder is found.

A module has cases by name: `WINDOW` for adapters that manage the context, `HOST` for those whose host does, or both. A
module whose framework is not installed is left out. An adapter whose framework needs a separate environment has its
case in its test file instead, with the classes `WindowConformance` and `SituationConformance`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable
from typing import Any

from smartplay_tools.errors import MissingExtraError
from tests.adapters.conformance import Host, Window

QUICK = ("core", "mcp", "openai")
"""The modules whose rows fast tests play; the libraries of the others take seconds to import."""
FRAMEWORKS = tuple(each.name for each in pkgutil.iter_modules(__path__) if each.name not in QUICK)
"""The other modules."""


def module(name: str) -> Any:
    """A module of rows, or None if its framework is not installed."""
    try:
        return importlib.import_module(f"{__name__}.{name}")
    except MissingExtraError:
        return None
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith(("tests", "smartplay")):
            raise
        return None


def rows(names: Iterable[str]) -> tuple[dict[str, Window], dict[str, Host]]:
    """The rows of modules: those of adapters that manage the context, and those of adapters whose host does."""
    window: dict[str, Window] = {}
    host: dict[str, Host] = {}
    for found in map(module, names):
        window |= getattr(found, "WINDOW", {})
        host |= getattr(found, "HOST", {})
    return window, host
