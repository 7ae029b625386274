"""Rules for Minecraft navigation: keep a heading, turn at obstacles, and walk towards signs of the goal biome.

The knowledge about biomes is what players know, such as that cacti grow in deserts and vines in jungles. It is a table
of words (`minecraft.toml`), which are compared with those of the messages.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.types.messages import Message
from smartplay_tools.types.sums import added
from smartplay_tools.types.tables import read_table

HEADINGS = {"north": (0, -1), "east": (1, 0), "south": (0, 1), "west": (-1, 0)}
"""Action word to x and z; clockwise."""

GOAL = re.compile(r"your goal is to find a (.+?) biome\.")
PLACE = re.compile(r"Coordinate \((-?\d+\.?\d*),(-?\d+\.?\d*),(-?\d+\.?\d*)\)\. Facing ([a-z-]+)\.")
TOOK = re.compile(r"^You took action Move (North|East|South|West)\.")
THING = re.compile(
    r"^ - (?P<name>[^,\n]+), (?P<distance>\d+\.?\d*) blocks away, (?P<height>above you|below you|at your level) "
    r"to (?P<where>[a-z-]+), taking (?P<share>\d+)% of screen$",
    flags=re.MULTILINE,
)

CLUES: Mapping[str, Mapping[str, float]] = read_table(__package__, "minecraft.toml")
"""The weight of a sight for each goal, or against it."""

ENOUGH = 4
"""Evidence that makes a sight worth a detour."""

ARRIVED = 9
"""Things nearer than this are not in the goal, or the game would be over, so they are ignored."""

ROUND = 350
"""Worlds begin near the origin of their coordinates. A player without evidence walks this far and then in a square
around the origin, because a straight line would soon leave its surroundings."""

STUCK, STUCK_SWIMMING = 4, 1.5
"""A player that has moved less than this during an action has met an obstacle."""

SEA_LEVEL = 62.9
"""A player whose feet are lower is swimming, and should go on until it reaches land."""

WATER_NEAR, WATER_SHARE = 30, 25
"""Distance in blocks and percent of the screen above which water ahead is more than a brook."""


@dataclass(frozen=True)
class SeenThing:
    """A line of the view, with the place of its thing."""

    name: str
    distance: float
    share: int
    x: float
    z: float


@dataclass(frozen=True)
class MinecraftSight:
    """The content of an observation."""

    x: float
    y: float
    z: float
    facing: str
    action: str | None
    """The heading of the walk that led there."""
    things: tuple[SeenThing, ...]


def plays(reading: Reading) -> bool:
    """Whether the actions are the four headings."""
    return set(reading.actions) == {f"Move {heading.title()}" for heading in HEADINGS}


def decide(reading: Reading) -> Message:
    """Read the manual, observe, and then walk."""
    goal = GOAL.search(reading.system)
    if goal is None and reading.is_start:
        return call("read_manual")
    sights = [sight for observation in reading.observations if (sight := look(observation))]
    if not sights:
        return call("observe")
    heading = choose_heading(sights, CLUES.get(goal[1], {}) if goal else {})
    return call("act", action=f"Move {heading.title()}")


def look(observation: str) -> MinecraftSight | None:
    """Parse an observation."""
    place = PLACE.search(observation)
    if place is None or place[4].partition("-")[0] not in HEADINGS:
        return None
    x, y, z = (float(place[i]) for i in (1, 2, 3))
    took = TOOK.search(observation)
    return MinecraftSight(x, y, z, place[4], took[1].lower() if took else None, tuple(_things(observation, x, z)))


def _things(observation: str, x: float, z: float) -> Iterator[SeenThing]:
    for line in THING.finditer(observation):
        ways = [HEADINGS[word] for word in line["where"].split("-") if word in HEADINGS]
        far = float(line["distance"]) / math.sqrt(max(len(ways), 1))
        dx, dz = (sum(way[axis] for way in ways) * far for axis in (0, 1))
        yield SeenThing(line["name"], float(line["distance"]), int(line["share"]), x + dx, z + dz)


def choose_heading(sights: list[MinecraftSight], clues: Mapping[str, float]) -> str:
    """The heading to take after these sights (oldest first)."""
    here = sights[-1]
    ahead = here.action or here.facing.partition("-")[0]
    right, left, back = _turns(ahead)
    blocked = _blocked(sights)
    # Things behind the player have been passed already, so evidence never makes it turn round.
    wanted = [heading for heading in _towards_clues(sights, clues) if heading not in blocked | {back}]
    if wanted:
        return wanted[0]
    avoids_water = clues.get("water", 0) <= 0 and not _is_crossing(sights)
    if ahead in blocked or (avoids_water and _is_water_ahead(here)):
        return next((heading for heading in (right, left) if heading not in blocked), back)
    # Return to the old heading once an obstacle has been passed.
    if len(sights) > 2 and sights[-2].action in (right, left) and _is_stuck(sights[-3], sights[-2]):
        return sights[-2].action or ahead
    if not avoids_water and _is_water_ahead(here):
        return ahead
    return _search(here, ahead, blocked | {s.action for s in sights if s.action and _is_water_ahead(s)})


def _is_crossing(sights: list[MinecraftSight]) -> bool:
    """Whether water has to be crossed: it is on all sides, or it is being crossed already."""
    if len(sights) < 2:
        return False
    before, here = sights[-2:]
    return len({sight.action for sight in sights}) > 2 or (before.action == here.action and _is_water_ahead(before))


def _search(here: MinecraftSight, ahead: str, blocked: set[str]) -> str:
    """Walk out to a square around the origin, and then clockwise along it."""
    sides = {"east": here.x, "south": here.z, "west": -here.x, "north": -here.z}
    outward = max(sides, key=lambda side: (sides[side], side == ahead))
    if sides[outward] < 2 * ARRIVED:
        return ahead
    if sides[outward] < ROUND and outward not in blocked:
        return outward
    return _turns(outward)[0]


def _turns(heading: str) -> tuple[str, str, str]:
    """The headings to the right, to the left and back."""
    order = list(HEADINGS)
    at = order.index(heading)
    return order[(at + 1) % 4], order[at - 1], order[at - 2]


def _towards_clues(sights: list[MinecraftSight], clues: Mapping[str, float]) -> list[str]:
    """The headings towards the best evidence in sight, the one with the longer distance first."""
    here = sights[-1]
    for sight in reversed(sights):
        beyond = [
            (thing, _weight(thing.name, clues) * (1 + thing.share))
            for thing in sight.things
            if math.dist((thing.x, thing.z), (here.x, here.z)) > ARRIVED
        ]
        if added(weight for _, weight in beyond) < ENOUGH:
            continue
        speaking = [(thing, weight) for thing, weight in beyond if weight > 0]
        total = added(weight for _, weight in speaking)
        dx = added(thing.x * weight for thing, weight in speaking) / total - here.x
        dz = added(thing.z * weight for thing, weight in speaking) / total - here.z
        ways = {"east": dx, "west": -dx, "south": dz, "north": -dz}
        return sorted((way for way in ways if ways[way] > STUCK), key=lambda way: -ways[way])
    return []


def _weight(name: str, clues: Mapping[str, float]) -> float:
    """The weight of a name: its own entry, or that of a word in it ("oak" for "oak leaves")."""
    if name in clues:
        return clues[name]
    return next((clues[word] for word in name.split() if word in clues), 0)


def _blocked(sights: list[MinecraftSight]) -> set[str]:
    """Headings that were blocked recently, according to the visible sights."""
    steps = itertools.pairwise(sights)
    return {after.action for before, after in steps if after.action and _is_stuck(before, after)}


def _is_stuck(before: MinecraftSight, after: MinecraftSight) -> bool:
    step = abs(after.x - before.x) + abs(after.z - before.z)
    return step < (STUCK_SWIMMING if min(before.y, after.y) < SEA_LEVEL else STUCK)


def _is_water_ahead(sight: MinecraftSight) -> bool:
    if sight.y < SEA_LEVEL:
        return False
    water = [thing for thing in sight.things if thing.name in ("water", "ice")]
    return added(t.share for t in water) > WATER_SHARE and min(t.distance for t in water) < WATER_NEAR
