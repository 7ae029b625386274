"""The same seed gives the same episode in another process, whatever order that process hashes strings in."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import smartplay_tools as sp

SCRIPT = """
import dataclasses, hashlib, json
import smartplay_tools as sp
from smartplay_tools.records.replays import comparable

for spec in sp.GAMES.values():
    spec = dataclasses.replace(spec, rollout=min(spec.rollout, 20))
    for player in ("random", "reader" if spec.id.startswith("Lockers") else "rule"):
        events = []
        with sp.Episode(spec, seed=5, budget=sp.Budget(prompt_tokens=4000, slack=0.3), transcript=events) as episode:
            result = sp.play(episode, sp.get_player(player, seed=5))
        digest = hashlib.sha256(json.dumps([comparable(events), result.model_dump()]).encode()).hexdigest()
        print(spec.id, player, result.end_reason, result.steps, result.state_hash, digest)
"""


def start(hash_seed: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_two_processes_agree_on_every_event_of_every_game():
    processes = [start("1"), start("2")]
    outputs = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0, 0], outputs
    (one, _), (other, _) = outputs
    assert len(one.splitlines()) == 2 * len(sp.GAMES)
    assert one == other
    assert "error" not in one
