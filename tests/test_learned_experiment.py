"""The tables of models that play agree with the published rows, of which nothing has to be trained or played again."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import smartplay_tools as sp

ROOT = Path(__file__).parents[1]
EXPERIMENTS = ROOT / "experiments"

pytestmark = [
    pytest.mark.skipif(not EXPERIMENTS.exists(), reason="not in a checkout"),
    pytest.mark.usefixtures("beside_the_scripts"),
]


@pytest.fixture(scope="module")
def learned():
    return importlib.import_module("learned_tables")


@pytest.fixture(scope="module")
def played(learned):
    return learned.Played(EXPERIMENTS / "learned" / "episodes.csv")


@pytest.mark.slow
def test_every_cell_has_every_world_once(played):
    cells = importlib.import_module("learned_cells")
    assert set(played.rows) <= set(cells.cells())
    assert all([row["trial"] for row in rows] == list(range(cells.PUBLISHED.worlds)) for rows in played.rows.values())


def test_notes_of_three_digits_are_worth_more_than_dropping():
    """The teacher of the models that write notes: it takes them every turn, and counts beyond its window."""
    player = importlib.import_module("learned_teacher").DigitsPlayer
    budgets = [sp.Budget(prompt_tokens=700), sp.Budget(prompt_tokens=700, notes_tokens=60)]
    scores = []
    for budget in budgets:
        episodes = [sp.Episode("RockPaperScissorBasic-v0", seed=seed, budget=budget) for seed in range(3)]
        scores.append(sum(sp.play(episode, player(words=False)).score for episode in episodes))
        assert not any(episode.result.refused_notes for episode in episodes)
    assert scores[1] > scores[0]


@pytest.mark.parametrize(
    "record", sorted((EXPERIMENTS / "learned" / "records").glob("*.jsonl")), ids=lambda path: path.stem
)
def test_a_published_record_replays(record):
    assert sp.replay(record).identical
