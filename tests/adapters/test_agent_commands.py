"""The commands by which other programs play: `serve window`, which waits for them, and `agent`, which starts them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import Result

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.games.seeds import trial_seed
from tests.evaluation.command import result_of
from tests.processes import heed_interrupts, needs_unix

pytest.importorskip("openai")

from tests.adapters import window_host
from tests.adapters.window_host import TOOLS, Elsewhere, HostAgent

pytestmark = pytest.mark.slow

GAME = "Hanoi3Disk-v0"
SEEDS = [trial_seed(0, GAME, trial) for trial in range(2)]
"""Those of `eval`."""


# --- serve window ------------------------------------------------------------------------------------------------


@contextmanager
def serving(offers: int, *options: str) -> Iterator[tuple[list[HostAgent], subprocess.Popen[str]]]:
    """Run the command; yield an agent for each episode that it offers, and the process."""
    command = [
        sys.executable,
        "-m",
        "smartplay_tools",
        "serve",
        "window",
        GAME,
        "--port",
        "0",
        "--episodes",
        "2",
        *options,
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heed_interrupts) as server:
        assert server.stdout is not None
        try:
            _, base_url, *_ = server.stdout.readline().split()
            lines = [server.stdout.readline().split() for _ in range(offers)]
            lines.sort(key=lambda line: int(line[line.index("seed") + 1]))  # they begin together, in any order
            yield [HostAgent(Elsewhere(base_url, line[1], line[3]), "") for line in lines], server
        finally:
            server.kill()


def printed(server: subprocess.Popen[str]) -> list[str]:
    """Stop the command as a user does, and return what it has printed."""
    server.send_signal(signal.SIGINT)
    return server.communicate(timeout=60)[0].splitlines()


WON = "score 3  terminated  7 steps  4,390 prompt and 255 reply tokens"


def test_an_endpoint_says_who_has_won_and_at_its_end_how_all_did():
    needs_unix()
    with serving(2, "--prompt-tokens", "700", "--seed", "7") as (agents, server):
        agents[0].play()
        lines = printed(server)
    assert lines == [f"{agents[0].model.removeprefix('smartplay/')}  {WON}", "1 of 2 episodes are over, mean score 3."]


def test_its_folder_is_a_run_that_the_same_command_continues_under_the_same_handles(tmp_path: Path):
    needs_unix()
    options = ("--prompt-tokens", "700", "--out", str(tmp_path / "run"))
    with serving(2, *options) as (agents, server):
        agents[0].play()
        agents[1].answer(agents[1].post())
        assert f"{agents[0].model.removeprefix('smartplay/')}  {WON}" in printed(server)
    folder = RunFolder(tmp_path / "run")
    assert [row["seed"] for row in folder.rows()] == SEEDS[:1]
    with serving(1, *options) as (again, server):
        assert [agent.model for agent in again] == [agents[1].model]
        again[0].messages = agents[1].messages
        again[0].play()
        while "All episodes are over" not in server.stdout.readline():
            pass
        assert again[0].post()["content"] == "The game is over."
        assert printed(server) == []
    assert [(row["seed"], row["score"], row["steps"]) for row in folder.rows()] == [(seed, 3.0, 7) for seed in SEEDS]
    assert all(sp.replay(folder.transcript(row["key"])).identical for row in folder.rows())


# --- agent -------------------------------------------------------------------------------------------------------


def agent(out: Path, *command: str, options: tuple[str, ...] = ()) -> Result:
    """Run the command with a program."""
    with_budget = ("agent", GAME, "--episodes", "2", "--prompt-tokens", "700", "--out", str(out), "--name", "mine")
    return result_of(*with_budget, *options, "--", *command)


PLAYS = (sys.executable, str(Path(window_host.__file__)))


def test_a_program_plays_a_run(tmp_path: Path):
    result = agent(tmp_path / "run", *PLAYS, options=("--at-once", "2"))
    assert result.exit_code == 0, result.output
    assert [f"2 of 2  seed {seed}  {WON}" in result.output for seed in SEEDS].count(True) == 1
    folder = RunFolder(tmp_path / "run")
    rows = folder.rows()
    assert [(row["seed"], row["score"], row["player"]) for row in rows] == [(seed, 3.0, "rule") for seed in SEEDS]
    assert rows[0]["player_options"] == {"agent": "mine"}
    assert all(sp.replay(folder.transcript(row["key"])).identical for row in folder.rows())


def test_the_episode_ends_with_its_program(tmp_path: Path):
    assert agent(tmp_path, *PLAYS, "3").exit_code == 0
    rows = RunFolder(tmp_path).rows()
    assert [(row["score"], row["end_reason"], row["detail"]) for row in rows] == [
        (1.0, "host", "The program has ended.")
    ] * 2


STAYS = """
import os, sys, time, urllib.request
headers = {"Content-Type": "application/json"}
request = urllib.request.Request(os.environ["OPENAI_BASE_URL"] + "/chat/completions", sys.argv[1].encode(), headers)
urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request).read()
time.sleep(600)
"""


def test_a_program_that_stays_is_ended_when_its_time_is_up(tmp_path: Path):
    body = json.dumps({"model": "MODEL", "messages": [{"role": "user", "content": "Play."}], "tools": TOOLS})
    program = (sys.executable, "-c", STAYS, body.replace("MODEL", "{model}"))
    assert agent(tmp_path, *program, options=("--timeout", "6", "--at-once", "2")).exit_code == 1  # nothing was played
    rows = RunFolder(tmp_path).rows()
    assert [(row["turns"], row["end_reason"], row["detail"]) for row in rows] == [
        (1, "host", "The program had 6 seconds.")
    ] * 2


def test_a_program_that_fails_leaves_no_result_and_is_started_again_by_the_same_command(tmp_path: Path):
    failed = agent(tmp_path, sys.executable, "-c", "import sys; sys.exit('There is no key.')")
    assert failed.exit_code == 1
    assert "AgentFailedError: The program has ended with status 1: There is no key." in failed.output
    assert agent(tmp_path, sys.executable, "-c", "").output.count("has not asked its model") >= 2
    assert RunFolder(tmp_path).rows() == []
    assert agent(tmp_path, *PLAYS).exit_code == 0
    assert [row["score"] for row in RunFolder(tmp_path).rows()] == [3.0, 3.0]


def test_a_command_can_name_the_places_itself(tmp_path: Path):
    agent(tmp_path, sys.executable, "-c", "import sys; print(*sys.argv[1:])", "{handle}", "--at={mcp_url}")
    handle, at = next((tmp_path / "output").iterdir()).read_text().split()
    assert at.startswith("--at=http://127.0.0.1:")
    assert at.endswith(f"/mcp/{handle}")
