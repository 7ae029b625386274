"""The rule player in Minecraft: how it reads the messages, and its decisions."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.players.rules.minecraft import CLUES, choose_heading, look


def sight(x: float, z: float, action: str | None, *lines: str, y: float = 64.0):
    took = f"You took action Move {action.title()}.\n\n" if action else ""
    around = "You're not aiming at any block.\nAround you:\n"
    place = f"Coordinate ({x:.2f},{y:.2f},{z:.2f}). Facing {action or 'south'}.\n\n"
    return look(took + place + around + "\n".join(["", "You see:", *lines]))


CACTUS = " - cactus, 40.00 blocks away, at your level to south-west, taking 2% of screen"
SEA = " - water, 12.00 blocks away, below you to south, taking 40% of screen"
DESERT = CLUES["desert"]


def test_it_reads_where_things_are():
    seen = sight(10, 20, "south", CACTUS)
    (cactus,) = seen.things
    assert (seen.x, seen.z, seen.action) == (10, 20, "south")
    assert (cactus.name, cactus.share) == ("cactus", 2)
    assert (cactus.x, cactus.z) == pytest.approx((10 - 28.28, 20 + 28.28), abs=0.01)


def test_it_heads_for_what_betrays_the_goal():
    west = CACTUS.replace("south-west", "west")
    assert choose_heading([sight(0, 20, "south", west)], DESERT) == "west"
    assert choose_heading([sight(0, 20, "south", west)], CLUES["jungle"]) == "south"


def test_it_remembers_what_is_still_in_the_window():
    passed = [sight(0, 0, "south", CACTUS.replace("south-west", "west")), sight(0, 15, "south")]
    assert choose_heading(passed, DESERT) == "west"


def test_it_turns_away_from_the_sea_unless_that_is_the_goal():
    at_the_shore = [sight(100, 20, "south", SEA)]
    assert choose_heading(at_the_shore, DESERT) == "west"
    assert choose_heading(at_the_shore, CLUES["ocean"]) == "south"


def test_it_crosses_water_that_is_all_around():
    turns = [sight(100, 20, "south", SEA), sight(90, 20, "west", SEA), sight(90, 10, "north", SEA)]
    assert choose_heading(turns[:2], DESERT) == "north"
    assert choose_heading(turns, DESERT) == "north"
    assert choose_heading([*turns[1:], sight(90, -3, "north", SEA)], DESERT) == "north"


def test_it_goes_around_what_stops_it_and_then_on():
    stopped = sight(0, 60, "south"), sight(0, 61, "south")
    assert choose_heading(list(stopped), DESERT) == "west"
    assert choose_heading([*stopped, sight(-15, 61, "west")], DESERT) == "south"


def test_it_stays_near_the_origin():
    assert choose_heading([sight(20, 345, "south"), sight(20, 360, "south")], DESERT) == "west"
    assert choose_heading([sight(-345, 300, "west"), sight(-360, 300, "west")], DESERT) == "north"
    assert choose_heading([sight(-360, 100, "north"), sight(-360, 90, "north")], DESERT) == "north"


def completion(task: int, seeds: range) -> float:
    won = 0
    for seed in seeds:
        with sp.Episode(f"MinedojoCreative{task}-v0", seed=seed) as episode:
            won += sp.play(episode, sp.get_player("rule")).completed
    return won / len(seeds)


@pytest.mark.slow
def test_it_finds_most_biomes():
    tasks = (0, 1, 2, 4, 5, 7, 8, 9)
    assert sum(completion(task, range(1)) for task in tasks) / len(tasks) >= 0.6
