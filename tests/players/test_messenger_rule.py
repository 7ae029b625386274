"""The decisions of the MESSENGER rule player, and its scores with the paper's budgets."""

from __future__ import annotations

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.games.messenger.rules import SPLITS, Split
from smartplay_tools.players.rules.messenger import player as messenger
from smartplay_tools.players.rules.messenger.belief import ENEMY, GOAL, MESSAGE, THINGS, Cases
from smartplay_tools.players.rules.messenger.board import CHASER, IMMOVABLE, NOWHERE
from smartplay_tools.players.rules.messenger.player import worths


def completed(level: int, episodes: int) -> float:
    won = 0
    for seed in range(episodes):
        with sp.Episode(f"MessengerL{level}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player("rule")).completed
    return won / episodes


# Decisions.


def cases_of(cell: tuple[int, int], **things: tuple[tuple[int, int], int]) -> Cases:
    """One situation, twenty times: our place, and the place in half cells and the movement of each thing."""
    spots, movements = np.full((len(THINGS), 20), NOWHERE), np.full((len(THINGS), 20), IMMOVABLE)
    for name, ((x, y), movement) in things.items():
        index = {"enemy": ENEMY, "message": MESSAGE, "goal": GOAL}[name]
        spots[index], movements[index] = 64 * x + y, movement
    nothing = np.zeros((len(THINGS), 20), dtype=bool)
    return Cases(np.full(20, 10 * cell[0] + cell[1]), spots, movements, np.zeros(20, dtype=int), nothing)


def best(cases: Cases, *, has_message: bool) -> str:
    return messenger.ACTIONS[int(worths(cases, has_message=has_message).argmax())]


def test_it_goes_for_the_message_and_then_for_the_goal() -> None:
    cases = cases_of((5, 5), message=((10, 4), IMMOVABLE), goal=((10, 16), IMMOVABLE))
    assert best(cases, has_message=False) == "Move North"
    assert best(cases, has_message=True) == "Move South"


def test_it_does_not_touch_the_goal_without_the_message() -> None:
    worth = worths(cases_of((5, 5), goal=((12, 10), IMMOVABLE), message=((16, 10), IMMOVABLE)), has_message=False)
    assert worth[messenger.ACTIONS.index("Move East")] == worth.min() < 0


def test_it_evades_a_chaser() -> None:
    cases = cases_of((5, 5), enemy=((13, 10), CHASER), message=((16, 10), IMMOVABLE), goal=((2, 2), IMMOVABLE))
    worth = worths(cases, has_message=False)
    assert worth[messenger.ACTIONS.index("Move East")] == worth.min() < 0 < worth.max()


# Scores.


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
