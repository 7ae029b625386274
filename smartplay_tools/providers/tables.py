"""The data files of providers: all in which one differs from the others is in one file of `data/`.

docs/servers.md says how a file is changed. What a provider has in common with others stands in the file of each, and
what no server is known to differ in stands under the name "any server".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

__all__ = ["names"]

ANY = "any server"
"""The name that stands for servers without a file; it comes last."""


@cache
def providers() -> Mapping[str, Mapping[str, Any]]:
    """Return every provider's file by the provider's name."""
    import tomllib  # slow to import, and most episodes need no table

    files = [file for file in (resources.files(__package__) / "data").iterdir() if file.name.endswith(".toml")]
    tables = [tomllib.loads(file.read_text(encoding="utf-8")) for file in files]
    named = {table["name"]: table for table in tables}
    return {name: named[name] for name in sorted(named, key=lambda name: (name == ANY, name.lower()))}


def each(*path: str) -> Iterator[tuple[str, Any]]:
    """Yield what the providers have at a path, such as "parts", "calls", with their names."""
    for name, table in providers().items():
        found: Any = table
        for key in path:
            found = found.get(key, {})
        if found:
            yield name, found


def rows(kind: str) -> list[tuple[str, Mapping[str, Any]]]:
    """Return every row of a kind with its provider."""
    return [(name, row) for name, listed in each(kind) for row in listed]


@cache
def names(*path: str) -> tuple[str, ...]:
    """Return the names that any provider lists."""
    return tuple(dict.fromkeys(name for _, listed in each(*path) for name in listed))


def merged(*path: str) -> dict[str, Any]:
    """Return the tables of all providers as one."""
    return {name: value for _, table in each(*path) for name, value in table.items()}


@cache
def provider_at(base_url: str) -> str:
    """Return the provider whose host an address has, in any region: `eu.api.openai.com` has a prefix for one."""
    host = f".{urlsplit(base_url).hostname or ''}"
    return next((name for name, ends in each("hosts") if host.endswith(tuple(ends))), ANY)
