"""The compiled engine is equal to the Python engine, and so to PyPI `crafter`, bit for bit."""

import copy
import pickle

import numpy as np
import pytest

pytest.importorskip("numba", reason="the compiled engine is the extra rl")

from crafter import constants, engine

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.compiled.worlds import CompiledWorlds
from smartplay_tools.games.crafter.fast import FastEngine
from smartplay_tools.games.crafter.reference import ReferenceEngine
from tests.games.crafter_worlds import POLICIES, Policy, canonical, compare, doing, lockstep, random_play
from tests.games.marks import COMPILED

pytestmark = COMPILED

ONE = np.zeros(1, np.intp)


@pytest.mark.parametrize("policy", POLICIES, ids=lambda policy: policy.__name__)
def test_both_engines_agree(policy: Policy) -> None:
    lockstep(policy, count=8, steps=320, seed=1, pictures=True)


@pytest.mark.parametrize("policy", POLICIES, ids=lambda policy: policy.__name__)
def test_both_engines_agree_for_long(policy: Policy) -> None:
    lockstep(policy, count=50, steps=500, seed=2, pictures=True)


def test_it_plays_as_the_package_does() -> None:
    """By day and by night: rewards, states, random streams and every picture."""
    compiled, package = CompiledWorlds(1), ReferenceEngine(5, 1)
    compiled.begin(ONE, [5], [1])
    rng, picture = np.random.default_rng(0), np.zeros((1, 64, 64, 3), np.uint8)
    nights = 0
    for step in range(230):
        compiled.observe("image", ONE, picture)
        assert np.array_equal(picture[0], package.picture)
        # Kept alive, so that night comes.
        package.env._player.inventory.update(health=9)
        compiled._records["inventory"][0, 0] = 9
        action = facts.SLEEP if 150 < step < 180 else rng.integers(17)
        compiled.step(ONE, np.array([action]))
        assert compiled.rewards[0] == package.step(action)
        nights += package.env._world.daylight < 0.5
        assert canonical(compiled.state(0)) == canonical(package.state())
        assert compiled.fingerprint(0) == package.fingerprint()
    assert nights > 20


def test_a_copy_and_a_pickle_go_on_alike() -> None:
    worlds, every = CompiledWorlds(3), np.arange(3)
    worlds.begin(every, [1, 2, 3], [1, 1, 1])
    rng = np.random.default_rng(1)
    for _ in range(40):
        worlds.step(every, rng.integers(17, size=3))
    twins = [copy.deepcopy(worlds), pickle.loads(pickle.dumps(worlds))]
    actions = rng.integers(17, size=(40, 3))
    for some in (worlds, *twins):
        for row in actions:
            some.step(every, row)
    for twin in twins:
        for number in range(3):
            compare(worlds, twin, number)


def test_threads_change_nothing() -> None:
    one, several = CompiledWorlds(9), CompiledWorlds(9, threads=3)
    every, rng = np.arange(9), np.random.default_rng(2)
    for worlds in (one, several):
        worlds.begin(every, list(range(9)), [1] * 9)
    for _ in range(60):
        actions = rng.integers(17, size=9)
        one.step(every, actions)
        several.step(every, actions)
        assert np.array_equal(one.rewards, several.rewards)
    several.close()
    for number in range(9):
        compare(one, several, number)


def test_worlds_that_do_not_take_part_stay_as_they_are() -> None:
    worlds = CompiledWorlds(4)
    worlds.begin(np.arange(4), [1, 2, 3, 4], [1] * 4)
    before = [canonical(worlds.state(number)) for number in range(4)]
    worlds.step(np.array([1, 3]), np.full(4, 2))
    worlds.begin(np.array([3]), [9], [1])
    after = [canonical(worlds.state(number)) for number in range(4)]
    assert [one == other for one, other in zip(before, after, strict=True)] == [True, False, True, False]


def test_there_is_room_for_every_thing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Worlds begin with room for few things, and get more when necessary."""
    monkeypatch.setattr("smartplay_tools.games.crafter.compiled.worlds._ROOM", 8)
    lockstep(doing, count=4, steps=60, seed=3, every=5)


def test_steps_beyond_the_usual_length_have_light_too(monkeypatch: pytest.MonkeyPatch) -> None:
    from smartplay_tools.games.crafter.compiled import layout

    monkeypatch.setattr(layout, "LENGTH", 30)
    monkeypatch.setattr("smartplay_tools.games.crafter.compiled.worlds.LENGTH", 30)
    layout.light_table.cache_clear()
    try:
        lockstep(random_play, count=2, steps=100, seed=4)
    finally:
        layout.light_table.cache_clear()


# --- Pictures ---------------------------------------------------------------------------------------------------------


class Stage:
    """The parts of a PyPI `crafter` world that its view uses, with the engine's own noise."""

    area = (facts.AREA, facts.AREA)

    def __init__(self, package: ReferenceEngine) -> None:
        self.world = package.env._world
        self.objects = self.world.objects
        self.daylight = self.world.daylight
        self.random = np.random.RandomState()

    def __getitem__(self, at: object) -> object:
        return self.world[at]


@pytest.mark.parametrize("size", [65, 128, 576])
def test_larger_pictures_are_the_packages_too(size: int) -> None:
    from smartplay_tools.games.crafter.pictures import draw

    package = ReferenceEngine(3, 1)
    for step in range(60):
        package.step([0, 1, 5, 3][step % 4])
    unit = np.array([size // 9] * 2)
    textures = engine.Textures(constants.root / "assets")
    view = engine.LocalView(Stage(package), textures, [9, 7])(package.env._player, unit)
    carried = engine.ItemView(textures, [9, 2])(package.env._player.inventory, unit)
    drawn = draw(package.scene(), size)
    border = (size - size // 9 * 9) // 2
    expected = np.concatenate([view, carried], 1).astype(np.uint8).transpose(1, 0, 2)
    assert np.array_equal(drawn[border : border + len(expected), border : border + len(expected)], expected)


def test_a_plain_engine_and_a_scene_show_the_same_picture() -> None:
    from smartplay_tools.games.crafter.pictures import draw

    worlds, fast = CompiledWorlds(1), FastEngine(8, 1, keep_grain=True)
    worlds.begin(ONE, [8], [1])
    for step in range(200):
        action = [6, 0, 5][step % 3]
        worlds.step(ONE, np.array([action]))
        fast.step(action)
    assert np.array_equal(draw(worlds.scene(0)), draw(fast.scene()))
