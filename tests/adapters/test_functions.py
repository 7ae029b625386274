"""Plain functions: `Episode.functions()` in frameworks that take annotated callables.

Their pins clash with each other's and with ours, so the test of a framework that is not installed is skipped; the slow
test at the end installs those that install quickly in a separate environment, and runs this file there.
"""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp

# These frameworks raise warnings of their own while they are imported.
pytestmark = pytest.mark.filterwarnings("ignore")

ROOT = Path(__file__).parents[2]

ISOLATED = {
    "test_autogen": "autogen-core~=0.7.5",
    "test_llama_index": "llama-index-core~=0.14.25",
    "test_smolagents": "smolagents~=1.26",
}
"""What the slow test installs, and the test that must not be skipped then."""


@pytest.fixture
def episode():
    with sp.Episode("RockPaperScissorBasic-v0", seed=1, context="host") as episode:
        yield episode


def installed(module: str) -> Any:
    return pytest.importorskip(module, exc_type=ImportError)


def test_smolagents(episode):
    smolagents = installed("smolagents")
    observe, act, read_manual = (smolagents.tool(function) for function in episode.functions())
    assert act.inputs["action"]["type"] == "string"
    assert "Rock" in act.description
    assert act(action="Rock").startswith("You chose Rock")
    assert "You chose Rock" in observe()
    assert read_manual() == episode.game.manual
    assert episode.stats.tool_calls == 3


def test_llama_index(episode):
    tools = installed("llama_index.core.tools")
    observe, act, read_manual = (tools.FunctionTool.from_defaults(function) for function in episode.functions())
    assert act.metadata.get_parameters_dict()["required"] == ["action"]
    assert "Rock" in act.metadata.description
    assert act.call(action="Rock").content.startswith("You chose Rock")
    assert "You chose Rock" in observe.call().content
    assert read_manual.call().content == episode.game.manual
    assert episode.stats.tool_calls == 3


def test_autogen(episode):
    core, tools = installed("autogen_core"), installed("autogen_core.tools")
    functions = [tools.FunctionTool(function, description=function.__doc__) for function in episode.functions()]
    observe, act, read_manual = functions

    def run(tool: Any, **arguments: str) -> str:
        return asyncio.run(tool.run_json(arguments, core.CancellationToken()))

    assert act.schema["parameters"]["required"] == ["action"]
    assert "Rock" in act.description
    assert run(act, action="Rock").startswith("You chose Rock")
    assert "You chose Rock" in run(observe)
    assert run(read_manual) == episode.game.manual
    assert episode.stats.tool_calls == 3


def test_google_adk(episode):
    tools = installed("google.adk.tools")
    observe, act, read_manual = (tools.FunctionTool(function) for function in episode.functions())

    def run(tool: Any, **arguments: str) -> str:
        return asyncio.run(tool.run_async(args=arguments, tool_context=None))

    assert "Rock" in act.description
    assert run(act, action="Rock").startswith("You chose Rock")
    assert "You chose Rock" in run(observe)
    assert run(read_manual) == episode.game.manual
    assert episode.stats.tool_calls == 3


def test_dspy(episode):
    dspy = installed("dspy")
    observe, act, read_manual = (dspy.Tool(function) for function in episode.functions())
    assert act.args == {"action": {"type": "string"}}
    assert "Rock" in act.desc
    assert act(action="Rock").startswith("You chose Rock")
    assert "You chose Rock" in observe()
    assert read_manual() == episode.game.manual
    assert episode.stats.tool_calls == 3


@pytest.mark.slow
def test_in_an_environment_of_their_own(tmp_path):
    if not (ROOT / ".ci" / "install").exists():
        pytest.skip("not in a checkout")

    def run(*command: str | Path) -> str:
        done = subprocess.run([*map(str, command)], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    install = ["env", f"PYTHON={sys.executable}", ROOT / ".ci" / "install", tmp_path / "venv"]
    # Of our own dependencies, those that a game of Rock Paper Scissors needs.
    run(*install, *ISOLATED.values(), "gymnasium", "numpy", "pydantic", "tiktoken", "pytest")
    run(*install, "--no-deps", wheel)
    python = tmp_path / "venv" / "bin" / "python"
    shutil.copy(__file__, tmp_path)
    shown = run(python, "-m", "pytest", "-rA", "-m", "not slow", "-p", "no:cacheprovider", Path(__file__).name)
    for test in ISOLATED:
        assert f"PASSED {Path(__file__).name}::{test}" in shown
