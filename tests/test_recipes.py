"""The recipes of docs/architecture.md are complete: followed to the letter in a copy, they work in every place."""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

import pytest

import smartplay_tools
from smartplay_tools.context import strategies
from smartplay_tools.episode import config
from tests.processes import printed_by

PACKAGE = Path(smartplay_tools.__file__).parent
ROOT = Path(__file__).parents[1]
IN_A_CHECKOUT = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="not in a checkout")

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
assert [*map(sum, Accounts(record).prompts())] == [view["tokens"] for view in record.views]

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

COIN = '''
"""Coin: guess the side of a coin."""

import smartplay_tools as sp
from smartplay_tools.games import with_action_list

ACTIONS = ("Heads", "Tails")


class Coin(sp.TextGame):
    actions = ACTIONS
    manual = with_action_list("A coin is thrown at every step. Guess its side.", ACTIONS)

    def __init__(self, **options):
        super().__init__(longest_observation=60, characters="It was not thrown yet. HeadsTails", **options)

    def _reset(self):
        return "It was not thrown yet."

    def _step(self, action):
        side = int(self.np_random.integers(2))
        self.score += action == side
        return f"It was {ACTIONS[side]}.", float(action == side), False, False

    def _state(self):
        return self.score


SPEC = sp.GameSpec(
    id="Coin-v0", family="coin", entry_point=Coin, history=5, rollout=8, trials=2, score_bounds=(0, 8), worst_step=0
)
'''

PLAY_COIN = """
from smartplay_tools.testing import check_game

check_game("coin.py:SPEC")
command("play", "coin.py:SPEC", "--player", "random", "--quiet", "--transcript", "coin.jsonl")
command("replay", "coin.jsonl", "--game", "coin.py:SPEC")
command("eval", "--games", "coin.py:SPEC", "--players", "random", "--executor", "inline", "--out", "run", "--quiet")
"""

TOY = '''
"""Toy: a framework whose agent is a function from messages to a message."""

from smartplay_tools import AgentSession, Reply, schema

__all__ = ["run"]


def run(agent, episode):
    """Play an episode with an agent."""
    session = AgentSession(episode, player="toy", summaries=True)

    def send(prompt):
        return Reply(agent(prompt.messages, [schema(tool, "openai") for tool in prompt.tools]))

    while (reply := session.ask(send)) is not None:
        for call in session.receive(reply):
            session.answer(call.id)
    return session.result
'''

PLAY_TOY = """
import sys

sys.path.insert(0, "adapters")
import smartplay_toy
import smartplay_tools as sp

with sp.Episode(GAME, seed=1, budget=sp.Budget(prompt_tokens=700), transcript="toy.jsonl") as episode:
    assert smartplay_toy.run(lambda messages, tools: sp.call("act", action="Rock"), episode).steps == 50
assert sp.replay("toy.jsonl").identical
"""

PLAY_COLUMN = """
command("eval", "--games", GAME, "--players", "rule", "--trials", "1", "--prompt-tokens", "500", "--executor", "inline",
        "--out", "run", "--quiet")
shown = command("results", "run", "--all", "--explain")
assert "lim." in shown and "limited: prompts" in shown, shown
"""

PLAY_CHANGED = """
import runpy
from itertools import product

from tests.dialects.page import PAGES
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import SHORT
from tests.dialects.test_dialects import check, game
from tests.dialects.ways import WAYS

for name, stream in product(("Gemini", "Kimi", "Mistral", "Ollama"), (False, True)):
    try:
        check(*game(WAYS["openai:"], DIALECTS[name], SHORT, stream))
    except AssertionError:
        print(name)
runpy.run_module("tests.dialects.page", run_name="__main__")
rows = [line for page in PAGES for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
for named in ("`thought_text` | Gemini", "`max_output_tokens` (Kimi)", "Mistral, Ollama, OpenAI |"):
    print(*(named for line in rows if named in line))
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


def run(folder: Path, script: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
    return printed_by(sys.executable, "-c", BEGIN + script, cwd=folder, env=environment)


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
        "            self.game_seconds += time.perf_counter()",
        '            text = f"You chose {action}. {text}" if self.echoes else text\n',
    )
    add(session, "        self.observation = observation\n", '        self.echoes = config.echo == "on"\n')
    add(
        package / "cli" / "episode_options.py",
        '    "carry": (_option',
        '    "echo": (_option(str, "off or on."), "off"),\n',
    )
    add(package / "evaluation" / "runs" / "run_options.py", "    carry: CarriedStore", "    echo: str\n")
    run(tmp_path, PLAY_ECHO)


def steps_of(recipe: str) -> int:
    """The number of steps that a recipe of the page has."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    _, _, section = page.partition(f"### {recipe}\n")
    return len(re.findall(r"^\d\. ", section.partition("\n### ")[0], flags=re.MULTILINE))


@IN_A_CHECKOUT
def test_the_page_has_the_steps_that_are_followed():
    recipes = {"Add a game": 2, "Add a strategy": 3, "Add a rule": 4, "Add an adapter": 4, "Add a column": 3}
    assert {recipe: steps_of(recipe) for recipe in recipes} == recipes


@pytest.mark.slow
def test_a_game_is_added_by_the_documented_steps(tmp_path):
    (tmp_path / "coin.py").write_text(COIN, encoding="utf-8")
    run(tmp_path, PLAY_COIN)


@pytest.mark.slow
@IN_A_CHECKOUT
def test_an_adapter_is_added_by_the_documented_steps(tmp_path):
    copied(tmp_path)
    for name in ("adapters", "docs", "examples", "tests", ".ci"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("_build", "data"))
    for name in ("README.md", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    folder = tmp_path / "adapters" / "smartplay_toy"
    folder.mkdir()
    (folder / "__init__.py").write_text(TOY, encoding="utf-8")
    (folder / "py.typed").touch()
    add(tmp_path / "pyproject.toml", 'trl = ["trl', "toy = []\n")
    add(tmp_path / "pyproject.toml", '    "adapters/smartplay_trl",', '    "adapters/smartplay_toy",\n')
    with (tmp_path / "tests" / "asks_a_model.toml").open("a", encoding="utf-8") as places:
        places.write('[[place]]\nmodule = "smartplay_toy"\nfunctions = ["run"]\nat_most = "the budget"\n')
    run(tmp_path, PLAY_TOY)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "tests/test_architecture.py", "-k", "adapter or asks"]
    printed_by(*command, cwd=tmp_path)


@pytest.mark.slow
def test_a_column_is_added_by_the_documented_steps(tmp_path):
    folder = copied(tmp_path) / "evaluation" / "analysis"
    add(folder / "summary.py", '    "cut_results",\n)', '    "limited_prompts",\n')
    add(folder / "details.py", '    ("idle", _count("idle_replies")),', '    ("lim.", _count("limited_prompts")),\n')
    add(folder / "terms.toml", '"malf." =', '"lim." = "limited: prompts that left something out"\n')
    run(tmp_path, PLAY_COLUMN)


@pytest.mark.slow
@IN_A_CHECKOUT
def test_a_provider_has_changed_a_field(tmp_path):
    """Each change is a row of its file: the tests' server, which is changed first, refuses the games until then."""
    pytest.importorskip("openai")
    copied(tmp_path)
    for name in ("docs", "tests"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("_build", "*_layout"))
    page = (ROOT / "docs" / "servers.md").read_text(encoding="utf-8").partition("## A provider has changed a field")[2]
    steps = re.findall(r"^```toml\n# (\S+)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert len({file for file, _ in steps}) == 4
    shown = []
    for is_server in (True, False):
        for file, text in (step for step in steps if step[0].startswith("tests/") == is_server):
            whole = (tmp_path / file).read_text(encoding="utf-8")
            first, rest = whole.split("\n", 1)
            changed = f"{whole}\n{text}" if text.startswith("[") else f"{first}\n{text}{rest}"
            (tmp_path / file).write_text(changed, encoding="utf-8")
        shown.append(run(tmp_path, PLAY_CHANGED).split())
    assert shown[0] == ["Gemini", "Gemini", "Kimi", "Kimi", "Ollama", "Ollama"], "Mistral has not changed"
    assert " ".join(shown[1]) == "`thought_text` | Gemini `max_output_tokens` (Kimi) Mistral, Ollama, OpenAI |"
