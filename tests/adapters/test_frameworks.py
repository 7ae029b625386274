"""Agents of other people's frameworks, each in an environment of its own.

`.ci/frameworks.py` runs the programs of `examples/clients`, which say themselves what to install.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from pathlib import Path

import pytest

from tests.processes import printed_by

RUNNER = Path(__file__).parents[2] / ".ci" / "frameworks.py"

pytestmark = pytest.mark.skipif(not RUNNER.exists(), reason="the agents are run from a checkout")


@pytest.mark.slow
@pytest.mark.parametrize(
    "agent",
    [
        "play_smolagents.py",
        "play_openai.mjs",
        "play_vercel_ai.mjs",
    ],
)
def test_the_agent_of_the_page_wins_under_the_budget(agent, tmp_path):
    if agent.endswith(".mjs") and shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    command = [sys.executable, str(RUNNER), "--envs", str(tmp_path), agent]
    done = printed_by(*command)
    assert "score 3" in done


def test_every_program_says_what_it_installs_and_is_on_the_page():
    spec = importlib.util.spec_from_file_location("frameworks", RUNNER)
    frameworks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(frameworks)
    page = (RUNNER.parents[1] / "docs" / "clients.md").read_text(encoding="utf-8")
    listed = re.findall(r"\]\(\.\./examples/clients/([\w.]+)\)(?: \(([RM, O]+)\))?", page)
    assert sorted(name for name, _ in listed) == frameworks.agents()
    assert len(listed) > 40
    for agent, marks in listed:
        program = (frameworks.CLIENTS / agent).read_text(encoding="utf-8")
        install = frameworks.install_of(agent)
        assert "==" in install or "@" in install, "it names no version"
        assert ("SMARTPLAY_MCP_URL" in program) == (agent not in frameworks.TEXT_AGENTS)
        assert ("O" in marks) == (frameworks.ONLY_GAME_TOOLS in frameworks.beginning_of(agent)), agent
        if agent.endswith(".py"):
            compile(program, agent, "exec")
