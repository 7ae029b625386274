"""Rules for Crafter that use only the window: stay alive, and unlock achievements on the way.

The score adds up the unlocked achievements at every step, so surviving matters most. `WISHES` has the rules in order of
urgency: each is a function of the situation that returns an action, or None to leave the decision to the next. The
player does not know the time or what it did before the window; it infers this from the inventory and the vitals.
"""

from __future__ import annotations

from collections.abc import Callable

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.crafter.sight import ANY, BIT, DIRECTIONS, WALKABLE, Cell, Map, read_frame
from smartplay_tools.players.rules.crafter.situation import Situation, direction
from smartplay_tools.types.messages import Message

OPPOSITE = {"Move West": "Move East", "Move East": "Move West", "Move North": "Move South", "Move South": "Move North"}
SOLID = ANY & ~WALKABLE & ~BIT["lava"]
"""Materials that nothing can walk through, except those that kill."""
MINED_WITH = {"stone": "wood_pickaxe", "coal": "wood_pickaxe", "iron": "stone_pickaxe", "diamond": "iron_pickaxe"}


def plays(reading: Reading) -> bool:
    """Whether the actions are Crafter's."""
    return {"Place Plant", "Make Iron Sword"} <= set(reading.actions)


def decide(reading: Reading) -> Message:
    """Observe if nothing is visible, or else act on the map made from the visible observations."""
    if not reading.observations:
        return call("observe")
    return call("act", action=act(window(reading, Map())))


def window(reading: Reading, own_map: Map, *, asleep: bool = False) -> Situation:
    """The situation after the visible observations, of which there is one at least; they are added to the map."""
    for seen in reading.seen:
        if seen.text in reading.observations:
            frame, last = read_frame(seen.text), seen.action
            own_map.add(last, asleep, frame)
            asleep = frame.asleep
    return Situation(own_map, frame, last)


# --- The rules, most urgent first ------------------------------------------------------------------------------------

Wish = Callable[[Situation], str | None]


def sleep_on(now: Situation) -> str | None:
    """Continue to sleep, since nothing else is possible in sleep."""
    return "Noop" if now.frame.asleep else None


def come_back(now: Situation) -> str | None:
    """Go back from the border if it is so near that nothing can be seen."""
    if now.frame.faced is not None:
        return None
    seen = [cell for cell in now.reach if cell != now.map.at]
    if seen:
        return now.walk(min(seen, key=lambda cell: now.reach[cell][0]))
    return OPPOSITE.get(now.last or "", "Move East")


def fight(now: Situation) -> str | None:
    """Strike a creature in reach."""
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
    """Plant saplings; search for one at the very beginning, unless hungry or thirsty."""
    if now.frame.faced != "grass":
        return None
    if now.has("sapling"):
        return "Place Plant"
    beginning = now.has("food", 9) and now.has("drink", 9) and now.lacks("wood")
    return "Do" if beginning and "plant" not in now.frame.nearest else None


def craft(now: Situation) -> str | None:
    """Make tools, and place a table or a furnace if that allows more tools to be made."""
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
    """Gather useful materials in view."""
    wanted = {"diamond": 1, "iron": 2, "coal": 2, "stone": 9}
    for kind, amount in wanted.items():
        if now.lacks(kind, amount) and now.has(MINED_WITH[kind]) and kind in now.frame.nearest:
            action = now.go(now.cells(kind))
            if action:
                return action
    return None


def chop(now: Situation) -> str | None:
    """Gather wood for a table and the first tools, then for those of stone and of iron."""
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
    """Go to where something new can be seen."""
    goal = frontier(now)
    return now.walk(goal) if goal != now.map.at else list(DIRECTIONS)[now.chance(4)]


def frontier(now: Situation) -> Cell:
    """The cell with the most new cells in view, preferably straight ahead and not recently visited."""
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
"""A sample of the cells of a view, from which the share of new cells is estimated."""


WISHES: tuple[Wish, ...] = (sleep_on, come_back, fight, flee, drink, eat, plant, craft, nap, chop, mine, explore)


def act(now: Situation, wishes: tuple[Wish, ...] = WISHES) -> str:
    """The most urgent action."""
    return next(action for wish in wishes if (action := wish(now)))
