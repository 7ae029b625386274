"""The same seed gives the same episode in another process, whatever order that process hashes strings in."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import smartplay_tools as sp

SCRIPT = """
import hashlib, json, sys
import smartplay_tools as sp
from smartplay_tools.transcript import comparable

spec = sp.GAMES[sys.argv[1]]
spec = sp.GameSpec(**{**vars(spec), "rollout": min(spec.rollout, 120)})
for player in ("random", "rule"):
    events = []
    with sp.Episode(spec, seed=5, budget=sp.Budget(prompt_tokens=4000, slack=0.3), transcript=events) as episode:
        result = sp.play(episode, sp.get_player(player, seed=5))
    digest = hashlib.sha256(json.dumps([comparable(events), result.model_dump()]).encode()).hexdigest()
    print(player, result.end_reason, result.steps, result.state_hash, digest)
"""


def run(game: str, hash_seed: str) -> list[str]:
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    command = [sys.executable, "-W", "error", "-c", SCRIPT, game]
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert shown.returncode == 0, shown.stderr
    return shown.stdout.splitlines()


@pytest.mark.parametrize("game", sp.GAMES)
def test_two_processes_agree_on_every_event(game):
    one, other = run(game, "1"), run(game, "2")
    assert len(one) == 2
    assert one == other
