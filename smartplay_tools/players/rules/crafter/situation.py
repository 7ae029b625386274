"""The situation on which a Crafter player decides: its map, the latest frame, and paths between cells."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush

from smartplay_tools.players.rules.crafter.sight import BIT, CERTAIN, DIRECTIONS, WALKABLE, Cell, Frame, Map

FAR = 99
"""A cost that is higher than that of any path."""


@dataclass(frozen=True)
class Situation:
    """The map, the latest frame and the action that led to it."""

    map: Map
    frame: Frame
    last: str | None
    closed: frozenset[Cell] = frozenset()
    """Cells that must be neither stepped on nor dug."""

    def has(self, item: str, amount: int = 1) -> bool:
        """Whether the player has at least this amount of a vital or an item."""
        return self.frame.amounts.get(item, 0) >= amount

    def lacks(self, item: str, amount: int = 1) -> bool:
        """Whether the player has less than this amount."""
        return not self.has(item, amount)

    def kinds(self, cell: Cell) -> int:
        """The kinds that a cell may contain; none outside the map that was seen."""
        return self.map.kinds.get(cell, 0)

    def cells(self, kind: str) -> list[Cell]:
        """The cells that certainly contain a kind or, if there are none, those that may contain the nearest."""
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
        """The cost of stepping on a cell, including digging; `FAR` if that is impossible or not allowed."""
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
        """The next action on the path to a cell that can be reached; obstacles on it are dug out."""
        cell = goal
        while (before := self.reach[cell][1]) not in (None, self.map.at):
            assert before is not None
            cell = before
        move = direction(self.map.at, cell)
        solid = not self.kinds(cell) & WALKABLE
        return "Do" if solid and self.map.facing == move else move

    def chance(self, sides: int) -> int:
        """A pseudorandom number below `sides` that depends on the observation, since the player has no random state."""
        text = f"{sorted(self.frame.nearest.items())}{sorted(self.frame.amounts.items())}"
        return zlib.crc32(text.encode()) % sides


def neighbours(cell: Cell) -> list[Cell]:
    """The four cells around a cell."""
    x, y = cell
    return [(x + dx, y + dy) for dx, dy in DIRECTIONS.values()]


def direction(start: Cell, target: Cell) -> str:
    """The move from a cell to one beside it."""
    offset = target[0] - start[0], target[1] - start[1]
    return next(move for move, step in DIRECTIONS.items() if step == offset)
