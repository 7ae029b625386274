"""Minecraft's rules around the world: goals, the action's expansion, the score and the options."""

from __future__ import annotations

import re

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.cli.doctor import check_engines
from smartplay_tools.games.minecraft.engines import ENGINES
from smartplay_tools.games.minecraft.rules import CORRECTED_GOALS, PAPER_GOALS, TICKS, Stride, strides, turn

BIOMES = """
0 Ocean, 1 Plains, 2 Desert, 3 Extreme Hills, 4 Forest, 5 Taiga, 6 Swampland, 7 River, 8 Hell, 9 The End,
10 FrozenOcean, 11 FrozenRiver, 12 Ice Plains, 13 Ice Mountains, 14 MushroomIsland, 15 MushroomIslandShore, 16 Beach,
17 DesertHills, 18 ForestHills, 19 TaigaHills, 20 Extreme Hills Edge, 21 Jungle, 22 JungleHills, 23 JungleEdge,
24 Deep Ocean, 25 Stone Beach, 26 Cold Beach, 27 Birch Forest, 28 Birch Forest Hills, 29 Roofed Forest, 30 Cold Taiga,
31 Cold Taiga Hills, 32 Mega Taiga, 33 Mega Taiga Hills, 34 Extreme Hills+, 35 Savanna, 36 Savanna Plateau, 37 Mesa,
38 Mesa Plateau F, 39 Mesa Plateau, 127 The Void, 129 Sunflower Plains, 130 Desert M, 131 Extreme Hills M,
132 Flower Forest, 133 Taiga M, 134 Swampland M, 140 Ice Plains Spikes, 149 Jungle M, 151 JungleEdge M,
155 Birch Forest M, 156 Birch Forest Hills M, 157 Roofed Forest M, 158 Cold Taiga M, 160 Mega Spruce Taiga,
161 Redwood Taiga Hills M, 162 Extreme Hills+ M, 163 Savanna M, 164 Savanna Plateau M, 165 Mesa (Bryce),
166 Mesa Plateau F M, 167 Mesa Plateau M
"""
"""The biomes of Minecraft 1.11.2, as the original calls them."""
NAMES = {int(number): name for number, name in re.findall(r"(\d+) ([A-Z][^,\n]+)", BIOMES)}


@pytest.fixture(autouse=True)
def without_minedojo(monkeypatch):
    """Its client takes minutes to start, so it has its own tests."""
    monkeypatch.delenv("SMARTPLAY_MINEDOJO_PYTHON", raising=False)


def test_the_manual_names_the_goal():
    assert sp.GAMES["MinedojoCreative7-v0"].make().manual == (
        "You are in Minecraft and your goal is to find a ice spikes biome. You are not allowed to craft anything.\n"
        "\n"
        "In your observation, you are provided the amount of space an object takes in your field of view. "
        "Note that objects of the same size takes more space when they are closer to you.\n"
        "\n"
        "List of all actions:\n1. Move North\n2. Move East\n3. Move South\n4. Move West"
    )


def test_the_original_takes_any_biome_whose_name_has_the_goals_words_in_it():
    names = ("plains", "forest", "ocean", "beach", "taiga", "ice spikes", "jungle", "desert")
    assert [goal.name for goal in PAPER_GOALS.values()] == list(names)
    for goal in PAPER_GOALS.values():
        assert goal.biomes == {number for number, name in NAMES.items() if goal.name in name.lower()}
    assert [f"MinedojoCreative{task}-v0" for task in PAPER_GOALS] == [
        spec.id for spec in sp.GAMES.values() if spec.family == "minecraft"
    ]


def test_ice_spikes_cannot_be_found_in_the_original_and_can_here():
    assert PAPER_GOALS[7].biomes == set()
    assert CORRECTED_GOALS[7].biomes == {140}
    assert {task: goal for task, goal in CORRECTED_GOALS.items() if task != 7} == {
        task: goal for task, goal in PAPER_GOALS.items() if task != 7
    }


@pytest.mark.parametrize(("action", "yaw"), [(0, -180), (1, -90), (2, 0), (3, 90)])
def test_an_action_turns_to_its_heading_from_every_other(action, yaw):
    for before in (-180, -90, 0, 90):
        assert (before + turn(action, before) - yaw) % 360 == 0


def test_turns_are_rounded_down_to_bins_of_15_degrees():
    """A start that is off by some degrees therefore stays off."""
    assert turn(2, 7.0) == -15
    assert 7.0 + turn(2, 7.0) == -8.0
    assert -8.0 + turn(2, -8.0) == -8.0


def test_half_of_the_ticks_strafe_and_half_of_them_jump():
    drawn = [stride for seed in range(40) for stride in strides(np.random.default_rng(seed))]
    assert len(drawn) == 40 * TICKS
    share = {side: np.mean([stride.left == side for stride in drawn]) for side in (-1, 0, 1)}
    assert share == pytest.approx({-1: 0.25, 0: 0.5, 1: 0.25}, abs=0.04)
    assert np.mean([stride.jump for stride in drawn]) == pytest.approx(0.5, abs=0.04)
    assert {type(drawn[0].left), type(drawn[0].jump)} == {int, bool}
    assert Stride(0, True) in drawn


def test_there_is_no_reward_and_the_score_is_1_in_the_goal():
    game = sp.GAMES["MinedojoCreative0-v0"].make()
    game.reset(seed=0)
    *_, reward, terminated, truncated, info = game.step(0)
    assert (reward, terminated, truncated, info["score"], info["completed"]) == (0, False, False, 0, 0)


def test_engine_and_text_are_deviations_from_the_paper():
    game = sp.GAMES["MinedojoCreative0-v0"].make()
    assert game.engine == "voxel"
    assert game.deviations() == {
        "engine": {"paper": "minedojo", "played": "voxel"},
        "text": {"paper": "paper", "played": "corrected"},
        "start": {"paper": "anywhere", "played": "far"},
    }
    assert set(sp.GAMES["MinedojoCreative0-v0"].make(text="paper", start="anywhere").deviations()) == {"engine"}


# Where an episode begins.


def starts(task, count=10, **options):
    """Where episodes begin: whether it is a goal biome."""
    game = sp.GAMES[f"MinedojoCreative{task}-v0"].make(**options)
    for seed in range(count):
        game.reset(seed=seed)
        yield game.world.world.biome_at(*(int(at // 1) for at in game.world.position[::2])) in game.goal.biomes


def test_a_start_anywhere_is_not_checked_for_the_goal():
    assert not any(starts(0, count=5))
    assert {*starts(0, start="anywhere")} == {True, False}


def test_a_start_in_the_goal_is_won_by_the_first_action():
    seed = next(seed for seed, wins in enumerate(starts(0, start="anywhere")) if wins)
    with sp.Episode("MinedojoCreative0-v0", seed=seed, start="anywhere") as episode:
        _, act, _ = episode.functions()
        act("Move North")
    assert (episode.result.score, episode.result.steps, episode.result.end_reason) == (1, 1, "terminated")


def test_the_same_world_is_played_whatever_the_goal():
    games = [sp.GAMES[f"MinedojoCreative{task}-v0"].make(start="anywhere") for task in (0, 9)]
    assert len({game.reset(seed=3)[0] for game in games}) == 1


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"engine": "quake"}, "engine must be one of voxel"),
        ({"text": "short"}, "text must be"),
        ({"start": "here"}, "start must be one of far, anywhere, not 'here'"),
        ({"engine": "minedojo", "start": "far"}, "does not support start='far': leave out the option"),
    ],
)
def test_unknown_values_are_refused_in_one_sentence(option, message):
    with pytest.raises(ValueError, match=message):
        sp.GAMES["MinedojoCreative0-v0"].make(**option)


@pytest.mark.slow
def test_the_doctor_plays_on_every_engine():
    checks = check_engines()
    assert [check.name for check in checks] == list(ENGINES)
    # Engines outside of this package may be missing; what the doctor says then is the engine's own remedy.
    assert all(check.detail.startswith("a new world in") for check in checks if check.works)
    assert next(check.works for check in checks if check.name == "voxel")
