"""Both of our engines beside PyPI `crafter`, step by step, and the text beside an independent description."""

from __future__ import annotations

import pytest

from smartplay_tools.games.crafter import facts
from tests.games.crafter_edits import (
    EVERYTHING,
    POLICIES,
    Compiled,
    Edited,
    Fast,
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
from tests.games.marks import COMPILED


@pytest.fixture(params=[Fast, pytest.param(Compiled, marks=COMPILED)], ids=["fast", "compiled"])
def engine(request: pytest.FixtureRequest) -> type[Edited]:
    if request.param is Compiled:
        pytest.importorskip("numba", reason="the compiled engine is the extra rl")
    return request.param


@pytest.mark.parametrize(
    ("policy", "seed"),
    [
        (craft_and_fight, 4),
        *(
            pytest.param(policy, seed, marks=pytest.mark.slow)
            for policy, seed in ((random_play, 1), (sleep_a_lot, 2), (walk_the_border, 3), (meet_something_new, 5))
        ),
    ],
)
def test_both_engines_agree(engine: type[Edited], policy: Policy, seed: int) -> None:
    play([engine], [policy], seed, 200)


@pytest.fixture(params=[pytest.param([Fast, Compiled], marks=COMPILED, id="both")])
def engines(request: pytest.FixtureRequest) -> list[type[Edited]]:
    """Both beside one run of the package, which takes most of the time."""
    pytest.importorskip("numba", reason="the compiled engine is the extra rl")
    return request.param


def test_the_comparison_meets_the_whole_game(engines: list[type[Edited]]) -> None:
    assert EVERYTHING - play(engines, POLICIES * 4, 10, 250) == set()


def test_both_engines_agree_to_the_last_step(engines: list[type[Edited]]) -> None:
    play(engines, [live_long], 20, facts.LENGTH)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1020))
def test_worlds_are_equal(engine: type[Edited], seed: int) -> None:
    Pair([engine], seed, episode=seed % 7 + 1).compare_everything()
