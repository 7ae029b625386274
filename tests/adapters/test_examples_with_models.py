"""The examples with a model's name in the environment, and a server that answers for the model.

The server is on this machine: the local endpoint for OpenAI's interface, a scripted server for Anthropic's.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from smartplay_gateway import LocalEndpoint

import smartplay_tools as sp
from tests.adapters.anthropic_stub import AnthropicStub
from tests.adapters.conformance import WAY, act, calling
from tests.processes import printed_by

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(example: str, folder: Path, **variables: str) -> str:
    keys = {name: value for name, value in os.environ.items() if not name.endswith(("_API_KEY", "_BASE_URL"))}
    environment = {**keys, "NO_PROXY": "127.0.0.1", **variables}
    command = [sys.executable, "-W", "error", str(EXAMPLES / f"{example}.py")]
    return printed_by(*command, cwd=folder, env=environment)


@pytest.fixture(scope="module")
def openai_server():
    with LocalEndpoint(sp.get_player("rule"), api_key="secret") as endpoint:
        yield {"OPENAI_BASE_URL": endpoint.base_url, "OPENAI_API_KEY": "secret"}


@pytest.mark.parametrize("example", ["02_openai_chat_completions", "03_openai_player", "04_openai_responses"])
def test_a_model_behind_openai_s_interface(example, openai_server, tmp_path):
    assert "3 disks moved in 7 steps (terminated)" in run(example, tmp_path, MODEL="rule", **openai_server)


def test_many_games_at_once(openai_server, tmp_path):
    shown = run("05_openai_many_games_at_once", tmp_path, MODEL="rule", **openai_server)
    assert shown.count("requests (") == 9
    assert shown.count("(player_error)") == 0


def test_a_model_of_the_agents_sdk(openai_server, tmp_path):
    shown = run("12_agents_sdk", tmp_path, SMARTPLAY_MODEL="rule", **openai_server)
    assert "3 disks moved in 7 steps (terminated)" in shown


@pytest.mark.parametrize("example", ["10_langchain_agent", "11_langgraph"])
def test_a_chat_model_of_langchain(example, openai_server, tmp_path):
    pytest.importorskip("langchain_openai")
    shown = run(example, tmp_path, SMARTPLAY_MODEL="openai:rule", **openai_server)
    assert "3 disks moved in 7 steps (terminated)" in shown


def test_a_chat_model_plays_through_mcp(openai_server, tmp_path):
    pytest.importorskip("langchain_openai")
    shown = run("14_mcp_client", tmp_path, SMARTPLAY_MODEL="openai:rule", **openai_server)
    assert "The game is over" in shown


def test_a_model_behind_anthropic_s_interface(tmp_path):
    with AnthropicStub([calling(act(move)) for move in WAY]) as stub:
        variables = {"ANTHROPIC_BASE_URL": stub.url, "ANTHROPIC_API_KEY": "k", "SMARTPLAY_MODEL": "m"}
        shown = run("13_anthropic", tmp_path, **variables)
    assert "3 disks moved in 7 steps (terminated)" in shown
    assert {body["model"] for body in stub.bodies} == {"m"}
