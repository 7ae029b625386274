"""The movement of a player as in Minecraft 1.11, tick by tick (50 ms).

It is plain Python on single cells, because a player touches only a few blocks per tick. Health, hunger, breath and
ladders are left out; the cell of its knees decides whether a body is in water. In water it swims up, as if the jump key
were held: with jumps in half of the ticks, as the benchmark has them, it would hover at any depth, where it would drown
in the real game.
"""

from __future__ import annotations

import math
from math import floor

from smartplay_tools.games.minecraft.rules import Stride
from smartplay_tools.games.minecraft.voxel.blocks import SLIPPERY, SOLID, Block
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, HEIGHT, SIDE, VoxelWorld

HALF_WIDTH, TALL, EYES = 0.3, 1.8, 1.62

_WATER = int(Block.WATER)
_GRAVITY, _FALL_DRAG = 0.08, 0.98
_JUMP, _SPRINT_JUMP_PUSH = 0.42, 0.2
_WALK, _IN_AIR, _IN_WATER, _SPRINT = 0.1, 0.02, 0.02, 1.3
_AIR_DRAG, _WATER_DRAG = 0.91, 0.8
_GROUND_DRAG, _ICE_DRAG = 0.6 * _AIR_DRAG, 0.98 * _AIR_DRAG
_ON_GROUND, _ON_ICE = ((drag, _WALK * _GROUND_DRAG**3 / drag**3) for drag in (_GROUND_DRAG, _ICE_DRAG))
"""Drag and push: the push is adapted to the drag, so starting on ice is slow."""
_SWIM_UP, _SINK, _CLIMB_OUT, _CLIMB_REACH = 0.04, 0.02, 0.3, 0.6
_INPUT = 0.98
_TWO_INPUTS = math.sqrt(_INPUT * _INPUT + _INPUT * _INPUT)
_STANDSTILL = 0.003
_SKIN = 1e-7
"""Bodies that touch do not overlap; this tolerance allows for rounding."""


class Walker:
    """A player's body. `x, y, z` are the feet; the world around them has to be generated."""

    def __init__(self, world: VoxelWorld, x: float, y: float, z: float) -> None:
        self.world = world
        self.x, self.y, self.z = x, y, z
        self.vx = self.vy = self.vz = 0.0
        self.grounded = True
        self.sprinting = False

    def tick(self, stride: Stride | None, sine: float, cosine: float) -> None:
        """Move for a tick, with "forward" and the stride's keys held, or with none; `sine, cosine` are the yaw's."""
        vx = 0.0 if -_STANDSTILL < self.vx < _STANDSTILL else self.vx
        vy = 0.0 if -_STANDSTILL < self.vy < _STANDSTILL else self.vy
        vz = 0.0 if -_STANDSTILL < self.vz < _STANDSTILL else self.vz
        flat, column, before = self.world.flat, _column(floor(self.x), floor(self.z)), self.y
        wet, grounded = flat[column + floor(before + 0.4)] == _WATER, self.grounded
        # The keys "jump" and "sprint".
        if stride is None:
            self.sprinting = False
        elif not stride.jump:
            self.sprinting = True
        elif grounded and not wet:
            vy = _JUMP
            if self.sprinting:
                vx -= sine * _SPRINT_JUMP_PUSH
                vz += cosine * _SPRINT_JUMP_PUSH
        # What holds the body, and how much the keys of direction push it there.
        if wet:
            vy += _SWIM_UP
            drag, push = _WATER_DRAG, _IN_WATER
        else:
            if grounded:
                drag, push = _ON_ICE if SLIPPERY[flat[column + floor(before - 1)]] else _ON_GROUND
            else:
                drag, push = _AIR_DRAG, _IN_AIR
            if self.sprinting:
                push *= _SPRINT
        if stride is not None:
            if stride.left:
                push /= _TWO_INPUTS
            left = stride.left * _INPUT
            vx += push * (left * cosine - _INPUT * sine)
            vz += push * (_INPUT * cosine + left * sine)
        stopped = self._move(vx, vy, vz)
        if stopped:
            self.sprinting = False
        self.vx *= drag
        self.vz *= drag
        if wet:
            self.vy = self.vy * _WATER_DRAG - _SINK
            if stopped and self._is_free(self.vx, self.vy + _CLIMB_REACH - self.y + before, self.vz):
                self.vy = _CLIMB_OUT
        else:
            self.vy = (self.vy - _GRAVITY) * _FALL_DRAG

    def _move(self, vx: float, vy: float, vz: float) -> bool:
        """Move by a velocity, stopping at solid blocks: up or down, along x, along z. Return whether a side did.

        The body is in no solid block, and a tick moves it by less than a block along x and z. So blocks can stop it
        only in a row of cells that it enters.
        """
        x, z = self.x, self.z
        west, east, north, south = *_cells(x), *_cells(z)
        wanted = self.y + vy
        self.y = y = self._reach_y(wanted, west, east, north, south)
        self.grounded = y != wanted and vy < 0
        self.vx, self.vy, self.vz = vx, vy if y == wanted else 0.0, vz
        stopped = False
        if vx:
            wanted = x + vx
            first, last = _cells(wanted)
            edge = last if vx > 0 else first
            if not west <= edge <= east and self._is_solid(edge, edge, north, south, *_layers(y)):
                self.x = _beside(edge, x)
                west, east = _cells(self.x)
                if self.x != wanted:
                    self.vx, stopped = 0.0, True
            else:
                self.x, west, east = wanted, first, last
        if vz:
            wanted = z + vz
            edge = floor(wanted + HALF_WIDTH - _SKIN) if vz > 0 else floor(wanted - HALF_WIDTH + _SKIN)
            if not north <= edge <= south and self._is_solid(west, east, edge, edge, *_layers(y)):
                self.z = _beside(edge, z)
                if self.z != wanted:
                    self.vz, stopped = 0.0, True
            else:
                self.z = wanted
        return stopped

    def _reach_y(self, wanted: float, west: int, east: int, north: int, south: int) -> float:
        """The height that is reached in the direction of the wanted one; falls may pass several layers."""
        if wanted < self.y:
            for layer in range(floor(self.y + _SKIN) - 1, floor(wanted) - 1, -1):
                if self._is_solid(west, east, north, south, layer, layer):
                    return layer + 1.0
        else:
            layer = floor(wanted + TALL)
            if self._is_solid(west, east, north, south, layer, layer):
                return max(layer - TALL, self.y)
        return wanted

    def _is_free(self, dx: float, dy: float, dz: float) -> bool:
        """Whether the body, moved by that much, would be in neither blocks nor water."""
        west, east, north, south = *_cells(self.x + dx), *_cells(self.z + dz)
        low, high = _layers(self.y + dy)
        if self._is_solid(west, east, north, south, low, high):
            return False
        columns = [_column(x, z) for x in range(west, east + 1) for z in range(north, south + 1)]
        return all(_WATER not in self.world.flat[column + low : column + high + 1] for column in columns)

    def _is_solid(self, west: int, east: int, north: int, south: int, low: int, high: int) -> bool:
        """Whether there is a solid block among these cells, borders included."""
        flat = self.world.flat
        for x in range(west, east + 1):
            for z in range(north, south + 1):
                column = _column(x, z)
                for cell in range(column + low, column + high + 1):
                    if SOLID[flat[cell]]:
                        return True
        return False


def _cells(middle: float) -> tuple[int, int]:
    """The first and the last cell that a body covers along x or z."""
    return floor(middle - HALF_WIDTH + _SKIN), floor(middle + HALF_WIDTH - _SKIN)


def _layers(feet: float) -> tuple[int, int]:
    """The same along y."""
    return floor(feet + _SKIN), floor(feet + TALL - _SKIN)


def _column(x: int, z: int) -> int:
    """The offset that turns a height into an index of the flat array of blocks."""
    return ((x & (SIDE - 1)) * SIDE + (z & (SIDE - 1))) * HEIGHT - BOTTOM


def _beside(edge: int, here: float) -> float:
    """Where a body stops that is at `here` and would enter the row of cells at `edge`."""
    return max(edge - HALF_WIDTH, here) if edge > here else min(edge + 1 + HALF_WIDTH, here)
