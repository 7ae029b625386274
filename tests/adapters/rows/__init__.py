"""The cases of the conformance tests, one module for each adapter; every module of this folder is imported.

A module has cases by name: `WINDOW` for adapters that manage the context, `HOST` for those whose host does, or both. A
module whose framework is not installed is left out. An adapter whose framework needs a separate environment has its
case in its test file instead, with the classes `WindowConformance` and `SituationConformance`.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from smartplay_tools.errors import MissingExtraError
from tests.adapters.conformance import Host, Window

WINDOW: dict[str, Window] = {}
HOST: dict[str, Host] = {}


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


for each in pkgutil.iter_modules(__path__):
    found = module(each.name)
    WINDOW |= getattr(found, "WINDOW", {})
    HOST |= getattr(found, "HOST", {})
