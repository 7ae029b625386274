"""Output with a format belongs to the program alone: what foreign code prints goes to standard error."""

import json
import os
import subprocess
import sys

import pytest

from tests.evaluation.command import run as in_this_process

COMMAND = (sys.executable, "-c", "from smartplay_tools.cli import app; app()")

LOUD = """
import os, subprocess, sys
import smartplay_tools as sp

def shout():
    print("loud", end="", flush=True)
    if os.environ.get("DEEPLY"):
        os.write(1, b"loud")
        subprocess.run([sys.executable, "-c", "import sys; print('loud'); sys.stdin.read()"])
    assert not sys.stdin.read()

shout()

class Game(sp.TextGame):
    actions, manual = ("Go", "Stay"), "Go."
    def _reset(self):
        shout()
        self.n = 0
        return "Dark."
    def _step(self, action):
        shout()
        self.n += 1
        return "Dark.", 1, self.n == 2, False
    def _state(self):
        return self.n
    def close(self):
        shout()

class Player:
    name = "loud"
    def __init__(self, *, seed=0):
        shout()
    def reply(self, prompt):
        shout()
        return sp.Reply(sp.call("act", action="Go"))

SPEC = sp.GameSpec(id="Loud-v0", family="loud", entry_point=Game, history=1, rollout=3, trials=1)
"""

RUN = ("--games", "loud.py:SPEC", "--players", "loud.py:Player", "--out", "run")


@pytest.fixture
def loud(tmp_path, monkeypatch):
    (tmp_path / "loud.py").write_text(LOUD)
    monkeypatch.chdir(tmp_path)


def told(*arguments, given=b"", deeply="1"):
    """Give a command in a process of its own, whose game and player print in every way and read the input."""
    environment = {**os.environ, "DEEPLY": deeply}
    done = subprocess.run([*COMMAND, *arguments], input=given, capture_output=True, timeout=120, env=environment)
    assert b"loud" in done.stderr
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_server_on_standard_output_keeps_it_and_reads_every_line(loud):
    client = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "t", "version": "1"}}
    act = {"name": "act", "arguments": {"action": "Go"}}
    asked = [("initialize", client), ("tools/list", {}), *[("tools/call", act)] * 4]
    lines = [{"jsonrpc": "2.0", "id": n, "method": method, "params": given} for n, (method, given) in enumerate(asked)]
    shown = told("serve", "mcp", "loud.py:SPEC", given=b"".join(json.dumps(line).encode() + b"\n" for line in lines))
    assert [json.loads(line)["id"] for line in shown.splitlines()] == list(range(6))


@pytest.mark.parametrize(
    "command",
    [
        ("play", "loud.py:SPEC", "--player", "loud.py:Player", "--json"),
        ("eval", *RUN, "--workers", "2", "--trials", "2", "--json"),
        ("sweep", *RUN, "--history", "0", "--trials", "1", "--format", "json"),
    ],
    ids=lambda command: command[0],
)
def test_json_is_alone_on_standard_output(loud, command):
    assert json.loads(told(*command, given=b"nobody reads this\n" * 9))


def test_a_person_answers_on_the_programs_own_input(loud):
    result = json.loads(told("play", "loud.py:SPEC", "--player", "human", "--json", given=b"1\n1\n", deeply=""))
    assert (result["end_reason"], result["score"]) == ("terminated", 0)


def test_inside_of_this_process_the_callers_streams_are_put_back(loud):
    before = sys.stdin, sys.stdout
    code, shown, errors = in_this_process("play", "loud.py:SPEC", "--player", "loud.py:Player", "--json")
    assert (code, json.loads(shown)["steps"]) == (0, 2)
    assert errors.startswith("loud")
    assert in_this_process("play", "loud.py:SPEC", "--json", "--unknown")[0] == 2
    assert (sys.stdin, sys.stdout) == before
