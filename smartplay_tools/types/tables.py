"""Reads the TOML files that hold the data of modules, such as the words of prompts and the rules for pictures."""

from __future__ import annotations

from importlib import resources
from typing import Any

__all__ = ["read_table"]


def read_table(package: str, name: str) -> dict[str, Any]:
    """Return the parsed content of a TOML file in a package."""
    import tomllib  # slow to import, and a program that plays nothing reads no table

    return tomllib.loads(resources.files(package).joinpath(name).read_text(encoding="utf-8"))
