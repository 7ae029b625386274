"""The scores of the MESSENGER rule player with the paper's budgets and others."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.games.messenger.rules import SPLITS, Split


def completed(level: int, episodes: int) -> float:
    won = 0
    for seed in range(episodes):
        with sp.Episode(f"MessengerL{level}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player("rule")).completed
    return won / episodes


@pytest.mark.parametrize(
    "split", [pytest.param(split, marks=() if split == "val" else pytest.mark.slow) for split in SPLITS]
)
def test_it_plays_the_games_of_every_split(split: Split) -> None:
    with sp.Episode("MessengerL2-v0", seed=0, split=split) as episode:
        assert sp.play(episode, sp.get_player("rule")).completed


@pytest.mark.parametrize("history", [0, 1, 20])
def test_it_plays_with_every_window(history: int) -> None:
    with sp.Episode("MessengerL2-v0", seed=1, budget=sp.Budget(history=history)) as episode:
        assert sp.play(episode, sp.get_player("rule")).completed


@pytest.mark.slow
@pytest.mark.parametrize(("level", "episodes", "at_least"), [(1, 20, 0.95), (2, 10, 0.8), (3, 5, 0.4)])
def test_it_plays_as_well_as_promised(level: int, episodes: int, at_least: float) -> None:
    """The bounds hold for 200 episodes of each level; level 3 takes nearly a second an episode."""
    assert completed(level, episodes) >= at_least
