"""The search for the Luanti server and Minetest Game on this machine.

Debian 12 calls the program minetestserver; it has been luantiserver since. Debian's programs in /usr/games are scripts
that add options of a public server, so the real programs come first.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from smartplay_tools.errors import InvalidArgumentError

VARIABLE = "SMARTPLAY_LUANTI"
"""Environment variable that names the server's program, or a folder with the program and the game in it."""

GAME = "minetest_game"

_PROGRAMS = ("luantiserver", "minetestserver")
_PROGRAM_FOLDERS = ("/usr/lib/luanti", "/usr/lib/minetest", "/usr/libexec/luanti", "/usr/libexec/minetest")
_DATA_FOLDERS = (
    "/usr/share/games/luanti",
    "/usr/share/games/minetest",
    "/usr/share/luanti",
    "/usr/share/minetest",
    "/usr/local/share/luanti",
    "/usr/local/share/minetest",
    "~/.luanti",
    "~/.minetest",
)

_REMEDY = (
    f"install it (Debian 12: apt install minetest-server minetest-data) or set {VARIABLE} to the server's program."
)


@dataclass(frozen=True)
class Installation:
    """The paths that are needed to start a server."""

    program: Path
    game: Path


def find_installation() -> Installation:
    """Find server and game; raise `InvalidArgumentError` with the remedy if one of them is missing."""
    named = os.environ.get(VARIABLE) or None
    program = _find_program(named)
    folders = [] if named is None else [Path(named), *program.parents]
    folders += [Path(folder).expanduser() for folder in _DATA_FOLDERS]
    for folder in folders:
        for game in (folder / "games" / GAME, folder / "share" / "luanti" / "games" / GAME, folder / GAME):
            if (game / "game.conf").is_file():
                return Installation(program, game)
    raise InvalidArgumentError(
        f"The Luanti server {program} is here, but {GAME} is not: install the game's data (Debian 12: apt install "
        "minetest-data) or put the game into ~/.minetest/games."
    )


def _find_program(named: str | None) -> Path:
    if named is not None:
        places = [Path(named), *(Path(named) / folder / name for folder in (".", "bin") for name in _PROGRAMS)]
        if program := next(filter(_is_program, places), None):
            return program.resolve()
        raise InvalidArgumentError(
            f"{VARIABLE} is {named!r}, where there is no Luanti server: set it to the server's program."
        )
    candidates = [Path(folder) / name for folder in _PROGRAM_FOLDERS for name in _PROGRAMS]
    candidates += [Path(path) for name in _PROGRAMS if (path := shutil.which(name))]
    if program := next(filter(_is_program, candidates), None):
        return program
    raise InvalidArgumentError(f"There is no Luanti server on this machine: {_REMEDY}")


def _is_program(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)
