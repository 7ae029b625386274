"""Crafter without text as a Gymnasium environment: spaces, infos, and the comparison with PyPI `crafter`."""

import copy
import pickle

import crafter
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smartplay_tools  # noqa: F401 - it registers the environments
from smartplay_tools.errors import InvalidArgumentError, ResetNeededError
from smartplay_tools.games.crafter import facts

ID = "smartplay/Crafter-v0"
SEEN = ("image", "semantic", "symbolic")


def random_actions(steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(17, size=steps)


@pytest.mark.parametrize("observation", SEEN)
def test_the_environment_checker_is_content(observation: str) -> None:
    check_env(gymnasium.make(ID, observation=observation, render_mode="rgb_array").unwrapped)
    environment = gymnasium.make(ID, observation=observation, render_mode="rgb_array_list")
    environment.reset()
    state, seed = environment.unwrapped.state(), environment.unwrapped.np_random_seed
    environment.reset(seed=seed)
    assert environment.unwrapped.state() == state
    environment.unwrapped.np_random = np.random.default_rng(1)
    environment.reset()
    drawn = environment.unwrapped.state()
    environment.reset(seed=int(np.random.default_rng(1).integers(2**31 - 1)))
    assert environment.unwrapped.state() == drawn
    environment.step(0)
    assert np.shape(environment.render()) == (2, 64, 64, 3)


@pytest.mark.parametrize("observation", SEEN)
def test_the_checker_of_stable_baselines3_is_content(observation: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(ID, observation=observation, render_mode="rgb_array"))


def test_the_picture_the_rewards_and_the_infos_are_the_packages() -> None:
    theirs, ours = crafter.Env(seed=4), gymnasium.make(ID, observation="image", opening_noop=False)
    picture, _ = ours.reset(seed=4)
    assert np.array_equal(picture, theirs.reset())
    assert ours.observation_space.shape == theirs.observation_space.shape
    # Its chunks are sets, so its creatures differ as soon as one disappears; the comparison stops before that.
    for action in random_actions(9, seed=4).tolist():
        picture, reward, terminated, truncated, info = ours.step(action)
        seen, expected, over, facts = theirs.step(action)
        assert np.array_equal(picture, seen)
        assert (reward, terminated or truncated) == (expected, over)
        assert info.keys() == facts.keys()
        for key in ("inventory", "achievements", "discount", "reward"):
            assert info[key] == facts[key], key
        for key in ("semantic", "player_pos"):
            assert np.array_equal(info[key], facts[key]), key


@pytest.mark.parametrize("observation", SEEN)
def test_what_is_shown_changes_nothing_else(observation: str) -> None:
    game, env = gymnasium.make(ID), gymnasium.make(ID, observation=observation)
    game.reset(seed=6)
    env.reset(seed=6)
    for action in random_actions(100):
        _, reward, terminated, truncated, _ = game.step(action)
        assert env.step(action)[1:4] == (reward, terminated, truncated)
        if terminated:
            game.reset()
            env.reset()
    assert env.unwrapped.fingerprint() == game.unwrapped._world.fingerprint()


def test_the_ids_are_those_around_the_player() -> None:
    env = gymnasium.make(ID, observation="semantic")
    env.reset(seed=2)
    for action in random_actions(100):
        seen, *_, info = env.step(action)
        x, y = info["player_pos"]
        whole = np.pad(info["semantic"], 4)
        assert np.array_equal(seen[:63].reshape(9, 7), whole[x : x + 9, y + 1 : y + 8])
        assert seen[63:79].tolist() == list(info["inventory"].values())
        assert seen[31] == facts.PLAYER


def test_the_numbers_are_laid_out_as_in_craftax_classic() -> None:
    env, ids = gymnasium.make(ID, observation="symbolic"), gymnasium.make(ID, observation="semantic")
    env.reset(seed=2)
    ids.reset(seed=2)
    blocks = {"grass": 2, "water": 3, "stone": 4, "tree": 5, "path": 7, "sand": 13}
    mobs = {"zombie": 17, "cow": 18, "skeleton": 19, "arrow": 20}
    order = ("wood", "stone", "coal", "iron", "diamond", "sapling", *facts.ITEMS[6:], *facts.VITALS)
    for action in random_actions(150):
        numbers, *_, info = env.step(action)
        seen = ids.step(action)[0]
        cells = numbers[:1323].reshape(7, 9, 21)
        assert np.array_equal(cells[..., :17].sum(-1), np.ones((7, 9)))
        for (row, column), number in np.ndenumerate(seen[:63].reshape(9, 7).T):
            name = facts.NAMES[number]
            assert cells[row, column, blocks.get(name, 0)] == (name in blocks)
            assert cells[row, column, 17:].sum() == (name in mobs)
            assert name not in mobs or cells[row, column, mobs[name]] == 1
        assert np.allclose(numbers[1323:1339], [info["inventory"][name] / 10 for name in order], atol=1e-3)
        assert np.argmax(numbers[1339:1343]) == seen[79]
        assert numbers[1344] == seen[80]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"observation": "pixels"}, r"^observation must be one of .*, not 'pixels'\.$"),
        ({"engine": "compiled"}, r"^engine must be 'fast', not 'compiled': to train over .* steps, see docs/rl\.md\.$"),
        ({"render_mode": "ansi"}, r"^render_mode must be 'rgb_array' or None, not 'ansi'\.$"),
        ({"picture_size": 10}, r"^picture_size must be 64 or more, not 10\.$"),
    ],
)
def test_wrong_options_are_one_sentence(options: dict, sentence: str) -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(InvalidArgumentError, match=sentence):
            make(ID, **{"observation": "image", **options}).close()


SEEDS = [({"seed": wrong}, "seed must be a ") for wrong in (-1, True, 1.5, "abc")]
ACTIONS = [
    ({"action": wrong}, "An action of CrafterEnv is a whole number from 0 to 16, not ")
    for wrong in (-1, 17, True, 1.0, "noop", [1], np.array([1]))
]


@pytest.mark.parametrize(("given", "sentence"), [*SEEDS, *ACTIONS])
def test_what_is_no_seed_or_action_is_refused_and_changes_nothing(given: dict, sentence: str) -> None:
    env = gymnasium.make(ID, observation="semantic").unwrapped
    env.reset(seed=1)
    before = env.fingerprint()
    with pytest.raises(InvalidArgumentError, match=f"^{sentence}"):
        (env.reset if "seed" in given else env.step)(**given)
    assert env.fingerprint() == before


def test_no_step_before_the_reset_and_after_the_end() -> None:
    env = gymnasium.make(ID, observation="semantic").unwrapped
    with pytest.raises(ResetNeededError, match="before its reset"):
        env.step(0)
    env.reset(seed=30)
    # Players who sleep in the open die soon.
    while not env.step(facts.SLEEP)[2]:
        pass
    with pytest.raises(ResetNeededError, match="after its end"):
        env.step(0)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_identically(copied: object) -> None:
    env = gymnasium.make(ID, observation="image").unwrapped
    env.reset(seed=1)
    for action in random_actions(30):
        env.step(action)
    twin = copied(env)
    for action in random_actions(30, seed=1):
        for one, other in zip(env.step(action)[:4], twin.step(action)[:4], strict=True):
            assert np.array_equal(one, other)
    assert (twin.state(), twin.fingerprint()) == (env.state(), env.fingerprint())


@pytest.mark.parametrize("game", [ID, "smartplay/Hanoi3Disk-v0"])
def test_texts_are_not_shared_between_processes(game: str) -> None:
    with pytest.raises(InvalidArgumentError, match=r'vector_kwargs=\{"shared_memory": False\}'):
        gymnasium.make_vec(game, num_envs=2, vectorization_mode="async")
