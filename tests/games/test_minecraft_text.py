"""Minecraft's observation text, rule by rule, from arrays made by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy

from smartplay_tools.games.minecraft.observation import Observation, malmo_rays, true_rays
from smartplay_tools.games.minecraft.text import components, describe

NORTH, EAST, SOUTH, WEST = -180.0, -90.0, 0.0, 90.0
FEET = 4
"""Index of the feet along every axis of the 9 x 9 x 9 blocks."""
MIDDLE = 8
"""Index of the middle row and column of the 17 x 17 view."""


def nothing(yaw: float = SOUTH, **changes: object) -> Observation:
    """An observation of nothing but air."""
    empty = Observation(
        position=np.array([0, 64, 0], np.float32),
        yaw=yaw,
        pitch=0.0,
        biome=1,
        blocks=np.full((9, 9, 9), "air", "<U24"),
        ray_directions=true_rays(yaw),
        ray_blocks=np.full(290, "air", "<U24"),
        ray_block_distances=np.full(290, 65, np.float32),
        ray_entities=np.full(290, "null", "<U24"),
        ray_entity_distances=np.full(290, 65, np.float32),
    )
    return dataclasses.replace(empty, **changes)


def see(observation: Observation, row: int, column: int, name: str, distance: float, *, entity: bool = False) -> None:
    """Let a ray of the view hit something."""
    kind = "entities" if entity else "blocks"
    getattr(observation, f"ray_{kind}")[1 + row * 17 + column] = name
    getattr(observation, f"ray_{'entity' if entity else 'block'}_distances")[1 + row * 17 + column] = distance


def around(observation: Observation, mode: str = "corrected") -> list[str]:
    """The lines of "Around you:"."""
    lines = describe(observation, mode).split("\n")
    start = lines.index("Around you:") + 1
    return lines[start : lines.index("", start)]


def view(observation: Observation, mode: str = "corrected") -> list[str]:
    """The lines of "You see:"."""
    lines = describe(observation, mode).split("\n")
    return lines[lines.index("You see:") + 1 :]


# The frame.


@pytest.mark.parametrize("mode", ["paper", "corrected"])
def test_a_frame_without_anything_in_it(mode):
    frame = "Coordinate (0.00,64.00,0.00). Facing south.\n\nYou're not aiming at any block.\nAround you:\n\n"
    assert describe(nothing(), mode) == frame
    assert describe(nothing(), mode, "Move West") == f"You took action Move West.\n\n{frame}"


@pytest.mark.parametrize("mode", ["paper", "corrected"])
def test_a_frame_with_everything_in_it(mode):
    observation = nothing(EAST, position=np.array([-253.123, 71.75, 248.639], np.float32))
    observation.blocks[:, 3, :] = "grass block"
    observation.ray_blocks[0] = "leaves"
    for column in range(3):
        see(observation, MIDDLE, column, "stone", 10 + column)
    see(observation, MIDDLE, MIDDLE, "pig", 7.5, entity=True)
    ahead = {"paper": "west", "corrected": "east"}[mode]
    side = {"paper": "south-west", "corrected": "south-east"}[mode]
    assert describe(observation, mode, "Move East") == (
        "You took action Move East.\n"
        "\n"
        "Coordinate (-253.12,71.75,248.64). Facing east.\n"
        "\n"
        "You're aiming at leaves.\n"
        "Around you:\n"
        " - grass block, 1.00 blocks away, below you to front\n"
        f" - pig, 7.50 blocks away, at your level to {ahead}, taking 0% of screen\n"
        "\n"
        "You see:\n"
        f" - stone, 10.00 blocks away, at your level to {side}, taking 1% of screen"
    )


PAPERS_EXAMPLE = """\
You took action Move East.

Coordinate (-253.12,71.75,248.64). Facing east.

You're not aiming at any block.
Around you:
 - leaves, 3.96 blocks away, above you to north-west
 - wood, 4.24 blocks away, to north-west
 - grass block, 1.34 blocks away, below you to north-east
 - dirt, 3.33 blocks away, below you to north-east
 - stone, 4.67 blocks away, below you to north-east

You see:
 - grass block, 1.36 blocks away, below you to north-west, taking 51% of screen
 - sand, 8.29 blocks away, below you to south-west, taking 4% of screen
 - leaves, 4.47 blocks away, above you to north-west, taking 17% of screen
 - grass, 5.49 blocks away, above you to north-west, taking 1% of screen
 - wood, 11.07 blocks away, above you to north-west, taking 0% of screen"""


def test_the_papers_example_comes_out_word_for_word():
    """The one text of the original that is published (paper, appendix); what lies there is north-east of the player."""
    observation = nothing(EAST, position=np.array([-253.123, 71.75, 248.639], np.float32))
    around = {
        "leaves": [(-4, 2, 0), (-3, 2, -1), (-3, 2, 0), (-3, 3, 0)],
        "wood": [(-3, 0, -3)],
        "grass block": [(0, -1, -1), (0, -1, 0), (1, -1, -1), (1, -1, 0), (2, -1, 0)],
        "dirt": [(1, -1, z) for z in (-4, -3)] + [(2, -1, z) for z in (-4, -3, -2, -1)] + [(3, -1, -1)],
        "stone": [(3, -1, -3), (3, -1, -2), (4, -1, -4), (4, -1, -3), (4, -1, -2)],
    }
    for name, places in around.items():
        for place in places:
            observation.blocks[tuple(FEET + offset for offset in place)] = name
    in_view = {
        "grass block": (1.36, (3, 14), [(row, column) for row in range(9) for column in range(17)]),
        "sand": (8.29, (5, 2), [(row, column) for row in (5, 6) for column in range(6)]),
        "leaves": (4.47, (11, 13), [(row, column) for row in (10, 11, 12) for column in range(17)]),
        "grass": (5.49, (13, 12), [(13, 11), (13, 12)]),
        "wood": (11.07, (13, 15), [(13, 15)]),
    }
    for name, (distance, nearest, rays_that_hit) in in_view.items():
        for ray in rays_that_hit:
            see(observation, *ray, name, distance + (ray != nearest))
    for column in range(6):
        see(observation, 9, column, "grass block", 9.0)
    for column in (15, 16):
        see(observation, 12, column, "air", 65.0)
    assert describe(observation, "paper", "Move East") == PAPERS_EXAMPLE


@pytest.mark.parametrize(
    ("yaw", "direction"),
    [
        (-180, "north"),
        (-157.6, "north"),
        (-157.5, "north-east"),
        (-90, "east"),
        (-22.6, "south-east"),
        (-22.5, "south"),
        (22.4, "south"),
        (22.5, "south-west"),
        (90, "west"),
        (135, "north-west"),
        (157.5, "north"),
        (270, "east"),
    ],
)
def test_facing_has_eight_sectors(yaw, direction):
    assert describe(nothing(yaw), "paper").startswith(f"Coordinate (0.00,64.00,0.00). Facing {direction}.\n")


@pytest.mark.parametrize(("pitch", "words"), [(-0.1, " Looking up."), (0.0, ""), (0.1, " Looking down.")])
def test_looking_up_and_down(pitch, words):
    assert describe(nothing(pitch=pitch), "paper").startswith(f"Coordinate (0.00,64.00,0.00). Facing south.{words}\n")


# Blocks around the player.


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ((0, 0, -1), "1.00 blocks away, to north"),
        ((0, 0, 1), "1.00 blocks away, to south"),
        ((1, 0, 0), "1.00 blocks away, to east"),
        ((-1, 0, 0), "1.00 blocks away, to west"),
        ((2, 0, -2), "2.83 blocks away, to north-east"),
        ((0, -1, 0), "1.00 blocks away, below you to front"),
        ((0, 4, 0), "4.00 blocks away, above you to front"),
        ((-3, 2, 1), "3.74 blocks away, above you to south-west"),
    ],
)
@pytest.mark.parametrize("mode", ["paper", "corrected"])
def test_directions_of_blocks_around(cell, words, mode):
    observation = nothing()
    observation.blocks[tuple(FEET + offset for offset in cell)] = "sand"
    assert around(observation, mode) == [f" - sand, {words}"]


def test_the_rounding_of_32_bits_decides_between_equal_distances_in_the_papers_text():
    """As in the original: both groups are the square root of 2 away, and the smaller one is the second."""
    observation = nothing()
    for x, y, z in ((0, -1, 1), (1, -1, 1), (1, 0, 1), (1, 0, 0), (1, -1, 2), (-1, 1, 0)):
        observation.blocks[FEET + x, FEET + y, FEET + z] = "water"
    assert around(observation, "paper") == [" - water, 1.41 blocks away, above you to west"]


# The view.


@pytest.mark.parametrize(("cells", "share"), [(1, "0%"), (2, "1%"), (4, "1%"), (5, "2%"), (17, "6%")])
def test_the_share_of_the_screen_is_rounded(cells, share):
    observation = nothing()
    for column in range(cells):
        see(observation, MIDDLE, column, "sand", 5)
    assert view(observation)[0].endswith(f"taking {share} of screen")


def test_null_is_not_told():
    observation = nothing(ray_blocks=np.full(290, "null"))
    assert "You see:" not in describe(observation, "corrected")


def test_entities_have_no_heading_and_a_line_end_each():
    observation = nothing()
    see(observation, 8, 2, "sheep", 12, entity=True)
    see(observation, 8, 9, "pig", 4, entity=True)
    assert describe(observation, "corrected").endswith(
        "Around you:\n"
        " - sheep, 12.00 blocks away, at your level to south-west, taking 0% of screen\n"
        " - pig, 4.00 blocks away, at your level to south, taking 0% of screen\n"
        "\n"
    )


# The original's bugs, and what the corrected text says instead.


@pytest.mark.parametrize(
    ("yaw", "column", "paper", "corrected"),
    [
        (SOUTH, 8, "north", "south"),
        (NORTH, 8, "south", "north"),
        (EAST, 8, "west", "east"),
        (WEST, 8, "east", "west"),
        (NORTH, 0, "south-east", "north-east"),
        (NORTH, 16, "south-west", "north-west"),
        (SOUTH, 0, "north-west", "south-west"),
        (EAST, 16, "north-west", "north-east"),
        (-37.0, 16, "north", "east"),  # to the original 11 degrees east of north, whose sine is 0.19
    ],
)
def test_what_is_ahead_is_told_as_behind(yaw, column, paper, corrected):
    observation = nothing(yaw)
    see(observation, MIDDLE, column, "sand", 5)
    assert view(observation, "paper") == [f" - sand, 5.00 blocks away, at your level to {paper}, taking 0% of screen"]
    assert view(observation, "corrected") == [
        f" - sand, 5.00 blocks away, at your level to {corrected}, taking 0% of screen"
    ]


@pytest.mark.parametrize(("row", "height"), [(0, "below"), (16, "above")])
def test_the_lowest_and_highest_rows_are_told_as_straight_down_and_up(row, height):
    observation = nothing(SOUTH)
    see(observation, row, 8, "sand", 5)
    assert view(observation, "paper")[0].split(", ")[2] == f"{height} you to front"
    assert view(observation, "corrected")[0].split(", ")[2] == f"{height} you to south"


def test_rows_are_told_steeper_than_they_are():
    """Row 9 is 6 degrees over the middle, which is level. The original treats it as 11.25 degrees, row 10 as 22.5."""
    observation = nothing(SOUTH)
    see(observation, 10, 8, "sand", 5)  # really 12 degrees up, a sine of 0.21
    see(observation, 6, 8, "clay", 5)
    for mode in ("paper", "corrected"):
        assert [line.split(", ")[2].split(" to")[0] for line in view(observation, mode)] == ["below you", "above you"]
    see(observation, 9, 0, "ice", 5)
    assert view(observation, "paper")[1].split(", ")[2].startswith("at your level")


def test_pitch_is_added_with_the_wrong_sign():
    """Looking down is positive; the original then describes everything as higher."""
    observation = nothing(SOUTH, pitch=30.0)
    see(observation, MIDDLE, MIDDLE, "sand", 5)
    assert view(observation, "paper")[0].split(", ")[2] == "above you to north"


def test_the_originals_rays_turn_about_the_worlds_axis():
    """Facing south the first row looks down, facing north up; facing east or west all rows are the same."""
    first, last = 1 + MIDDLE, 1 + 16 * 17 + MIDDLE
    south, north, east = malmo_rays(SOUTH), malmo_rays(NORTH), malmo_rays(EAST)
    down = -np.sin(np.radians(48))
    assert south[first] == pytest.approx([0, down, np.cos(np.radians(48))], abs=1e-6)
    assert north[first] == pytest.approx([0, -down, -np.cos(np.radians(48))], abs=1e-6)
    assert np.array_equal(east[1:18], east[last - MIDDLE : last - MIDDLE + 17])
    assert not east[1:, 1].any()


def test_the_alphabetically_first_name_around_is_lumped_together():
    """The labelling treats it as background: its blocks need not touch, and it comes first."""
    observation = nothing()
    observation.blocks[1, FEET, FEET] = "stone"
    observation.blocks[3, FEET, FEET] = observation.blocks[8, FEET, FEET] = "acacia wood"
    assert around(observation, "paper") == [
        " - acacia wood, 1.50 blocks away, to east",
        " - stone, 3.00 blocks away, to west",
    ]
    assert around(observation, "corrected") == [
        " - stone, 3.00 blocks away, to west",
        " - acacia wood, 1.00 blocks away, to west",
    ]


def test_without_air_another_name_is_lumped_together():
    observation = nothing()
    observation.blocks[:] = "stone"
    observation.blocks[0, FEET, 0] = observation.blocks[8, FEET, 0] = "dirt"
    dirt = {mode: [line for line in around(observation, mode) if "dirt" in line] for mode in ("paper", "corrected")}
    assert dirt["paper"] == [" - dirt, 4.00 blocks away, to north"]
    assert dirt["corrected"] == [" - dirt, 5.66 blocks away, to north-west"]


def test_entities_before_null_in_the_alphabet_are_lumped_together():
    observation = nothing()
    for name in ("cow", "sheep"):
        row = {"cow": 8, "sheep": 10}[name]
        see(observation, row, 2, name, 12, entity=True)
        see(observation, row, 14, name, 9, entity=True)
    lines = {
        mode: [line for line in describe(observation, mode).split("\n") if " cow," in line or " sheep," in line]
        for mode in ("paper", "corrected")
    }
    assert [line.split(",")[0] for line in lines["paper"]] == [" - cow", " - sheep", " - sheep"]
    assert lines["paper"][0].endswith("taking 1% of screen")
    assert [line.split(",")[0] for line in lines["corrected"]] == [" - cow", " - cow", " - sheep", " - sheep"]


@pytest.mark.parametrize("shape", [(17, 17), (9, 6, 9)])
def test_groups_are_those_of_scipys_labelling(shape):
    """Blocks connect through faces, cells of the view also through corners."""
    random, neighbours = np.random.default_rng(0), scipy.ndimage.generate_binary_structure(len(shape), 4 - len(shape))
    for share in (0.2, 0.5, 0.8):
        names = np.where(random.random(shape) < share, "air", random.choice(["acacia wood", "dirt", "stone"], shape))
        expected = []
        for name in ("acacia wood", "dirt", "stone"):
            labels, count = scipy.ndimage.label(names == name, neighbours)
            expected += [(name, np.flatnonzero(labels == label).tolist()) for label in range(1, count + 1)]
        groups = components(names, ignored=frozenset({"air"}), mode="corrected")
        assert groups == sorted(expected, key=lambda group: group[1])
        first, *others = components(names, ignored=frozenset({"air"}), mode="paper")
        assert first == ("acacia wood", np.flatnonzero(names == "acacia wood").tolist())
        assert others == [group for group in groups if group[0] != "acacia wood"]
