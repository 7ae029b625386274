"""Crafter: stay alive, and unlock what comes along - from what the window shows.

The score adds up the unlocked achievements at every step, so a player that lives long wins. The rules stand in order
of urgency in `WISHES`: each is a function of the situation that gives an action, or None to leave it to the next.
Whatever time it is and whatever was done before the window is not known; the inventory and the vitals stand in for it.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush

from smartplay_tools.messages import Message
from smartplay_tools.players.reading import Reading, call
from smartplay_tools.players.rules.crafter_sight import (
    ANY,
    BIT,
    CERTAIN,
    DIRECTIONS,
    WALKABLE,
    Cell,
    Frame,
    Map,
    read_frame,
)

OPPOSITE = {"Move West": "Move East", "Move East": "Move West", "Move North": "Move South", "Move South": "Move North"}
SOLID = ANY & ~WALKABLE & ~BIT["lava"]
"""What nothing can walk through, and that does not kill."""
MINED_WITH = {"stone": "wood_pickaxe", "coal": "wood_pickaxe", "iron": "stone_pickaxe", "diamond": "iron_pickaxe"}
FAR = 99


def plays(reading: Reading) -> bool:
    """Whether the actions are Crafter's."""
    return {"Place Plant", "Make Iron Sword"} <= set(reading.actions)


def decide(reading: Reading) -> Message:
    """Look once if nothing is visible; else act on the map that the visible frames make."""
    if not reading.observations:
        return call("observe")
    return call("act", action=act(window(reading)))


def window(reading: Reading) -> Situation:
    """The situation as far as the visible frames tell."""
    known, before, last = Map(), None, None
    for seen in reading.seen:
        if seen.text not in reading.observations:
            continue
        frame = read_frame(seen.text)
        known.add(seen.action, before is not None and before.asleep, frame)
        before, last = frame, seen.action
    assert before is not None
    return Situation(known, before, last)


@dataclass(frozen=True)
class Situation:
    """The map, the latest frame and the action that led to it."""

    map: Map
    frame: Frame
    last: str | None
    closed: frozenset[Cell] = frozenset()
    """Cells that must not be stepped on nor dug."""

    def has(self, item: str, amount: int = 1) -> bool:
        """Whether there is so much of a vital or an item."""
        return self.frame.amounts.get(item, 0) >= amount

    def lacks(self, item: str, amount: int = 1) -> bool:
        """Whether there is less."""
        return not self.has(item, amount)

    def kinds(self, cell: Cell) -> int:
        """What a cell may hold; nothing that is known outside the map that was seen."""
        return self.map.kinds.get(cell, 0)

    def cells(self, kind: str) -> list[Cell]:
        """The cells that hold a kind for certain or, if there are none, those that may hold the nearest."""
        bit = BIT[kind]
        sure = [cell for cell, kinds in self.map.kinds.items() if kinds == bit]
        x, y = self.map.at
        return sure or [(x + dx, y + dy) for dx, dy in self.frame.cells(kind)]

    @cached_property
    def reach(self) -> dict[Cell, tuple[int, Cell | None]]:
        """Cells that can be walked to: cell -> (cost, the cell before it). Doubtful ground costs more."""
        costs: dict[Cell, tuple[int, Cell | None]] = {self.map.at: (0, None)}
        queue = [(0, self.map.at)]
        while queue:
            cost, cell = heappop(queue)
            if cost > costs[cell][0]:
                continue
            for beside in neighbours(cell):
                step = self.step_cost(beside)
                if step < FAR and cost + step < costs.get(beside, (FAR, None))[0]:
                    costs[beside] = cost + step, cell
                    heappush(queue, (cost + step, beside))
        return costs

    def step_cost(self, cell: Cell) -> int:
        """What it costs to step on a cell, digging included; `FAR` if it cannot be done or must not."""
        kinds, creature = self.kinds(cell), self.map.creatures.get(cell, 0)
        if creature & CERTAIN or kinds & BIT["lava"] or cell in self.closed:
            return FAR
        danger = 4 if creature & (BIT["zombie"] | BIT["skeleton"]) else 0
        if kinds and not kinds & ~WALKABLE:
            return 1 + danger
        if kinds & WALKABLE:
            return 3 + danger
        if kinds & BIT["stone"] and self.has("wood_pickaxe"):
            return 3
        return FAR

    def go(self, targets: Iterable[Cell], action: str = "Do") -> str | None:
        """Walk next to the best of the targets, turn to it and act on it."""
        best, goal, target = FAR, None, None
        for candidate in targets:
            for beside in neighbours(candidate):
                cost = self.reach.get(beside, (FAR, None))[0]
                if cost < best:
                    best, goal, target = cost, beside, candidate
        if goal is None or target is None:
            return None
        if goal == self.map.at:
            turn = direction(self.map.at, target)
            return action if self.map.facing == turn else turn
        return self.walk(goal)

    def walk(self, goal: Cell) -> str:
        """The next action on the way to a cell that can be reached; what is in the way is dug out."""
        cell = goal
        while (before := self.reach[cell][1]) not in (None, self.map.at):
            assert before is not None
            cell = before
        move = direction(self.map.at, cell)
        solid = not self.kinds(cell) & WALKABLE
        return "Do" if solid and self.map.facing == move else move

    def chance(self, sides: int) -> int:
        """A number below `sides` that changes with what is seen: dice for a player without any."""
        told = f"{sorted(self.frame.nearest.items())}{sorted(self.frame.amounts.items())}"
        return zlib.crc32(told.encode()) % sides


def neighbours(cell: Cell) -> list[Cell]:
    """The four cells around a cell."""
    x, y = cell
    return [(x + dx, y + dy) for dx, dy in DIRECTIONS.values()]


def direction(start: Cell, target: Cell) -> str:
    """The move from a cell to one beside it."""
    offset = target[0] - start[0], target[1] - start[1]
    return next(move for move, step in DIRECTIONS.items() if step == offset)


# --- What the player wants, most urgent first ------------------------------------------------------------------------

Wish = Callable[[Situation], str | None]


def sleep_on(now: Situation) -> str | None:
    """Asleep, nothing else can be done."""
    return "Noop" if now.frame.asleep else None


def come_back(now: Situation) -> str | None:
    """Too near to the border nothing can be seen: turn round."""
    if now.frame.faced is not None:
        return None
    moves = [move for move in DIRECTIONS if now.last == move]
    return OPPOSITE[moves[0]] if moves and now.chance(2) else ("Move East", "Move South")[now.chance(2)]


def fight(now: Situation) -> str | None:
    """Strike what is in reach."""
    x, y = now.map.at
    for kind in ("zombie", "skeleton"):
        if now.frame.distance(kind) == 1:
            dx, dy = now.frame.cells(kind)[0]
            turn = direction((x, y), (x + dx, y + dy))
            return "Do" if now.frame.faced == kind else turn
    return None


def drink(now: Situation) -> str | None:
    """Drink when thirsty, and fill up when at the water."""
    near = now.frame.distance("water")
    if now.lacks("drink", 5) or (now.lacks("drink", 9) and near <= 2):
        return now.go(now.cells("water"))
    return None


def eat(now: Situation) -> str | None:
    """Eat when hungry."""
    if now.lacks("food", 6) or (now.lacks("food", 8) and now.frame.distance("cow") <= 3):
        x, y = now.map.at
        return now.go([(x + dx, y + dy) for dx, dy in now.frame.cells("cow")])
    return None


def plant(now: Situation) -> str | None:
    """Plant saplings; look for one at the very beginning, as long as nobody is hungry or thirsty."""
    if now.frame.faced != "grass":
        return None
    if now.has("sapling"):
        return "Place Plant"
    beginning = now.has("food", 9) and now.has("drink", 9) and now.lacks("wood")
    return "Do" if beginning and "plant" not in now.frame.nearest else None


def craft(now: Situation) -> str | None:
    """Make what can be made, and put up a table or a furnace where that lets more be made."""
    near = {kind for kind in ("table", "furnace") if any(now.kinds(c) == BIT[kind] for c in around(now.map.at))}
    ores = now.has("coal") and now.has("iron")
    if "table" in near:
        for tool, needs in TOOLS.items():
            if now.lacks(tool) and all(now.has(item) for item in needs) and ("iron" not in needs or "furnace" in near):
                return "Make " + tool.replace("_", " ").title()
    place = now.frame.faced in ("grass", "sand", "path")
    if not place:
        return None
    first = now.lacks("wood_pickaxe") and now.has("wood", 4)
    second = now.has("wood_pickaxe") and now.lacks("stone_sword") and now.has("wood", 4) and now.has("stone", 2)
    third = now.has("stone_pickaxe") and now.lacks("iron_sword") and now.has("wood", 3) and ores
    if "table" not in near and (first or second or third):
        return "Place Table"
    if "table" in near and "furnace" not in now.frame.nearest and now.has("stone", 4) and now.has("stone_sword"):
        return "Place Furnace"
    return None


TOOLS = {
    "iron_pickaxe": ("wood", "coal", "iron"),
    "iron_sword": ("wood", "coal", "iron"),
    "wood_pickaxe": ("wood",),
    "wood_sword": ("wood",),
    "stone_pickaxe": ("wood", "stone"),
    "stone_sword": ("wood", "stone"),
}


def around(cell: Cell) -> list[Cell]:
    """The eight cells around a cell."""
    x, y = cell
    return [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


def mine(now: Situation) -> str | None:
    """Gather what is in view and of use."""
    wanted = {"diamond": 1, "iron": 2, "coal": 2, "stone": 9}
    for kind, amount in wanted.items():
        if now.lacks(kind, amount) and now.has(MINED_WITH[kind]) and kind in now.frame.nearest:
            action = now.go(now.cells(kind))
            if action:
                return action
    return None


def chop(now: Situation) -> str | None:
    """Gather wood: for a table and the first tools, then for those of stone and of iron."""
    wanted = 5 if now.lacks("wood_pickaxe") else 6
    if now.lacks("wood", wanted) and "tree" in now.frame.nearest:
        return now.go(now.cells("tree"))
    return None


def nap(now: Situation) -> str | None:
    """Sleep when tired and nothing dangerous is in sight."""
    dangerous = {"zombie", "skeleton"} & now.frame.nearest.keys()
    if not dangerous and (now.lacks("energy", 3) or (now.lacks("energy", 9) and now.lacks("stone_pickaxe"))):
        return "Sleep"
    return None


def flee(now: Situation) -> str | None:
    """Get away from skeletons and out of the way of arrows."""
    if now.frame.distance("skeleton") > 5 and now.frame.distance("arrow") > 3:
        return None
    x, y = now.map.at
    shooters = [(x + dx, y + dy) for kind in ("skeleton", "arrow") for dx, dy in now.frame.cells(kind)]

    def safety(cell: Cell) -> int:
        away = min(abs(cell[0] - sx) + abs(cell[1] - sy) for sx, sy in shooters)
        in_line = any(cell[0] == sx or cell[1] == sy for sx, sy in shooters)
        return 2 * away - 3 * in_line - now.reach[cell][0]

    safest = max(now.reach, key=safety)
    return None if safest == now.map.at else now.walk(safest)


def explore(now: Situation) -> str | None:
    """Go where there is something new to see."""
    goal = frontier(now)
    return now.walk(goal) if goal != now.map.at else list(DIRECTIONS)[now.chance(4)]


def frontier(now: Situation) -> Cell:
    """Where most that is new will come into view, rather straight on, and not where the player has been lately."""
    x, y = now.map.at
    dx, dy = DIRECTIONS.get(now.map.facing or "", (0, 0))

    def worth(cell: Cell) -> int:
        old = min(abs(cell[0] - vx) + abs(cell[1] - vy) for vx, vy in now.map.visited)
        return 4 * news(now, cell) + old + (cell[0] - x) * dx + (cell[1] - y) * dy - now.reach[cell][0]

    return max(now.reach, key=worth)


def news(now: Situation, cell: Cell) -> int:
    """How much of the view from a cell has not been seen yet."""
    return sum((cell[0] + dx, cell[1] + dy) not in now.map.kinds for dx, dy in SAMPLE)


SAMPLE = tuple((x, y) for x in (-4, -2, 0, 2, 4) for y in (-3, 0, 3))
"""Some cells of a view, enough to judge how much of it is new."""


WISHES: tuple[Wish, ...] = (sleep_on, come_back, fight, flee, drink, eat, plant, craft, nap, chop, mine, explore)


def act(now: Situation, wishes: tuple[Wish, ...] = WISHES) -> str:
    """The most urgent action."""
    return next(action for wish in wishes if (action := wish(now)))
