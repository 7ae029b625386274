"""The documented steps that add a strategy and a rule are complete: followed in a copy, they work in every place."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import smartplay_tools
from smartplay_tools.context import strategies
from smartplay_tools.episode import config

PACKAGE = Path(smartplay_tools.__file__).parent

LANDMARKS = '''
"""Landmarks: every n-th turn is pinned until the next one."""

from smartplay_tools.context.strategies.base import BudgetStrategy


class Landmarks(BudgetStrategy):
    """Pins the latest turn whose number is divisible."""

    name = "landmark"
    option_help = "Pin every N-th turn until the next one."

    def __init__(self, budget, counter, words):
        self._every = budget.landmark

    def pinned(self, turn):
        """Return the latest landmark."""
        return turn.number - turn.number % self._every
'''

PLAY_LANDMARKS = """
import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.tables import COLUMNS
from smartplay_tools.evaluation.runs.sweeps import AXES
from smartplay_tools.records import Record
from smartplay_tools.records.accounts import Accounts, shown_turns
from smartplay_tools.types import STRATEGIES

assert sp.Budget(landmark=7).describe() == "landmark 7"
assert sp.Budget().words()["landmark"] == "no landmarks"
assert "landmark" in STRATEGIES and "landmark" in AXES and "budget_landmark" in COLUMNS

pinned = set()
with sp.Episode(GAME, seed=1, budget=sp.Budget(prompt_tokens=700, landmark=7), transcript="landmark.jsonl") as episode:
    assert sp.play(episode, sp.get_player("rule")).deviations["landmark"] == {"paper": None, "played": 7}
for event in sp.read_transcript("landmark.jsonl"):
    pinned.add(event.get("pinned"))
    assert event.get("notes") is None
assert {7, 14, 21} <= pinned, pinned
assert sp.replay("landmark.jsonl").identical
record = Record.read("landmark.jsonl")
assert all(sent.sha256 == sent.recorded_sha256 for sent in record.sent_prompts())
assert any("pinned" in shown_turns(record, view) for view in record.views)
assert all(sum(Accounts(record).parts(view)) == view["tokens"] for view in record.views)

command("eval", "--games", GAME, "--players", "rule", "--trials", "1", "--prompt-tokens", "700", "--landmark", "7",
        "--executor", "inline", "--out", "run", "--quiet")
assert "landmark 7" in command("results", "run", "--all")
"""

PLAY_ECHO = """
import smartplay_tools as sp

with sp.Episode(GAME, seed=1, echo="on", transcript="echo.jsonl") as episode:
    assert episode.call("act", {"action": "1"}).text.startswith("You chose ")
    episode.close()
assert episode.result.deviations["echo"] == {"paper": "off", "played": "on"}
assert sp.replay("echo.jsonl").identical

asked = ["eval", "--games", GAME, "--players", "random", "--trials", "1", "--executor", "inline", "--quiet"]
command(*asked, "--echo", "on", "--out", "with")
shown = command("results", "with", "--all")
assert "echo on" in shown, shown
assert any("echo" in line for line in shown.partition("different from the paper")[2].splitlines()), shown
command("replay", "with")
"""

BEGIN = """
from typer.testing import CliRunner

from smartplay_tools.cli import app

GAME = "RockPaperScissorBasic-v0"


def command(*words):
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, done.output
    return done.output
"""


def copied(tmp_path: Path) -> Path:
    """A copy of the package, in a folder that comes first on Python's path."""
    shutil.copytree(PACKAGE, tmp_path / "smartplay_tools")  # with what is compiled
    return tmp_path / "smartplay_tools"


def add(path: Path, before: str, text: str) -> None:
    """Insert a text before the only place of another one."""
    whole = path.read_text(encoding="utf-8")
    assert whole.count(before) == 1, (path, before)
    path.write_text(whole.replace(before, text + before), encoding="utf-8")


def run(folder: Path, script: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + script], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_strategy_is_added_by_the_three_documented_steps(tmp_path):
    steps = [line for line in strategies.__doc__.splitlines() if line[:3] in ("1. ", "2. ", "3. ", "4. ")]
    assert len(steps) == 3
    package = copied(tmp_path)
    folder = package / "context" / "strategies"
    field = '    landmark: Annotated[Cap | None, Keeps(_number("landmark", "no landmarks"))] = None\n'
    add(package / "types" / "budget.py", "    strategy: Annotated[", field)
    (folder / "landmarks.py").write_text(LANDMARKS, encoding="utf-8")
    place = '"landmark": "smartplay_tools.context.strategies.landmarks:Landmarks",\n        '
    add(folder / "__init__.py", '"strategy": f"', place)
    run(tmp_path, PLAY_LANDMARKS)


@pytest.mark.slow
def test_a_rule_is_added_by_the_four_documented_steps(tmp_path):
    steps = [line for line in config.__doc__.splitlines() if line[:3] in ("1. ", "2. ", "3. ", "4. ", "5. ")]
    assert len(steps) == 4
    package = copied(tmp_path)
    add(package / "episode" / "config.py", "    carry: CarriedStore", '    echo: Literal["off", "on"] = "off"\n')
    session = package / "episode" / "game_session.py"
    add(
        session,
        "        self.game_seconds += time.perf_counter()",
        '        text = f"You chose {action}. {text}" if self.echoes else text\n',
    )
    add(session, "        self.observation = observation\n", '        self.echoes = config.echo == "on"\n')
    add(
        package / "cli" / "episode_options.py",
        '    "carry": (_option',
        '    "echo": (_option(str, "off or on."), "off"),\n',
    )
    add(package / "evaluation" / "runs" / "run_options.py", "    carry: CarriedStore", "    echo: str\n")
    run(tmp_path, PLAY_ECHO)
