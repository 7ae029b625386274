"""Crafter with notes: the same rules, and a memory that the player writes down.

The memory is a line: where the player is by dead reckoning, how much time has passed, where it is at home, and a map.
The next reply reads it where it was written (`players.rules.memory`). That is the whole difference to the player
without notes, and it is visible in the transcript.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.crafter import player
from smartplay_tools.players.rules.crafter.home import Home, dwell, find_site, has_water
from smartplay_tools.players.rules.crafter.player import SOLID, WISHES
from smartplay_tools.players.rules.crafter.sight import ANY, BIT, OUTSIDE, WALKABLE, Cell, Map
from smartplay_tools.players.rules.crafter.situation import Situation
from smartplay_tools.players.rules.memory import fits, line, recall
from smartplay_tools.types.messages import Message

DAY, DUSK, DAWN = 300, 130, 280
"""The steps of a day, and the steps at which the part of the night with many zombies begins and ends."""
RADIUS = 14
"""The radius of the map in the notes, in cells."""
LETTERS = {
    "water": "w", "grass": "g", "stone": "s", "path": "p", "sand": "a", "tree": "t", "lava": "l", "coal": "c",
    "iron": "i", "diamond": "d", "table": "b", "furnace": "f", "plant": "v",
}  # fmt: skip
BITS_OF = {letter: BIT[kind] for kind, letter in LETTERS.items()} | {"-": WALKABLE, "#": SOLID, "?": ANY, "X": OUTSIDE}
LETTER_OF = {bits: letter for letter, bits in BITS_OF.items()}

plays = player.plays


@dataclass(frozen=True)
class CrafterNotes:
    """What the player remembers in addition to the latest observation."""

    map: Map
    clock: int
    asleep: bool
    home: Home | None
    goal: Cell | None = None
    """The cell to which the player goes to explore."""

    def text(self, cap: int | None = None) -> str:
        """The line that is kept; under a cap in tokens, with a map that reaches less far."""
        if cap is None:
            return self._line(RADIUS)
        lines = (self._line(radius) for radius in range(RADIUS, 0, -1))
        return next((each for each in lines if fits(each, cap)), self._line(0))

    def _line(self, radius: int) -> str:
        x, y = self.map.at
        rows = [
            "".join(_letter(self.map.kinds.get((column, row))) for column in range(x - radius, x + radius + 1))
            for row in range(y - radius, y + radius + 1)
        ]
        home = self.home and [self.home.left, self.home.top, self.home.width, self.home.height, self.home.side]
        notes = {
            "at": [x, y],
            "facing": self.map.facing,
            "clock": self.clock,
            "asleep": self.asleep,
            "home": home,
            "goal": self.goal,
            "visited": self.map.visited[-(radius * radius) // 2 :] if radius < RADIUS else self.map.visited,
            "map": "/".join(row.rstrip() for row in rows),
        }
        return line(notes)


def notes_of(notes: Mapping[str, Any]) -> CrafterNotes:
    """Return the notes that a line holds."""
    x, y = notes["at"]
    kinds: dict[Cell, int] = {}
    rows = notes["map"].split("/")
    radius = len(rows) // 2
    for row, letters in enumerate(rows, start=y - radius):
        for column, letter in enumerate(letters, start=x - radius):
            if letter != " ":
                kinds[column, row] = BITS_OF[letter]
    own_map = Map(at=(x, y), facing=notes["facing"], kinds=kinds, visited=[(a, b) for a, b in notes["visited"]])
    home, goal = notes["home"], notes["goal"]
    return CrafterNotes(own_map, notes["clock"], notes["asleep"], home and Home(*home), goal and tuple(goal))


def _letter(kinds: int | None) -> str:
    if kinds is None:
        return " "
    if kinds in LETTER_OF:
        return LETTER_OF[kinds]
    if kinds & ~ANY:
        return "X"
    return "-" if not kinds & ~WALKABLE else "#" if not kinds & ~SOLID else "?"


def decide(reading: Reading) -> Message:
    """Act on the notes of the last reply and the observation that followed it, and write updated notes."""
    message, text = remember(reading, None)
    return {**message, "content": text} if text else message


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Act on the memory and on what was seen since, and return the memory that covers it; without any, look."""
    if not reading.observations:
        return call("observe"), ""
    now, notes = _remember(reading)
    home = _home(now, notes)
    action, goal = _act(now, home, notes.clock), None
    if action is None:
        action, goal = _explore(now, notes.goal)
    kept = replace(notes, map=now.map, clock=notes.clock + 1, asleep=now.frame.asleep, home=home, goal=goal)
    return call("act", action=action), kept.text(cap)


def _explore(now: Situation, goal: Cell | None) -> tuple[str, Cell | None]:
    """Keep going to the chosen cell as long as there is something new to see there."""
    if goal is None or goal not in now.reach or goal == now.map.at or not player.news(now, goal):
        goal = player.frontier(now)
    return (now.walk(goal), goal) if goal != now.map.at else (player.explore(now) or "Noop", None)


def _remember(reading: Reading) -> tuple[Situation, CrafterNotes]:
    """The situation by the memory and by what was seen since; without a memory, by what the window shows."""
    memory = recall(reading)
    seen = [exchange for exchange in memory.since.seen if exchange.text in memory.since.observations]
    if memory.facts is None or not seen:
        now = player.window(reading, Map())
        return now, CrafterNotes(now.map, 0, now.frame.asleep, None)
    notes = notes_of(memory.facts)
    now = player.window(memory.since, notes.map, asleep=notes.asleep)
    # The clock of a line counts the action that it was written with.
    return now, replace(notes, clock=notes.clock + len(seen) - 1)


def _home(now: Situation, notes: CrafterNotes) -> Home | None:
    """The home, or a site for one. It may be without water for a night; without stone, none can be built."""
    night = DUSK <= notes.clock % DAY < DAWN
    home = notes.home
    if home and (has_water(now, home) or (night and now.has("drink"))):
        return home if now.map.at in home.inside or now.has("stone") else None
    if now.lacks("wood_pickaxe") or now.lacks("stone", 3) or now.frame.faced is None or now.frame.asleep:
        return None
    return find_site(now, dry=night and now.has("drink", 4))


def _act(now: Situation, home: Home | None, clock: int) -> str | None:
    if home is None:
        return next((action for wish in PIONEER if (action := wish(now))), None)
    at_home = now.map.at in home.inside
    guarded = replace(now, closed=frozenset(home.walls)) if at_home else now
    urgent, rest = WISHES[:3], WISHES[3:]
    action = next((action for wish in urgent if (action := wish(now))), None)
    return action or dwell(guarded, home, clock) or player.act(guarded, rest)


# --- Before there is a home: only urgent needs ----------------------------------------------------------------------


def flee(now: Situation) -> str | None:
    """Get away from skeletons when health is low."""
    return player.flee(now) if now.lacks("health", 5) else None


def drink(now: Situation) -> str | None:
    """Drink before thirst hurts."""
    thirsty = now.lacks("drink", 4) or (now.lacks("drink", 8) and now.frame.distance("water") <= 2)
    return now.go(now.cells("water")) if thirsty else None


def eat(now: Situation) -> str | None:
    """Eat before hunger hurts, and before settling down, because a garden needs a long time to yield food."""
    near = now.frame.distance("cow") <= 6
    if now.lacks("food", 4) or (near and now.lacks("food", 8)):
        x, y = now.map.at
        return now.go([(x + dx, y + dy) for dx, dy in now.frame.cells("cow")])
    return None


def chop(now: Situation) -> str | None:
    """Gather the wood for a table, a pickaxe and a sword, and for those of stone if trees are close."""
    if now.has("wood", 4) or (now.has("wood_pickaxe") and (now.has("stone_sword") or now.frame.distance("tree") > 4)):
        return None
    return now.go(now.cells("tree")) if "tree" in now.frame.nearest else None


def quarry(now: Situation) -> str | None:
    """Gather stone for walls, and a piece of coal that is close."""
    if now.lacks("wood_pickaxe"):
        return None
    if now.lacks("coal") and now.frame.distance("coal") <= 5 and (action := now.go(now.cells("coal"))):
        return action
    return now.go(now.cells("stone")) if now.lacks("stone", 9) and "stone" in now.frame.nearest else None


PIONEER = (
    player.sleep_on,
    player.come_back,
    player.fight,
    flee,
    drink,
    eat,
    player.craft,
    quarry,
    chop,
)
