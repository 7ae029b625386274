"""The command line, as a test calls it."""

from __future__ import annotations

from typer.testing import CliRunner

from smartplay_tools.cli import app


def run(*arguments: object) -> tuple[int, str, str]:
    """Return a command's exit code, its output and its errors."""
    done = CliRunner(env={"COLUMNS": "80"}).invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.stderr
