"""The command `serve openai` in a separate process, and `play` with its server."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

import smartplay_tools as sp
from tests.evaluation.command import refused, result_of
from tests.processes import heed_interrupts, needs_unix

pytestmark = pytest.mark.slow

pytest.importorskip("openai")


@contextmanager
def serving(*words):
    """A server with these options; its address is the first word that it prints, here with the line."""
    needs_unix()
    command = [sys.executable, "-m", "smartplay_tools", "serve", "openai", "--port", "0", *words]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "200"}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, preexec_fn=heed_interrupts)
    line = server.stdout.readline()
    yield line.split()[0], line
    server.send_signal(signal.SIGINT)
    rest, _ = server.communicate(timeout=20)
    assert rest.strip() == "stopped"
    assert server.returncode == 0


@pytest.fixture(scope="module")
def served():
    """The address of a server of the rule and random players."""
    with serving("--player", "rule", "--player", "random") as (address, _):
        yield address


def play(*words):
    result = result_of("play", "Hanoi3Disk-v0", "--json", *words)
    return result, (json.loads(result.stdout) if result.exit_code == 0 else None)


@pytest.mark.parametrize("player", ["openai:rule", "openai-responses:rule"])
def test_play_against_a_server(served, player, tmp_path):
    path = tmp_path / "run.jsonl"
    _, played = play("--player", player, "--base-url", served, "--transcript", str(path))
    assert (played["score"], played["tokens"]["provider"]["requests"]) == (3, played["turns"])
    assert sp.replay(path).identical


@pytest.mark.parametrize("player", ["openai:random", "openai-responses:random"])
def test_play_the_paper_s_protocol_against_a_server(served, player, tmp_path):
    path = tmp_path / "run.jsonl"
    _, played = play("--player", player, "--base-url", served, "--protocol", "paper", "--transcript", str(path))
    assert (played["steps"], played["turns"], played["fallback_actions"]) == (30, 60, 0)
    assert sp.read_transcript(path)[0]["config"]["protocol"] == "paper"
    assert sp.replay(path).identical


def test_what_cannot_be_is_one_sentence(served):
    result, _ = play("--player", "rule", "--base-url", served)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    result, _ = play("--player", "openai:rule", "--base-url", served, "--protocol", "free")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    port = served.split(":")[2].removesuffix("/v1")
    assert refused("serve", "openai", "--port", port) == (
        f"smartplay-tools: Nothing can listen on 127.0.0.1:{port}: Address already in use; "
        "name another --port, or 0 for a free one.\n"
    )


NAMED = """
class Named:
    def __init__(self, seed=0, action="1"):
        self.name, self.action = f"{__file__}:Named", action

    def reply(self, prompt):
        from smartplay_tools import Reply

        arguments = '{"action": "' + str(self.action) + '"}'
        call = {"id": "1", "type": "function", "function": {"name": "act", "arguments": arguments}}
        return Reply({"role": "assistant", "content": None, "tool_calls": [call]})
"""


def test_a_player_of_a_file_is_served_with_its_options_under_a_name(tmp_path):
    (tmp_path / "mine.py").write_text(NAMED, encoding="utf-8")
    options = ["--player", f"{tmp_path / 'mine.py'}:Named", "--player-option", "action=9", "--name", "mine"]
    with serving(*options) as (address, line):
        assert "answers as mine" in line
        _, played = play("--player", "openai:mine", "--base-url", address, "--tool-calls", "2")
    assert (played["tool_calls"], played["illegal_actions"]) == (2, 2), "the option came: there is no ninth action"


def test_one_name_is_not_for_two_players():
    said = refused("serve", "openai", "--player", "rule", "--player", "random", "--name", "a")
    assert "--name is for one player, and these are 2" in said
