"""The command line, as a test calls it."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from smartplay_tools.cli import app


def result_of(*words: object, columns: int = 80) -> Result:
    """Run a command; what it does not catch is raised."""
    result = CliRunner(env={"COLUMNS": str(columns)}).invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def run(*words: object) -> tuple[int, str, str]:
    """Return a command's exit code, its output and its errors."""
    result = result_of(*words)
    return result.exit_code, result.stdout, result.stderr


def shown_by(*words: object, columns: int = 80) -> str:
    """Run a command that has to succeed; return what it shows."""
    result = result_of(*words, columns=columns)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*words: object) -> str:
    """Run a command that has to be refused; return what it says."""
    result = result_of(*words)
    assert result.exit_code == 2, result.output
    return result.output
