"""The contract of all games. A setting is tested as soon as it is listed in GAMES.

The promises are those of `smartplay_tools.testing`, which everybody who adds a game runs, too.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.errors import ResetNeededError
from smartplay_tools.games.base import TextGame
from smartplay_tools.testing import CHECKS, random_walk
from smartplay_tools.testing.game_checks import (
    gives_texts_numbers_and_json,
    is_played_and_replayed_through_its_tools,
    is_the_same_in_another_process,
    numbers_its_actions_as_its_manual_does,
    scores_within_its_bounds,
)

HANOI = sp.GAMES["Hanoi3Disk-v0"]
FIRST = {spec.family: name for name, spec in reversed(list(sp.GAMES.items()))}.values()
"""The first setting of each family."""
IN_THIS_PROCESS = [check for check in CHECKS if check is not is_the_same_in_another_process]
"""The checks that start no process."""


WHOLE_EPISODES = (is_played_and_replayed_through_its_tools, scores_within_its_bounds)
OF_A_GOAL = (scores_within_its_bounds, gives_texts_numbers_and_json, numbers_its_actions_as_its_manual_does)
"""What can differ between settings of Minecraft, which have one world and several goals."""


def is_repeated(name: str, check: Callable[[str], None]) -> bool:
    """Whether the first setting of the family shows it: another process, and a world of Minecraft, take long."""
    is_costly = check is is_the_same_in_another_process
    is_costly |= sp.GAMES[name].family == "minecraft" and check not in OF_A_GOAL
    return is_costly and name not in FIRST


def takes_long(name: str, check: Callable[[str], None]) -> bool:
    """Whether only the slow tests make a check: `make test` has one process, and one world of Minecraft."""
    if check is is_the_same_in_another_process:
        return name != "Hanoi3Disk-v0"
    return sp.GAMES[name].family == "minecraft" and (name not in FIRST or check in WHOLE_EPISODES)


@pytest.mark.parametrize(
    ("game", "check"),
    [
        pytest.param(name, check, marks=[pytest.mark.slow] * takes_long(name, check), id=f"{name}-{check.__name__}")
        for name in sp.GAMES
        for check in CHECKS
        if not is_repeated(name, check)
    ],
)
def test_it_keeps_the_contract(game, check):
    check(game)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in FIRST)) for name in sorted(sp.GAMES.benchmark)]
)
def test_gymnasium_keeps_its_specification_and_adds_render_modes(name):
    spec = gymnasium.spec(f"smartplay/{name}")
    assert EnvSpec.from_json(spec.to_json()) == spec
    environment = gymnasium.make(spec, render_mode="ansi_list")
    observations = [environment.reset(seed=1)[0], environment.step(0)[0]]
    assert environment.render() == observations


def plays_to_its_end(game: TextGame) -> bool:
    """Play a begun game, as well as it knows how or at random; return whether it has ended by itself."""
    rng = np.random.default_rng(1)
    for _ in range(2_000):
        best = game.optimal_action
        _, _, terminated, truncated = game.advance(int(rng.integers(len(game.actions))) if best is None else best)
        if terminated or truncated:
            return True
    return False


def test_which_games_have_no_end_of_their_own():
    families = {spec.family: spec for spec in sp.GAMES.values() if spec.family != "minecraft"}
    endless = set()
    for family, spec in families.items():
        game = spec.make()
        game.reset(seed=5)
        if not plays_to_its_end(game):
            endless.add(family)
    assert endless == {"bandit", "rock_paper_scissors"}


# What `TextGame` does for every game.


@pytest.fixture
def hanoi() -> TextGame:
    return HANOI.make(history=2)


def test_its_info_has_the_fields_of_the_original_and_its_history_the_past_observations(hanoi):
    first, info = hanoi.reset(seed=1)
    expected = {"obs": first, "manual": hanoi.manual, "history": "", "score": 0, "completed": 0}
    assert info == expected
    observations = [first, *(step[0] for step in random_walk(hanoi, 4))]
    assert list(hanoi._info()) == list(expected)
    assert hanoi._info()["history"] == hanoi.recent() == (
        "Most recent 2 steps of the player's in-game observation:\n\n"
        f"Player Observation Step 2:\n{observations[2]}\n\nPlayer Observation Step 3:\n{observations[3]}"
    )  # fmt: skip
    assert hanoi.recent(0) == ""


def test_a_step_before_the_reset_and_one_after_the_end_are_refused_and_change_nothing(hanoi):
    for step in (hanoi.step, hanoi.advance):
        with pytest.raises(ResetNeededError, match=r"call reset\(\)"):
            step(0)
    hanoi.reset(seed=5)
    assert plays_to_its_end(hanoi)
    last = hanoi.state_hash(), hanoi.observation, hanoi.score, hanoi.recent()
    for step in (hanoi.step, hanoi.advance):
        with pytest.raises(ResetNeededError, match=r"call reset\(\)"):
            step(0)
    assert (hanoi.state_hash(), hanoi.observation, hanoi.score, hanoi.recent()) == last


@pytest.mark.parametrize(
    "action", [-1, 10**30, 6, "1", "Noop", True, np.True_, 1.5, np.float32(1), None, [0], b"0"], ids=repr
)
def test_what_is_no_action_is_refused_and_changes_nothing(hanoi, action):
    hanoi.reset(seed=5)
    before = hanoi.state_hash(), hanoi.recent()
    for step in (hanoi.step, hanoi.advance):
        with pytest.raises(sp.InvalidArgumentError, match="whole number from 0 to 5, not "):
            step(action)
    assert (hanoi.state_hash(), hanoi.recent()) == before


@pytest.mark.parametrize("game", FIRST)
def test_seeds_and_actions_may_be_numpy_s(game):
    made, played = sp.GAMES[game].make(), []
    for seed, action in [(6, 0), (np.uint64(6), np.uint8(0)), (np.int32(6), np.array(0))]:
        played.append((made.reset(seed=seed), made.step(action), made.state_hash()))
    assert played == [played[0]] * 3


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=5),
    st.lists(st.nothing()),
)


@settings(max_examples=settings().max_examples // 6, deadline=None)
@given(st.lists(ANYTHING | st.integers(0, 20), max_size=8), ANYTHING)
@pytest.mark.parametrize("family", {spec.family: name for name, spec in sp.GAMES.items()}.values())
def test_whatever_is_sent_is_played_or_refused_on_purpose(family, actions, seed):
    game = made(family)
    with contextlib.suppress(sp.SmartPlayError):
        game.reset(seed=seed)
    for action in actions:
        with contextlib.suppress(sp.SmartPlayError):
            observation, *_ = game.step(action)
            assert type(action) is int
            assert observation in game.observation_space


@functools.cache
def made(name: str) -> TextGame:
    return sp.GAMES[name].make()


def test_the_module_prefix_registers_on_its_own():
    assert isinstance(gymnasium.make("smartplay_tools:smartplay/Hanoi3Disk-v0").unwrapped, TextGame)
