"""Agents of other people's frameworks, each in an environment of its own.

`.ci/frameworks.py` takes what to install, and the agent, from the framework's section in `docs/`.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

RUNNER = Path(__file__).parents[2] / ".ci" / "frameworks.py"

pytestmark = pytest.mark.skipif(not RUNNER.exists(), reason="the agents are run from a checkout")


@pytest.mark.slow
@pytest.mark.parametrize(
    "agent",
    [
        "python-agents#smolagents",
        "javascript-agents#vercel-ai-sdk",
    ],
)
def test_the_agent_of_the_page_wins_under_the_budget(agent, tmp_path):
    if agent.startswith("javascript") and shutil.which("npm") is None:
        pytest.skip("npm is not installed")
    command = [sys.executable, str(RUNNER), "--envs", str(tmp_path), agent]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "score 3" in done.stdout


def test_every_section_says_what_it_installs_and_has_an_agent():
    spec = importlib.util.spec_from_file_location("frameworks", RUNNER)
    frameworks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(frameworks)
    agents = [agent for page in frameworks.PAGES for agent in frameworks.agents_of(page)]
    assert len(agents) > 40
    for agent in agents:
        install, kind, program = frameworks.blocks_of(agent)
        assert "==" in install or "@" in install, "it names no version"
        assert ("SMARTPLAY_MCP_URL" in program) == (agent not in frameworks.TEXT_AGENTS)
        if kind == "py":
            compile(program, agent, "exec")
