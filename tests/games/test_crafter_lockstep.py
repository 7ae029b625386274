"""The fast engine beside PyPI `crafter`, step by step, and the text beside an independent description."""

from __future__ import annotations

import pytest

from tests.games.crafter_edits import EVERYTHING, POLICIES, Pair, live_long, meet_something_new, play


def test_they_agree() -> None:
    play([meet_something_new], 5, 100)


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
