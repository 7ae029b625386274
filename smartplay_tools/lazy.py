"""Exports that are imported when they are first used, so that importing a package takes milliseconds (PEP 562).

A package lists its exports twice: for type checkers and editors as ordinary imports under `TYPE_CHECKING`, and for
Python as the table that it passes here. A test keeps the two equal.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["lazy_exports"]


def lazy_exports(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package.

    `modules` maps each module to the names that the package exports from it, separated by spaces.
    """
    places = {name: module for module, names in modules.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(places[name]), name)
        setattr(sys.modules[package], name, value)  # the next time it is an ordinary attribute
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places})

    return find, names, sorted(places, key=_constants_classes_functions)


def _constants_classes_functions(name: str) -> tuple[bool, bool, str]:
    return not name.isupper(), name.islower(), name
