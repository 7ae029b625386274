"""The package of `docs/add-a-game.md`: built from the page, installed, and played like any other game."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from pathlib import Path

import pytest

from smartplay_tools.testing import CHECKS
from tests.processes import printed_by

TESTS = Path(__file__).parents[1]
PAGE = TESTS.parent / "docs" / "add-a-game.md"


def blocks(language: str) -> list[str]:
    """The page's code of one kind."""
    fence = re.compile(rf"^```{language}\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
    return fence.findall(PAGE.read_text(encoding="utf-8"))


def commands(under: str) -> list[str]:
    """The commands of a section of the page."""
    _, section = PAGE.read_text(encoding="utf-8").split(f"\n## {under}\n")
    return [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("smartplay-tools ")]


COMMANDS = """
import json, sys
from typer.testing import CliRunner
from smartplay_tools.cli import app

results = [CliRunner().invoke(app, words) for words in json.load(sys.stdin)]
print(json.dumps([[result.exit_code, result.output] for result in results]))
"""


class Installed:
    """A folder with the page's package in it, for programs that find it there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        paths = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
        self._environment = {**os.environ, "PYTHONPATH": paths, "COLUMNS": "120"}

    def python(self, *arguments: str, given: str = "", cwd: Path | None = None) -> str:
        return printed_by(sys.executable, "-W", "error", *arguments, env=self._environment, cwd=cwd, input=given)

    def commands(self, *lines: str, cwd: Path | None = None) -> list[tuple[int, str]]:
        """The exit code and the output of each command, all run by one other process."""
        words = [shlex.split(line)[1:] for line in lines]
        results = json.loads(self.python("-c", COMMANDS, given=json.dumps(words), cwd=cwd))
        return [(code, output) for code, output in results]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    pytest.importorskip(
        "pip", reason="installs a package; an environment made by uv has pip after `uv pip install pip`"
    )
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("target")
    game = blocks("python")[0]
    player = blocks("python continued")[0]
    (project,) = blocks("toml")
    (source / "higher_or_lower.py").write_text(f"{game}\n\n{player}", encoding="utf-8")
    (source / "pyproject.toml").write_text(project, encoding="utf-8")
    options = ["--quiet", "--disable-pip-version-check", "--no-index", "--no-deps", "--no-build-isolation"]
    printed_by(sys.executable, "-m", "pip", "install", *options, "--target", target, source)
    return Installed(target)


def test_the_page_keeps_its_promise_of_a_short_game():
    game = blocks("python")[0]
    lines = [line for line in game.splitlines() if line.strip() and not line.startswith("# ---")]
    assert len(lines) <= 65


@pytest.mark.slow
def test_the_page_s_commands_work(installed, tmp_path):
    results = installed.commands(*commands(under="A package"), cwd=tmp_path)
    assert [code for code, _ in results] == [0, 0, 0, 0], results
    games, manual, play, replay = [output for _, output in results]
    assert "HigherOrLower-v0" in games
    assert "1. Guess 1" in manual
    assert "terminated" in play
    assert "identical" in replay


NO_PLUGINS = ("-p", "no:cacheprovider", "-p", "no:asyncio")
"""Of pytest: what this project's own tests use, and warns without its settings."""


@pytest.mark.slow
def test_it_keeps_the_contract_of_every_game(installed, tmp_path):
    (test,) = blocks("py")
    (tmp_path / "test_higher_or_lower.py").write_text(test, encoding="utf-8")
    shown = installed.python("-m", "pytest", "-q", *NO_PLUGINS, str(tmp_path), cwd=tmp_path)
    assert f"{len(CHECKS)} passed" in shown


@pytest.mark.slow
def test_it_is_evaluated_by_its_name_in_worker_processes(installed, tmp_path):
    results = installed.commands(*commands(under="Evaluate"), cwd=tmp_path)
    assert [code for code, _ in results] == [0, 0, 0, 0], results
    assert "binary-search" in results[1][1]
    assert "HigherOrLower-v0" in (tmp_path / "windows.html").read_text(encoding="utf-8")
    rows = (tmp_path / "runs" / "players" / "results.jsonl").read_text(encoding="utf-8").splitlines()
    assert [(row["player"], row["trial"]) for row in map(json.loads, rows)] == [
        (player, trial) for player in ("binary-search", "random") for trial in range(5)
    ]


@pytest.mark.slow
def test_its_results_are_like_those_of_any_game(installed):
    command = "smartplay-tools play HigherOrLower-v0 --player binary-search --seed 7 --json"
    (_, whole), (_, shorter) = installed.commands(command, f"{command} --history 0")
    result = json.loads(whole)
    assert (result["score"], result["completed"], result["end_reason"]) == (5, True, "terminated")
    assert result["normalized_score"] is None
    assert "history" not in result["deviations"]
    result = json.loads(shorter)
    assert result["score"] < 5
    assert result["deviations"]["history"] == {"paper": 20, "played": 0}


@pytest.mark.slow
def test_it_holds_what_every_game_promises(installed):
    contract = TESTS / "games" / "test_contract.py"
    shown = installed.python("-m", "pytest", "-q", "-p", "no:cacheprovider", str(contract), "-k", "HigherOrLower")
    passed = re.search(r"(\d+) passed", shown)
    assert passed is not None, shown
    assert int(passed[1]) > len(CHECKS), shown  # every promise, and what hypothesis sends
    assert "failed" not in shown
