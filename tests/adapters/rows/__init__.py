"""Each adapter's rows of the conformance tests: one module an adapter, found by its being here.

A module has rows by name: `WINDOW` of adapters that manage the context, `HOST` of those whose host does, or both. One
whose framework is not installed has none; an adapter whose framework needs an environment of its own has its row in its
test file instead, with the classes `WindowConformance` and `SituationConformance`.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from tests.adapters.conformance import Host, Window

WINDOW: dict[str, Window] = {}
HOST: dict[str, Host] = {}


def module(name: str) -> Any:
    """A module of rows, or None if its framework is not installed."""
    try:
        return importlib.import_module(f"{__name__}.{name}")
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith(("tests", "smartplay")):
            raise
        return None


for each in pkgutil.iter_modules(__path__):
    found = module(each.name)
    WINDOW |= getattr(found, "WINDOW", {})
    HOST |= getattr(found, "HOST", {})
