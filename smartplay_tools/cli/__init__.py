"""The command line, `smartplay-tools`: one module per group of commands, imported when its command is called.

Exit codes: 0 is success; 1 is an episode or a check that failed; 2 is a command that cannot be carried out as given,
with one sentence on standard error that says why; 130 is a command that Ctrl-C has stopped.
"""

from __future__ import annotations

import codecs
import copy
import errno
import io
import json
import pkgutil
import re
import shutil
import sys
import warnings
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, SmartPlayWarning
from smartplay_tools.files.full_disk import FULL
from smartplay_tools.records.damage import DamageWarning
from smartplay_tools.registry import resolve
from smartplay_tools.terminal import make_streams_visible, say

TOO_MANY_OPEN = (errno.EMFILE, errno.ENFILE)
ANYWHERE = (*FULL, *TOO_MANY_OPEN)
"""Errors of a machine that has no room for a file, or for another one that is open."""

OF_FILES = frozenset(
    {*ANYWHERE, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST}
)
"""Errors of a place where a user wants a file: read-only, full, missing, or a folder."""


class _Entry(NamedTuple):
    """A command: the place of its function or `typer.Typer`."""

    place: str
    needs_arguments: bool = False
    of_group: str = ""
    """The summary of a group of commands; that of a command is in its docstring."""

    @property
    def summary(self) -> str:
        """The line in the list of commands. A docstring's is read from the source, which imports nothing."""
        if self.of_group:
            return self.of_group
        module, _, function = self.place.partition(":")
        source = (pkgutil.get_data(__name__, f"{module}.py") or b"").decode("utf-8")
        (summary,) = re.findall(rf'^def {function}\(.*?^    """(.+?)$', source, re.MULTILINE | re.DOTALL)
        return str(summary)


PANELS: Mapping[str, Mapping[str, _Entry]] = {
    "Play": {
        "games": _Entry("games:games"),
        "manual": _Entry("games:manual"),
        "play": _Entry("play:play"),
        "replay": _Entry("replay:replay"),
        "demo": _Entry("demo:demo"),
        "doctor": _Entry("doctor:doctor"),
    },
    "Run": {
        "eval": _Entry("evaluate:evaluate", True),
        "agent": _Entry("agent:agent", True),
        "check": _Entry("check:check", True),
        "sweep": _Entry("sweep:sweep", True),
        "merge": _Entry("sweep:merge", True),
    },
    "Look and compare": {
        "results": _Entry("results:results", True),
        "compare": _Entry("compare:compare", True),
        "cost": _Entry("cost:cost", True),
        "report": _Entry("report:report", True),
        "view": _Entry("view:view"),
    },
    "Publish": {
        "export": _Entry("export:export", True),
    },
    "Serve and set up": {
        "serve": _Entry("serve:app", of_group="Serve players and games to other programs."),
        "model": _Entry(
            "doctor:models_app",
            of_group="Download the models that --player local plays on this machine.",
        ),
    },
}
"""Every command by the group in which the help lists it, in the order in which they are listed."""

COMMANDS = {name: entry for commands in PANELS.values() for name, entry in commands.items()}


INTERRUPTED = 130
"""The exit code of a program that Ctrl-C has stopped."""


def program() -> str:
    """Return how this program is called: its name if a shell finds it by that, else the path by which it was called."""
    called = Path(sys.argv[0])
    if called.parts[-2:] == ("smartplay_tools", "__main__.py"):
        return f"{sys.executable} -m smartplay_tools"
    found = shutil.which(called.name)
    elsewhere = called.stem == "smartplay-tools" and (found is None or Path(found).resolve() != called.resolve())
    return sys.argv[0] if elsewhere else "smartplay-tools"


def _escaped(error: UnicodeError) -> tuple[str, int]:
    """Characters that an encoding does not have, as JSON writes them in ASCII: so printed JSON stays valid."""
    assert isinstance(error, UnicodeEncodeError)
    return json.dumps(error.object[error.start : error.end])[1:-1], error.end


codecs.register_error("smartplay_escape", _escaped)


class _LateCommands(Mapping[str, Any]):
    """The commands by name; each is imported when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        entry = COMMANDS[name]
        target = resolve(f"{__name__}.{entry.place}")
        if isinstance(target, typer.Typer):
            command: Any = get_group(target)
        else:
            alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
            alone.command(name, no_args_is_help=entry.needs_arguments)(target)
            command = get_command(alone)
        command.name = name
        for each in (command, *getattr(command, "commands", {}).values()):
            each.help = each.help and "\n\n".join(" ".join(part.split()) for part in each.help.split("\n\n"))
        command.help = command.help or entry.summary  # of a group; python -OO has no docstrings
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(TyperGroup):
    """The command line: imports the command that is called, and prints what a user did wrong as one sentence."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = _LateCommands()

    def main(self, *arguments: Any, **settings: Any) -> Any:
        """Run the command line; what no terminal should get, or cannot encode (Windows writes cp1252), is escaped."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="smartplay_escape")
        make_streams_visible()
        return super().main(*arguments, **settings)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in their order."""
        return list(COMMANDS)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help from the summaries, which imports none of the commands."""
        listed = copy.copy(self)
        listed.commands = {
            name: TyperCommand(name, help=entry.summary, rich_help_panel=panel)
            for panel, commands in PANELS.items()
            for name, entry in commands.items()
        }
        TyperGroup.format_help(listed, ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; a bug keeps its traceback. What is damaged and left out makes the exit code 1."""
        told: dict[str, type[Warning]] = {}

        def tell(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if not issubclass(category, SmartPlayWarning):
                usual(message, category, *where, **more)
            elif str(message) not in told:
                told[str(message)] = category
                say(f"smartplay-tools: {message}", err=True)

        try:
            if ("--out", "") in pairwise(ctx.args):  # it would be this folder
                raise InvalidArgumentError("--out is empty, as a variable is that is not set; name a file or a folder.")
            with warnings.catch_warnings():
                warnings.simplefilter("always", SmartPlayWarning)
                usual, warnings.showwarning = warnings.showwarning, tell
                result = super().invoke(ctx)
            if any(issubclass(category, DamageWarning) for category in told.values()):
                raise typer.Exit(1)
            return result
        except SmartPlayError as error:
            say(f"smartplay-tools: {error}", err=True)
            raise typer.Exit(2) from error
        except OSError as error:
            if error.errno not in (OF_FILES if error.filename else ANYWHERE):
                raise
            named = error.filename or "A file"
            remedy = "; raise the limit (ulimit -n), or use fewer --workers" if error.errno in TOO_MANY_OPEN else ""
            say(f"smartplay-tools: {named} cannot be read or written: {error.strerror}{remedy}.", err=True)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:  # outside of the code that handles it
            say("Stopped by SIGINT.", err=True)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"smartplay-tools {version('smartplay-tools')}")
        raise typer.Exit


@app.callback(no_args_is_help=True, cls=_Commands)
def main(
    of_package: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Play the SmartPlay benchmark's games through tool calls, under exact context budgets."""
