"""Crafter for reinforcement learning: spaces, infos, vectors, and the comparison with PyPI `crafter`."""

import copy
import pickle
import sys

import crafter
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import smartplay_tools  # noqa: F401 - it registers the environments
from smartplay_tools.errors import InvalidArgumentError, ResetNeededError
from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.worlds import SLOW
from tests.games.marks import COMPILED

ID = "smartplay/Crafter-v0"
SEEN = ("image", "semantic", "symbolic")
ENGINES = (pytest.param("compiled", marks=COMPILED), "fast")


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> str:
    if request.param == "compiled":
        pytest.importorskip("numba", reason="the compiled engine is the extra rl")
    return request.param


def actions(count: int, steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(17, size=(steps, count))


# --- One world --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("observation", SEEN)
def test_the_environment_checkers_are_content(engine: str, observation: str) -> None:
    env = gymnasium.make(ID, observation=observation, engine=engine, render_mode="rgb_array")
    check_env(env.unwrapped)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env)


def test_the_picture_the_rewards_and_the_infos_are_the_packages(engine: str) -> None:
    theirs, ours = crafter.Env(seed=4), gymnasium.make(ID, observation="image", engine=engine, opening_noop=False)
    picture, _ = ours.reset(seed=4)
    assert np.array_equal(picture, theirs.reset())
    assert ours.observation_space.shape == theirs.observation_space.shape
    rng = np.random.default_rng(4)
    # Its chunks are sets, so its creatures differ as soon as one disappears; the comparison stops before that.
    for _ in range(9):
        action = int(rng.integers(17))
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
def test_what_is_shown_changes_nothing_else(engine: str, observation: str) -> None:
    game, env = gymnasium.make(ID), gymnasium.make(ID, observation=observation, engine=engine)
    game.reset(seed=6)
    env.reset(seed=6)
    for action in actions(1, 300)[:, 0]:
        _, reward, terminated, truncated, _ = game.step(action)
        assert env.step(action)[1:4] == (reward, terminated, truncated)
        if terminated:
            game.reset()
            env.reset()
    assert env.unwrapped.fingerprint() == game.unwrapped._world.fingerprint()


def test_the_ids_are_those_around_the_player(engine: str) -> None:
    env = gymnasium.make(ID, observation="semantic", engine=engine)
    env.reset(seed=2)
    for action in actions(1, 100)[:, 0]:
        seen, *_, info = env.step(action)
        x, y = info["player_pos"]
        whole = np.pad(info["semantic"], 4)
        assert np.array_equal(seen[:63].reshape(9, 7), whole[x : x + 9, y + 1 : y + 8])
        assert seen[63:79].tolist() == list(info["inventory"].values())
        assert seen[31] == facts.PLAYER


def test_the_numbers_are_laid_out_as_in_craftax_classic(engine: str) -> None:
    env = gymnasium.make(ID, observation="symbolic", engine=engine)
    ids = gymnasium.make(ID, observation="semantic", engine=engine)
    env.reset(seed=2)
    ids.reset(seed=2)
    blocks = {"grass": 2, "water": 3, "stone": 4, "tree": 5, "path": 7, "sand": 13}
    mobs = {"zombie": 17, "cow": 18, "skeleton": 19, "arrow": 20}
    order = ("wood", "stone", "coal", "iron", "diamond", "sapling", *facts.ITEMS[6:], *facts.VITALS)
    for action in actions(1, 150)[:, 0]:
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


def test_wrong_options_are_one_sentence() -> None:
    with pytest.raises(InvalidArgumentError, match=r"^observation must be one of .*, not 'pixels'\.$"):
        gymnasium.make(ID, observation="pixels")
    with pytest.raises(InvalidArgumentError, match=r"^engine must be one of .*, not 'slow'\.$"):
        gymnasium.make(ID, observation="image", engine="slow")
    with pytest.raises(InvalidArgumentError, match=r"^observation must be one of"):
        gymnasium.make_vec(ID, num_envs=2, observation="pixels")
    vector = gymnasium.make_vec(ID, num_envs=2, observation="semantic", engine="fast")
    vector.reset(seed=0)
    with pytest.raises(InvalidArgumentError, match="from 0 to 16"):
        vector.step(np.array([0, 17]))
    with pytest.raises(InvalidArgumentError, match="2 integers"):
        vector.step(np.array([0]))


def test_without_numba_it_says_how_slow_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.warns(UserWarning, match="numba is not installed") as warned:
        vector = gymnasium.make_vec(ID, num_envs=2, observation="symbolic")
    assert str(warned[0].message) == SLOW
    assert vector.reset(seed=0)[0].shape == (2, 1345)


# --- Many worlds ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("observation", ["text", *(pytest.param(seen, marks=pytest.mark.slow) for seen in SEEN)])
def test_a_vector_is_single_worlds_side_by_side(engine: str, observation: str, mode: AutoresetMode) -> None:
    """Observations, rewards, ends and infos are those of Gymnasium's own vector of single worlds."""
    options = {} if observation == "text" else {"engine": engine}
    theirs = gymnasium.make_vec(
        ID,
        num_envs=3,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        observation=observation,
        **options,
    )
    ours = gymnasium.make_vec(
        ID, num_envs=3, observation=observation, engine=engine, autoreset_mode=mode, semantic=True
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.metadata["autoreset_mode"] == mode
    compare_vectors(theirs.reset(seed=30), ours.reset(seed=30), observation)
    ends = 0
    for step, row in enumerate(actions(3, 260, seed=3)):
        # Players who sleep in the open die soon.
        row = np.where(np.arange(3) == step % 5, row, facts.SLEEP)
        expected, actual = theirs.step(row), ours.step(row)
        compare_vectors((expected[0], expected[4]), (actual[0], actual[4]), observation)
        for one, other in zip(expected[1:4], actual[1:4], strict=True):
            assert np.array_equal(one, other)
        over = expected[2] | expected[3]
        ends += int(over.sum())
        if over.any() and mode == AutoresetMode.DISABLED:
            compare_vectors(
                theirs.reset(options={"reset_mask": over.copy()}),
                ours.reset(options={"reset_mask": over.copy()}),
                observation,
            )
    assert ends > 0


def compare_vectors(expected: tuple, actual: tuple, observation: str) -> None:
    if observation == "text":
        assert actual[0] == expected[0]
    else:
        assert np.array_equal(actual[0], expected[0])
        compare_infos(expected[1], actual[1])


def compare_infos(expected: dict, actual: dict) -> None:
    assert actual.keys() == expected.keys()
    for key, value in expected.items():
        if isinstance(value, dict):
            compare_infos(value, actual[key])
        elif key == "final_obs":
            for one, other in zip(value, actual[key], strict=True):
                assert (one is None) == (other is None)
                assert one is None or np.array_equal(one, other)
        else:
            mask = expected.get(f"_{key}", np.ones(len(value), np.bool_))
            assert np.array_equal(value[mask], actual[key][mask]), key


def test_each_world_has_its_seed(engine: str) -> None:
    vector = gymnasium.make_vec(ID, num_envs=3, observation="semantic", engine=engine)
    first = vector.reset(seed=[7, 8, 7])[0]
    assert np.array_equal(first[0], first[2])
    assert not np.array_equal(first[0], first[1])
    assert np.array_equal(vector.reset(seed=6)[0][1:], first[:2])
    again = vector.reset()[0]
    assert not np.array_equal(again[1], first[0])


def test_seeds_of_numpy_are_seeds(engine: str) -> None:
    vector = gymnasium.make_vec(ID, num_envs=3, observation="semantic", engine=engine)
    expected = vector.reset(seed=[5, 6, 7])[0]
    for seed in (5, np.int64(5), np.arange(5, 8), [np.int64(5), np.uint8(6), 7], (5, 6, 7)):
        assert np.array_equal(vector.reset(seed=seed)[0], expected)
    vector.reset()
    single = gymnasium.make(ID, observation="semantic", engine=engine).unwrapped
    assert np.array_equal(single.reset(seed=np.int64(5))[0], expected[0])


@pytest.mark.parametrize(
    "seed", [-1, True, 1.5, "abc", {1, 2, 3}, [-1, 2, 3], [1, True, 3], [1.5, 2, 3], ["a", "b", "c"], [1, 2]]
)
def test_what_is_not_a_seed_is_refused_and_changes_nothing(engine: str, seed: object) -> None:
    vector = gymnasium.make_vec(ID, num_envs=3, observation="semantic", engine=engine)
    vector.reset(seed=1)
    states = [vector.fingerprint(number) for number in range(3)]
    with pytest.raises(InvalidArgumentError, match=r"^seed must be a "):
        vector.reset(seed=seed)
    assert [vector.fingerprint(number) for number in range(3)] == states
    vector.reset()
    if not isinstance(seed, list):
        with pytest.raises(InvalidArgumentError, match=r"^seed must be a "):
            gymnasium.make(ID, observation="semantic", engine=engine).unwrapped.reset(seed=seed)


def test_nothing_before_the_reset(engine: str) -> None:
    vector = gymnasium.make_vec(ID, num_envs=2, observation="semantic", engine=engine, render_mode="rgb_array")
    for early in (lambda: vector.step(np.zeros(2, np.int64)), vector.render):
        with pytest.raises(ResetNeededError, match=r"Worlds \[0, 1\] have not begun: call reset\(\).$"):
            early()
    with pytest.raises(ResetNeededError, match=r"Worlds \[1\] have not begun: call reset\(\) without a reset_mask"):
        vector.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeededError, match="before its reset"):
        gymnasium.make(ID, observation="semantic", engine=engine).unwrapped.step(0)


def test_no_step_after_the_end(engine: str) -> None:
    vector = gymnasium.make_vec(
        ID, num_envs=1, observation="semantic", engine=engine, autoreset_mode=AutoresetMode.DISABLED
    )
    single = gymnasium.make(ID, observation="semantic", engine=engine).unwrapped
    vector.reset(seed=30)
    single.reset(seed=30)
    while not single.step(facts.SLEEP)[2]:
        vector.step(np.array([facts.SLEEP]))
    vector.step(np.array([facts.SLEEP]))
    with pytest.raises(ResetNeededError, match="after its end"):
        single.step(0)
    with pytest.raises(ResetNeededError, match=r"worlds \[0\] have ended"):
        vector.step(np.array([0]))


def test_without_any_seed_worlds_differ(engine: str) -> None:
    one, other = (gymnasium.make_vec(ID, num_envs=2, observation="symbolic", engine=engine) for _ in range(2))
    assert not np.array_equal(one.reset()[0], other.reset()[0])


def test_an_episode_is_cut_off(engine: str) -> None:
    vector = gymnasium.make_vec(ID, num_envs=2, observation="semantic", engine=engine, max_episode_steps=5)
    vector.reset(seed=0)
    ends = [vector.step(np.zeros(2, np.int64))[3].tolist() for _ in range(11)]
    assert [index for index, end in enumerate(ends) if end == [True, True]] == [4, 10]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda vector: pickle.loads(pickle.dumps(vector))])
def test_a_copy_continues_identically(engine: str, copied: object) -> None:
    vector = gymnasium.make_vec(ID, num_envs=3, observation="image", engine=engine, threads=2)
    vector.reset(seed=1)
    for row in actions(3, 30):
        vector.step(row)
    twin = copied(vector)
    for row in actions(3, 30, seed=1):
        for one, other in zip(vector.step(row)[:4], twin.step(row)[:4], strict=True):
            assert np.array_equal(one, other)
    assert [twin.fingerprint(n) for n in range(3)] == [vector.fingerprint(n) for n in range(3)]
    vector.close()


def test_returned_arrays_are_ones_own_unless_asked(engine: str) -> None:
    for own in (True, False):
        vector = gymnasium.make_vec(ID, num_envs=2, observation="symbolic", engine=engine, copy=own)
        first = vector.reset(seed=1)[0]
        kept = first.copy()
        for row in actions(2, 5):
            vector.step(row)
        assert np.array_equal(first, kept) == own


def test_pictures_of_all_worlds() -> None:
    vector = gymnasium.make_vec(ID, num_envs=2, observation="symbolic", engine="fast", render_mode="rgb_array")
    images = gymnasium.make_vec(ID, num_envs=2, observation="image", engine="fast")
    vector.reset(seed=1)
    assert np.array_equal(np.stack(vector.render()), images.reset(seed=1)[0])


@pytest.mark.parametrize("game", [ID, "smartplay/Hanoi3Disk-v0"])
def test_texts_are_not_shared_between_processes(game: str) -> None:
    with pytest.raises(InvalidArgumentError, match=r'vector_kwargs=\{"shared_memory": False\}'):
        gymnasium.make_vec(game, num_envs=2, vectorization_mode="async")
