"""The fast engine beside PyPI `crafter`, step by step, and the text beside an independent description."""

from __future__ import annotations

import pytest

from tests.games.crafter_edits import (
    EVERYTHING,
    POLICIES,
    Pair,
    Policy,
    craft_and_fight,
    live_long,
    meet_something_new,
    play,
    random_play,
    sleep_a_lot,
    walk_the_border,
)


@pytest.mark.parametrize(
    ("policy", "seed", "steps"),
    [
        (meet_something_new, 5, 100),
        *(
            pytest.param(policy, seed, 200, marks=pytest.mark.slow)
            for policy, seed in ((random_play, 1), (sleep_a_lot, 2), (walk_the_border, 3), (craft_and_fight, 4))
        ),
    ],
)
def test_they_agree(policy: Policy, seed: int, steps: int) -> None:
    play([policy], seed, steps)


@pytest.mark.slow
def test_the_comparison_meets_the_whole_game() -> None:
    assert EVERYTHING - play(POLICIES, 10, 250) == set()


@pytest.mark.slow
def test_they_agree_for_days() -> None:
    """A day has 300 steps."""
    play([live_long], 20, 2_000)


@pytest.mark.slow
def test_worlds_are_equal() -> None:
    for seed in range(1000, 1007):
        Pair(seed, episode=seed % 7 + 1).compare_everything()
