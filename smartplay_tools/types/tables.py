"""Tables: what a module knows that is data, in a file of TOML beside it."""

from __future__ import annotations

from importlib import resources
from typing import Any

__all__ = ["read_table"]


def read_table(package: str, name: str) -> dict[str, Any]:
    """Return what a file of TOML in a package holds."""
    import tomllib  # slow to import, and a program that plays nothing reads no table

    return tomllib.loads(resources.files(package).joinpath(name).read_text(encoding="utf-8"))
