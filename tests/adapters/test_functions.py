"""Plain functions: `Episode.functions()` in frameworks that take annotated callables.

Their pins clash with each other's and with ours, so the test of a framework that is not installed is skipped; the slow
test at the end installs those that install quickly in a separate environment, and runs this file there.
"""

from __future__ import annotations

import asyncio
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from tests.processes import printed_by

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


def assert_they_play(episode: sp.Episode, tools: list[Any], description: str, run: Callable[..., str]) -> None:
    """Play a step with a framework's tools, of which `run` calls one."""
    observe, act, read_manual = tools
    assert "Rock" in description
    assert run(act, action="Rock").startswith("You chose Rock")
    assert "You chose Rock" in run(observe)
    assert run(read_manual) == episode.game.manual
    assert episode.stats.tool_calls == 3


def test_smolagents(episode):
    tools = [installed("smolagents").tool(function) for function in episode.functions()]
    assert tools[1].inputs["action"]["type"] == "string"
    assert_they_play(episode, tools, tools[1].description, lambda tool, **arguments: tool(**arguments))


def test_llama_index(episode):
    kind = installed("llama_index.core.tools").FunctionTool
    tools = [kind.from_defaults(function) for function in episode.functions()]
    assert tools[1].metadata.get_parameters_dict()["required"] == ["action"]
    assert_they_play(
        episode, tools, tools[1].metadata.description, lambda tool, **arguments: tool.call(**arguments).content
    )


def test_autogen(episode):
    core, kind = installed("autogen_core"), installed("autogen_core.tools").FunctionTool
    tools = [kind(function, description=function.__doc__) for function in episode.functions()]

    def run(tool: Any, **arguments: str) -> str:
        return asyncio.run(tool.run_json(arguments, core.CancellationToken()))

    assert tools[1].schema["parameters"]["required"] == ["action"]
    assert_they_play(episode, tools, tools[1].description, run)


@pytest.mark.slow
def test_in_an_environment_of_their_own(tmp_path):
    if not (ROOT / ".ci" / "install").exists():
        pytest.skip("not in a checkout")

    def run(*command: str | Path) -> str:
        return printed_by(*command, cwd=tmp_path)

    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    printed_by(*build, cwd=ROOT)
    (wheel,) = tmp_path.glob("*.whl")
    install = ["env", f"PYTHON={sys.executable}", ROOT / ".ci" / "install", tmp_path / "venv"]
    # Of our own dependencies, those that a game of Rock Paper Scissors needs.
    run(*install, *ISOLATED.values(), "gymnasium", "numpy", "pydantic", "tiktoken", "pytest")
    run(*install, "--no-deps", wheel)
    python = tmp_path / "venv" / "bin" / "python"
    shutil.copy(__file__, tmp_path)
    (tmp_path / "tests").mkdir()
    shutil.copy(ROOT / "tests" / "processes.py", tmp_path / "tests")
    shown = run(python, "-m", "pytest", "-rA", "-m", "not slow", "-p", "no:cacheprovider", Path(__file__).name)
    for test in ISOLATED:
        assert f"PASSED {Path(__file__).name}::{test}" in shown
