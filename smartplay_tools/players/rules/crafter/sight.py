"""The parser of Crafter's observations (frames), and the map that is inferred from them.

A frame lists only the nearest thing of each kind, with distance and direction. It still says much about every cell in
view: a kind that is not listed is not in view, and a listed kind is nowhere nearer. Each cell therefore has the set of
kinds that it may contain. The set shrinks with every frame that shows the cell, so most kinds are soon known.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

Cell = tuple[int, int]
DIRECTIONS: dict[str, Cell] = {"Move West": (-1, 0), "Move North": (0, -1), "Move South": (0, 1), "Move East": (1, 0)}

MATERIALS = (
    "water", "grass", "stone", "path", "sand", "tree", "lava", "coal", "iron", "diamond", "table", "furnace", "plant"
)  # fmt: skip
CREATURES = ("cow", "zombie", "skeleton", "arrow")
BIT = {name: 1 << number for number, name in enumerate((*MATERIALS, *CREATURES))}
ANY = sum(BIT[name] for name in MATERIALS)
WALKABLE = BIT["grass"] | BIT["sand"] | BIT["path"]
REMEMBERED = 30
"""The number of latest places that are kept."""
OUTSIDE = 1 << 20
"""Marks a cell that is too near to the border for the player to see anything."""

# The view, nearest cell first; of cells at the same distance the text names western before eastern, then northern.
COLUMNS, ROWS = 4, 3
VIEW: tuple[Cell, ...] = tuple(
    sorted(
        ((x, y) for x in range(-COLUMNS, COLUMNS + 1) for y in range(-ROWS, ROWS + 1) if (x, y) != (0, 0)),
        key=lambda cell: (abs(cell[0]) + abs(cell[1]), cell),
    )
)

SEEN = re.compile(r"^- (\w+) (\d+) steps to your (north|south)?-?(west|east)?$", re.MULTILINE)
FACED = re.compile(r"^You face (\w+) at your front\.$", re.MULTILINE)
AMOUNT = re.compile(r"^- (\w+): (\d+)", re.MULTILINE)


def _sign(word: str, negative: str) -> int:
    return 0 if not word else -1 if word == negative else 1


def _named(cell: Cell) -> tuple[int, int, int]:
    """The distance and the direction by which the text names a cell of the view."""
    x, y = cell
    return abs(x) + abs(y), (x > 0) - (x < 0), (y > 0) - (y < 0)


CANDIDATES = {named: tuple(cell for cell in VIEW if _named(cell) == named) for named in map(_named, VIEW)}
"""The cells of the view that a distance and a direction can mean, in the order in which the text names them."""
RANK = {cell: rank for rank, cell in enumerate(VIEW)}


@dataclass(frozen=True)
class Frame:
    """One observation."""

    nearest: dict[str, tuple[int, int, int]]
    """Kind -> distance and the signs of the direction."""
    faced: str | None
    """What is in front; None if the player could not see, because it was too near to the border."""
    amounts: dict[str, int]
    """Vitals and items."""
    asleep: bool

    def distance(self, kind: str) -> int:
        """Steps to the nearest of a kind; 99 if none is in view."""
        return self.nearest[kind][0] if kind in self.nearest else 99

    def cells(self, kind: str) -> tuple[Cell, ...]:
        """Where the nearest of a kind may be, relative to the player."""
        return CANDIDATES.get(self.nearest[kind], ()) if kind in self.nearest else ()


def read_frame(text: str) -> Frame:
    """Parse an observation."""
    faced = FACED.search(text)
    nearest = {
        kind: (int(steps), _sign(across, "west"), _sign(down, "north"))
        for kind, steps, down, across in SEEN.findall(text)
    }
    amounts = {name: int(amount) for name, amount in AMOUNT.findall(text)}
    return Frame(nearest, faced[1] if faced else None, amounts, "You are sleeping" in text)


@dataclass
class Map:
    """What is known of the world, relative to the player's place at the first frame.

    Attributes:
        at, facing: the player's cell, and the move in the direction that it faces; None if that is not known.
        kinds: cell -> the kinds of material that it may hold, as bits.
        creatures: cell -> the creatures that may be there, in the latest frame.
        visited: where the player has been lately, oldest first.
    """

    at: Cell = (0, 0)
    facing: str | None = None
    kinds: dict[Cell, int] = field(default_factory=dict)
    creatures: dict[Cell, int] = field(default_factory=dict)
    visited: list[Cell] = field(default_factory=list)

    def add(self, action: str | None, asleep: bool, frame: Frame) -> None:
        """Update the map with an action and the frame that followed it; in sleep, an action does nothing."""
        if action in DIRECTIONS and not asleep:
            self.facing = action
            if self._has_moved(action, frame):
                self.at = self.ahead(action)
        self.visited = [*self.visited[1 - REMEMBERED :], self.at]
        if frame.faced is None:
            self.creatures, self.kinds[self.at] = {}, OUTSIDE
            return
        self._look(frame)

    def ahead(self, action: str, steps: int = 1) -> Cell:
        """The cell that is `steps` steps away in the direction of a move."""
        dx, dy = DIRECTIONS[action]
        return self.at[0] + dx * steps, self.at[1] + dy * steps

    def _has_moved(self, action: str, frame: Frame) -> bool:
        """Whether a move changed the place, judged by what was known of its target, or else by the new frame."""
        target = self.ahead(action)
        kinds = self.kinds.get(target, ANY)
        if self.creatures.get(target, 0) and target in self._certain:
            return False
        if not kinds & (WALKABLE | BIT["lava"] | OUTSIDE):
            return False
        if frame.faced is None or not kinds & ~(WALKABLE | OUTSIDE):
            return True
        possible = _possible(frame)
        stayed, moved = (self._conflicts(at, possible) for at in (self.at, target))
        return moved < stayed if moved != stayed else bool(BIT.get(frame.faced, 0) & WALKABLE)

    @property
    def _certain(self) -> set[Cell]:
        return {cell for cell, bits in self.creatures.items() if bits & CERTAIN}

    def _conflicts(self, at: Cell, possible: list[int]) -> int:
        conflicts = 0
        for (dx, dy), kinds in zip(VIEW, possible, strict=True):
            mapped = self.kinds.get((at[0] + dx, at[1] + dy), ANY)
            conflicts += not mapped & kinds and not kinds & ~ANY
        return conflicts

    def _look(self, frame: Frame) -> None:
        x, y = self.at
        for (dx, dy), possible in zip(VIEW, _possible(frame), strict=True):
            cell = (x + dx, y + dy)
            seen = possible & ANY
            self.kinds[cell] = (self.kinds.get(cell, ANY) & seen) or seen or ANY
        self.kinds[self.at] = (self.kinds.get(self.at, WALKABLE) & WALKABLE) or WALKABLE
        self.creatures = {}
        for kind in frame.nearest:
            self._locate(kind, [(x + dx, y + dy) for dx, dy in frame.cells(kind)])
        if frame.faced in BIT and self.facing:
            self._locate(frame.faced, [self.ahead(self.facing)])

    def _locate(self, kind: str, cells: list[Cell]) -> None:
        """Record that one of the cells contains a kind."""
        bit = BIT.get(kind, 0)
        if kind in CREATURES:
            for cell in cells:
                self.creatures[cell] = self.creatures.get(cell, 0) | bit | (CERTAIN if len(cells) == 1 else 0)
            return
        fitting = [cell for cell in cells if self.kinds.get(cell, ANY) & bit]
        if len(cells) == 1 or len(fitting) == 1:
            self.kinds[(fitting or cells)[0]] = bit


CERTAIN = 1 << 21
"""Marks a creature whose cell is known."""


def _possible(frame: Frame) -> list[int]:
    """The kinds that each cell of the view may contain, in the order of the view."""
    begins: dict[int, int] = {}
    for kind, where in frame.nearest.items():
        if cells := CANDIDATES.get(where):
            rank = RANK[cells[0]]
            begins[rank] = begins.get(rank, 0) | BIT.get(kind, 0)
    kinds, possible = 0, []
    for rank in range(len(VIEW)):
        kinds |= begins.get(rank, 0)
        possible.append(kinds)
    return possible
