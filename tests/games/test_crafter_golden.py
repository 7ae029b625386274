"""Transcripts recorded from the original benchmark: every text, score, reward and end comes out the same."""

import json
import lzma
from pathlib import Path

import pytest

from smartplay_tools.games.specs import GAMES
from tests.games.reference import ReferenceEngine

RECORDED = Path(__file__).parents[1] / "data" / "crafter.jsonl.xz"
ROWS = [json.loads(line) for line in lzma.decompress(RECORDED.read_bytes()).splitlines()]
SEEDS = sorted({row["seed"] for row in ROWS})


def replay(seed: int) -> None:
    game = GAMES["Crafter-v0"].make()
    first = True
    for row in (row for row in ROWS if row["seed"] == seed):
        if row["action"] == "reset":
            # After a death the original continues with the same environment, which is the next episode of the seed.
            observation, info = game.reset(seed=seed if first else None)
            reward, done, first = 0.0, False, False
        else:
            action = game.actions.index(row["action"])
            observation, reward, terminated, truncated, info = game.step(action)
            done = terminated or truncated
        assert (observation, info["score"], reward, done) == (row["obs"], row["score"], row["reward"], row["done"])


@pytest.mark.parametrize("seed", SEEDS)
def test_the_fast_engine_repeats_the_original(seed: int) -> None:
    replay(seed)


@pytest.mark.slow
def test_pypi_crafter_repeats_the_original(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a death. The engines are compared with each other in more episodes (`test_crafter_lockstep.py`)."""
    monkeypatch.setattr("smartplay_tools.games.crafter.game.FastEngine", ReferenceEngine)
    replay(12)
