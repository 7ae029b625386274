"""Crafter as a Gymnasium environment: the checker, resets without a seed, and vectors."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smartplay_tools  # noqa: F401 - it registers the environments
from smartplay_tools.errors import InvalidArgumentError

ID = "smartplay/Crafter-v0"


def test_the_environment_checker_is_content() -> None:
    check_env(gymnasium.make(ID, render_mode="rgb_array").unwrapped)
    environment = gymnasium.make(ID, render_mode="rgb_array_list")
    environment.reset()
    environment.step(0)
    assert np.shape(environment.render()) == (2, 64, 64, 3)


def test_a_reset_without_a_seed_has_the_seed_that_gymnasium_draws() -> None:
    env = gymnasium.make(ID).unwrapped
    env.reset()
    state, seed = env._state(), env.np_random_seed
    env.reset(seed=seed)
    assert env._state() == state
    env.np_random = np.random.default_rng(1)
    env.reset()
    drawn = env._state()
    env.reset(seed=int(np.random.default_rng(1).integers(2**31 - 1)))
    assert env._state() == drawn


def test_a_reset_without_a_seed_begins_the_next_episode_of_the_seed() -> None:
    env, again = (gymnasium.make(ID) for _ in range(2))
    first = env.reset(seed=7)[0]
    assert again.reset(seed=np.int64(7))[0] == first
    second = env.reset()[0]
    assert again.reset()[0] == second
    assert first != second
    assert env.reset(seed=7)[0] == first


@pytest.mark.parametrize("game", [ID, "smartplay/Hanoi3Disk-v0"])
def test_texts_are_not_shared_between_processes(game: str) -> None:
    with pytest.raises(InvalidArgumentError, match=r'vector_kwargs=\{"shared_memory": False\}'):
        gymnasium.make_vec(game, num_envs=2, vectorization_mode="async")
