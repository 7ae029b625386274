"""The rules: which entity has which role, where everything starts, and what one tick does.

The original runs levels 2 and 3 on a board of pixels, two to a cell. This matters: movers go half a cell on every tick,
and things touch as soon as their squares overlap, so a contact can happen at half a cell's distance or diagonally. All
places here are therefore in half cells, x to the east and y to the south; the observation shows them halved, as cells.
Level 1 has no movers and uses whole cells.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

from numpy.random import Generator

Split = Literal["train", "val", "test"]
Movement = Literal["chaser", "fleeing", "immovable"]
Place = tuple[int, int]
"""Half cells to the east and to the south, each 0 to `LAST`."""

SPLITS: tuple[Split, ...] = ("train", "val", "test")
MOVEMENTS: tuple[Movement, ...] = ("chaser", "fleeing", "immovable")
LAST = 18

ENTITIES = (
    "airplane", "mage", "dog", "bird", "fish", "scientist", "thief", "ship", "ball", "robot", "queen", "sword",
)  # fmt: skip
"""Every entity, in the order in which observations list them."""

ENEMY, MESSAGE, GOAL, DECOY_MESSAGE, DECOY_GOAL = range(5)
"""The roles, as indices. The decoys of level 3 carry the names of message and goal and are enemies."""

DIRECTIONS: tuple[Place, ...] = ((0, -1), (0, 1), (-1, 0), (1, 0))
"""North, south, west and east: the order of the actions. The fifth action is to stay."""

STAY = (0, 0)

T = TypeVar("T")


# Games: which entities are enemy, message and goal. The splits share no (entity, role) pair with train.


class Game(NamedTuple):
    """The entities of an episode."""

    enemy: str
    message: str
    goal: str


def _cube() -> tuple[tuple[Game, ...], tuple[Game, ...]]:
    """Return the games of val and of test: the two halves of a cube, divided by the parity of three bits."""
    enemies, messages = ("airplane", "scientist", "bird", "mage"), ("robot", "dog", "queen", "sword")
    goals = ("ship", "fish", "thief", "ball")
    halves: tuple[list[Game], list[Game]] = ([], [])
    for e, m, g in itertools.product(range(4), repeat=3):
        in_test = ((e < 2) == (m < 2)) == (g < 2)
        halves[in_test].append(Game(enemies[e], messages[m], goals[g]))
    return tuple(halves[False]), tuple(halves[True])


def _train() -> tuple[Game, ...]:
    enemies, messages = ("robot", "ship", "queen", "thief"), ("airplane", "ship", "scientist", "thief")
    goals = ("airplane", "robot", "scientist", "queen")
    mixed = (Game(*names) for names in itertools.product(enemies, messages, goals) if len(set(names)) == 3)
    # Entities that always have the same role, as in the original's `train_single_comb`.
    single = (
        Game("dog", "fish", "bird"),
        Game("fish", "bird", "dog"),
        Game("sword", "ball", "mage"),
        Game("ball", "mage", "sword"),
    )
    return (*mixed, *single)


_VAL, _TEST = _cube()
GAMES: dict[Split, tuple[Game, ...]] = {"train": _train(), "val": _VAL, "test": _TEST}


# Starts.


@dataclass(frozen=True, slots=True)
class State:
    """The whole state of an episode, on which the rules depend.

    `places` and `movements` are by role; a removed thing has the place None, and so has an avatar that died.
    """

    places: tuple[Place | None, ...]
    movements: tuple[Movement, ...]
    avatar: Place | None
    has_message: bool = False


_LEVEL_1_CENTRE, _LEVEL_1_SLOTS = (10, 10), ((10, 6), (6, 10), (14, 10), (10, 14))
_LEVEL_2_SLOTS = ((4, 4), (14, 4), (4, 14), (14, 14))
_LEVEL_3_SLOTS = ((4, 2), (16, 2), (10, 8), (2, 12), (18, 12), (10, 18))

LEVEL_1_STARTS_WITH_MESSAGE = 0.2

MOVEMENT_VARIANTS: dict[int, tuple[tuple[Movement, ...], ...]] = {
    1: (("immovable",) * 3,),
    2: tuple(itertools.product(MOVEMENTS, repeat=3)),
    # Two things of one name always move differently, and so do the two decoys.
    3: tuple(
        (*real, decoy_message, decoy_goal)
        for real in itertools.permutations(MOVEMENTS)
        for decoy_message, decoy_goal in itertools.permutations(MOVEMENTS, 2)
        if decoy_message != real[MESSAGE] and decoy_goal != real[GOAL]
    ),
}
"""The equally likely movements of each level, by role."""


def pick(items: Sequence[T], chance: Generator) -> T:
    """Draw one of the items, all equally likely."""
    return items[int(chance.random() * len(items))]


def shuffled(items: Sequence[T], chance: Generator) -> list[T]:
    """Return the items in random order."""
    pool = list(items)
    return [pool.pop(int(chance.random() * len(pool))) for _ in items]


def start(level: int, chance: Generator) -> State:
    """Draw the places and movements at the start."""
    movements = pick(MOVEMENT_VARIANTS[level], chance)
    if level == 1:
        with_message = bool(chance.random() < LEVEL_1_STARTS_WITH_MESSAGE)
        places = shuffled(_LEVEL_1_SLOTS, chance)[:3]  # the fourth slot stays empty
        return State(tuple(places), movements, _LEVEL_1_CENTRE, with_message)
    *places, avatar = shuffled(_LEVEL_2_SLOTS if level == 2 else _LEVEL_3_SLOTS, chance)
    return State(tuple(places), movements, avatar)


# One tick.


class StepOutcome(NamedTuple):
    """The result of a tick."""

    state: State
    reward: float
    ended: bool


def is_over(state: State) -> bool:
    """Whether the avatar is dead or the goal reached; in levels 2 and 3 nothing moves afterwards."""
    return state.avatar is None or state.places[GOAL] is None


def choices(movement: Movement, place: Place | None, avatar: Place) -> tuple[Place, ...]:
    """Return the steps among which a mover draws, all equally likely.

    A chaser comes nearer, a fleeing thing goes farther (in Manhattan distance; the border is ignored). A chaser at the
    avatar's place cannot come nearer and may go anywhere.
    """
    if movement == "immovable" or place is None:
        return (STAY,)
    east, south = avatar[0] - place[0], avatar[1] - place[1]
    nearer = tuple((x, y) for x, y in DIRECTIONS if x * east > 0 or y * south > 0)
    if movement == "chaser":
        return nearer or DIRECTIONS
    return tuple(direction for direction in DIRECTIONS if direction not in nearer)


def step(state: State, action: int, chance: Generator) -> StepOutcome:
    """Play one tick of level 2 or 3."""
    if is_over(state):
        return StepOutcome(state, 0.0, True)
    assert state.avatar is not None
    steps = []
    for movement, place in zip(state.movements, state.places, strict=True):
        open_to = choices(movement, place, state.avatar)
        steps.append(open_to[0] if len(open_to) == 1 else pick(open_to, chance))
    return settle(state, action, steps)


def settle(state: State, action: int, steps: Sequence[Place]) -> StepOutcome:
    """Move everything, each mover by its step, and then evaluate the contacts at the new places.

    The order of the contacts is the original's: enemies first, so death comes before success, and each adds its -1
    even if the avatar is already dead.
    """
    assert state.avatar is not None
    avatar = _moved(state.avatar, _AVATAR_STEPS[action])
    places = [
        place if step == STAY or place is None else _moved(place, step)
        for place, step in zip(state.places, steps, strict=True)
    ]
    touching = [place is not None and _overlap(place, avatar) for place in places]
    has_message = state.has_message
    reward = float(-touching[ENEMY] - sum(touching[DECOY_MESSAGE:]))
    alive = reward == 0
    if alive and not has_message and touching[GOAL]:
        reward, alive = -1.0, False
    if touching[MESSAGE]:
        if alive and not has_message:
            reward, has_message = 0.5, True
        places[MESSAGE] = None  # removed, even if the avatar died
    if alive and touching[GOAL]:
        reward += 1.0
        places[GOAL] = None
    after = State(tuple(places), state.movements, avatar if alive else None, has_message)
    return StepOutcome(after, reward, is_over(after))


def step_level_1(state: State, action: int) -> StepOutcome:
    """Play one tick of level 1: one contact decides the episode.

    An avatar without the message wins at the message, and loses at the goal; with it, the avatar wins at the goal.
    Nothing is ever removed, and a step after the end is evaluated again.
    """
    assert state.avatar is not None
    avatar = _moved(state.avatar, _AVATAR_STEPS[action])
    after = State(state.places, state.movements, avatar, state.has_message)
    if avatar not in state.places:
        return StepOutcome(after, 0.0, False)
    aim = GOAL if state.has_message else MESSAGE
    return StepOutcome(after, 1.0 if avatar == state.places[aim] else -1.0, True)


_AVATAR_STEPS = (*((2 * x, 2 * y) for x, y in DIRECTIONS), STAY)


def _moved(place: Place, step: Place) -> Place:
    """Return the place after a step; a step that would leave the board has no effect."""
    x, y = place[0] + step[0], place[1] + step[1]
    return (x, y) if 0 <= x <= LAST and 0 <= y <= LAST else place


def _overlap(one: Place, other: Place) -> bool:
    """Whether two squares of two half cells overlap."""
    return abs(one[0] - other[0]) <= 1 and abs(one[1] - other[1]) <= 1
