"""Crafter as an environment: seeding, copies, state hashes, borders, ends and pictures."""

import hashlib

import gymnasium
import numpy as np
import pytest
from crafter import constants, engine

from smartplay_tools.games.crafter import facts
from smartplay_tools.games.crafter.game import Crafter
from smartplay_tools.games.crafter.pictures import draw
from smartplay_tools.games.crafter.stream import world_seed
from smartplay_tools.games.crafter.world import DIRECTIONS, Thing, place
from smartplay_tools.games.specs import GAMES
from tests.games.reference import ReferenceEngine


def make(**options: object) -> Crafter:
    return GAMES["Crafter-v0"].make(**options)


def started(seed: int, **options: object) -> Crafter:
    game = make(**options)
    game.reset(seed=seed)
    return game


# --- Rules as data ---------------------------------------------------------------------------------------------------


def test_the_tables_are_those_of_the_package() -> None:
    assert list(facts.ACTIONS) == constants.actions
    assert list(facts.MATERIALS) == constants.materials
    assert [facts.NAMES[material] for material in facts.WALKABLE] == constants.walkable
    assert [*facts.VITALS, *facts.ITEMS] == list(constants.items)
    initial = {**dict.fromkeys(facts.VITALS, facts.MOST), **dict.fromkeys(facts.ITEMS, 0)}
    assert {name: {"max": facts.MOST, "initial": count} for name, count in initial.items()} == constants.items


def test_what_collecting_placing_and_making_take_and_give() -> None:
    for material, rule in facts.COLLECT.items():
        rules = constants.collect[facts.NAMES[material]]
        assert rules["require"] == ({rule.tool: 1} if rule.tool else {})
        assert rules["receive"] == {rule.item: 1}
        assert (rules["leaves"], rules.get("probability", 1)) == (facts.NAMES[rule.leaves], rule.probability)
    for name, placing in facts.PLACE.items():
        rules = constants.place[name]
        assert rules["uses"] == dict(placing.uses)
        assert rules["where"] == [facts.NAMES[material] for material in placing.where]
        assert (rules["type"] == "object") == (placing.what == facts.PLANT)
    for name, making in facts.MAKE.items():
        rules = constants.make[name]
        assert (rules["uses"], rules["gives"]) == (dict(making.uses), 1)
        assert rules["nearby"] == [facts.NAMES[material] for material in making.nearby]
    assert (len(facts.COLLECT), len(facts.PLACE), len(facts.MAKE)) == (
        len(constants.collect),
        len(constants.place),
        len(constants.make),
    )


# --- Text ------------------------------------------------------------------------------------------------------------


def test_the_manual_is_the_benchmarks() -> None:
    manual = make().manual
    assert len(manual) == 4603
    digest = hashlib.sha256(manual.encode()).hexdigest()
    assert digest == "2ece2c1256a11a3e80bd1a2804c066652b0ed478a99d65eedecec4fdbbcb9dde"


def go_to(game: Crafter, x: int, y: int) -> str:
    """Put the player on a cell of grass, facing south; return the next observation."""
    player, world = game._world.player, game._world.world
    world.surface[player.at] = world.ground[player.at]
    player.at = place(x, y)
    world.set_ground(player.at, facts.GRASS)
    world.surface[player.at] = facts.PLAYER
    world.visit(player.at)
    world.list_near(player.at)
    return game.step(0)[0]


@pytest.mark.parametrize(("x", "y"), [(3, 30), (30, 2), (0, 0), (30, 63), (3, 63)])
def test_near_the_border_the_original_tells_nothing(x: int, y: int) -> None:
    assert go_to(started(5), x, y) == "Error, you are out of the map."


@pytest.mark.parametrize(("x", "y"), [(4, 3), (63, 30), (30, 62), (60, 61)])
def test_elsewhere_near_the_border_the_view_is_clipped(x: int, y: int) -> None:
    assert go_to(started(5), x, y).startswith("You took action noop.\n\nYou see:\n- ")


def test_the_corrected_text_tells_what_can_be_seen_at_the_border() -> None:
    assert go_to(started(5, text="corrected"), 3, 30).startswith("You took action noop.\n\nYou see:\n- ")
    assert "\n\nYou face nothing at your front.\n\n" in go_to(started(5, text="corrected"), 30, 63)


@pytest.mark.parametrize(("text", "status"), [("original", "You are sleeping, "), ("corrected", "You died.")])
def test_killed_in_sleep(text: str, status: str) -> None:
    game = started(7, text=text)
    assert game.deviations() == ({} if text == "original" else {"text": {"paper": "original", "played": text}})
    player, world = game._world.player, game._world.world
    player.inventory["energy"] = 1
    game.step(game.actions.index("Sleep"))
    player.inventory["health"] = player._last_health = 2
    zombie = next(thing for thing in world.things if thing.kind == facts.ZOMBIE)
    free = next(player.at + d for d in (1, -1, 128, -128) if world.surface[player.at + d] == facts.GRASS)
    world.move(zombie, free)
    world.list_near(player.at)
    observation, _, terminated, _, _ = game.step(0)
    assert terminated
    assert observation.startswith(f"You took action noop.{status}")
    assert "\n\n\n\nYou see:" in observation
    assert "- health: 0/9" in observation


def test_a_plant_can_be_eaten_once_it_is_older_than_300_steps() -> None:
    game = started(5)
    go_to(game, 30, 30)
    player = game._world.player
    player.facing = DIRECTIONS[3]
    plant = Thing(facts.PLANT, place(30, 31))
    player.world.set_ground(plant.at, facts.GRASS)
    player.world.add(plant)
    for plant.clock, eaten in ((300, 0), (301, 1)):
        player._do()
        assert player.unlocked.get("eat_plant", 0) == eaten
    assert plant.clock == 0


def test_unknown_options_are_refused_in_one_sentence() -> None:
    with pytest.raises(ValueError, match=r"^engine must be .*fast.*, not 'craftax'\.$"):
        make(engine="craftax")
    with pytest.raises(ValueError, match=r"^text must be one of .*, not 'pretty'\.$"):
        make(text="pretty")
    with pytest.raises(ValueError, match=r"^picture_size must be 64 or more, not 10\.$"):
        make(picture_size=10)


# --- Seeds, states and copies ----------------------------------------------------------------------------------------


def test_world_seeds_are_those_of_cpython() -> None:
    seeds = [world_seed(seed, episode) for seed in (0, 1, 7, 2**31, 2**63) for episode in (1, 2, 3, 1000)]
    pinned = """
    1256191933 744553801 1246819891 1238182569 535231920
    1037498010 1639102990 1531126778 702520759 91543741
    693148721 585172509 121392701 1757238216 112020663
    103383337 530789928 19151792 521417886 512780564
    """
    assert seeds == [int(number) for number in pinned.split()]


def test_a_reset_without_a_seed_begins_the_next_episode() -> None:
    def begun(env: gymnasium.Env, seed: int | None) -> str:
        return str((list(env.reset(seed=seed)[0]), env._world.fingerprint()))

    seeds = (3, None, None, None, 3)
    first, second = ([begun(env, seed) for seed in seeds] for env in (make(), make()))
    assert first == second
    assert first[0] == first[-1]
    assert len(set(first)) == 4


# --- Environment -----------------------------------------------------------------------------------------------------


def test_an_episode_is_cut_off_at_the_engines_step_10000() -> None:
    env = make()
    env.reset(seed=6)
    assert env._world.steps == 1  # the noop of the reset
    env._world.steps = 9_998
    assert [env.step(0)[2:4] for _ in range(2)] == [(False, False), (False, True)]


# --- Pictures --------------------------------------------------------------------------------------------------------


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


@pytest.fixture(scope="module")
def package() -> ReferenceEngine:
    """The package's own world after some steps."""
    played = ReferenceEngine(3, 1)
    for step in range(60):
        played.step([0, 1, 5, 3][step % 4])
    return played


@pytest.mark.slow
@pytest.mark.parametrize("size", [65, 128, 576])
def test_larger_pictures_are_the_packages_too(package: ReferenceEngine, size: int) -> None:
    unit = np.array([size // 9] * 2)
    textures = engine.Textures(constants.root / "assets")
    view = engine.LocalView(Stage(package), textures, [9, 7])(package.env._player, unit)
    carried = engine.ItemView(textures, [9, 2])(package.env._player.inventory, unit)
    drawn = draw(package.scene(), size)
    border = (size - size // 9 * 9) // 2
    expected = np.concatenate([view, carried], 1).astype(np.uint8).transpose(1, 0, 2)
    assert np.array_equal(drawn[border : border + len(expected), border : border + len(expected)], expected)
