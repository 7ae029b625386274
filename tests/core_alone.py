"""Runs every command in one process in which no optional dependency can be imported, and prints how each one ended.

Their output goes to files of ASCII, which has fewer characters than any other encoding.

python tests/core_alone.py FOLDER      FOLDER is empty, and gets the files that the commands write
"""

from __future__ import annotations

import importlib.abc
import io
import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

GAME = "Hanoi3Disk-v0"
RUN = ("--games", GAME, "--executor", "inline", "--trials", "2")
COMMANDS = (
    ("games",),
    ("manual", GAME),
    ("play", GAME, "--player", "rule", "--transcript", "hanoi.jsonl"),
    ("play", GAME, "--quiet"),
    ("replay", "hanoi.jsonl"),
    ("demo", "--out", "demo"),
    ("doctor", "--only", "core"),
    ("eval", *RUN, "--players", "rule,random", "--out", "run"),
    ("agent", GAME, "--out", "agent", "--", sys.executable, "-c", "pass"),
    ("check", "--players", "rule"),
    ("sweep", *RUN, "--players", "rule", "--history", "1,5", "--out", "sweep"),
    ("merge", "run", "--out", "merged"),
    ("results", "run"),
    ("compare", "run", "sweep"),
    ("cost", "run"),
    ("report", "run", "--out", "run.html"),
    ("export", "run", "--out", "rows.jsonl"),
    ("view", "--play", "any", "--port", "0"),
    ("view", "run", "--port", "0"),
    ("serve", "openai", "--port", "0"),
    ("serve", "mcp", GAME, "--http", "--port", "0"),
    ("serve", "window", GAME, "--port", "0"),
    ("model", "get", "--help"),
)


class Absent(importlib.abc.MetaPathFinder):
    """Finds the modules of the optional dependencies before anything else does, and says that they are not there."""

    def __init__(self) -> None:
        needed = [Requirement(line) for line in metadata.requires("smartplay-tools") or ()]
        optional = {canonicalize_name(each.name) for each in needed if each.marker and not each.marker.evaluate()}
        core = {canonicalize_name(each.name) for each in needed if not each.marker or each.marker.evaluate()}
        found = metadata.packages_distributions().items()
        kept = {"smartplay-tools"} | core
        self.modules = {
            module
            for module, owners in found
            if not kept.intersection(names := {canonicalize_name(owner) for owner in owners}) and names & optional
        }

    def find_spec(self, name: str, *_: object) -> None:
        if name.partition(".")[0] in self.modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def ended(command: tuple[str, ...]) -> dict[str, object]:
    """The exit code of a command, or the exception that it ended with, and what it wrote to standard error."""
    from smartplay_tools.cli import app

    code: object = 0
    error = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    with redirect_stdout(io.TextIOWrapper(io.BytesIO(), encoding="ascii")), redirect_stderr(error):
        try:
            app(list(command))
        except SystemExit as stop:
            code = stop.code
        except Exception as bug:
            code = repr(bug)
    error.flush()
    return {"command": command, "code": code, "error": error.buffer.getvalue().decode()}


if __name__ == "__main__":
    sys.meta_path.insert(0, Absent())
    os.chdir(sys.argv[1])
    print(json.dumps([ended(command) for command in COMMANDS]))
