"""Rules for MESSENGER: read the roles, infer the places of everything from the visible steps, and simulate each action.

A decision has five steps: `board` parses observations, `manual` parses sentences, `casts` computes their possible
meanings, `belief` the possible places, and this module the value of each action. `board` also has the tables of the
geometry for the last two.

All knowledge about the episode comes from the visible messages, which are the manual and at most four observations, so
the player infers its own place again at every step. What a narrow window does not show of these four observations,
`remember` keeps in a memory. The player also has knowledge that can be gained from playing the training
split: how things move and touch, that borders stop them, and the regularities of the games (in `casts` and `belief`).
It does not use the starting places of games.

The value of an action is found by simulating every case further: only the first action is ours. A greedy player that
knows the state then goes straight to the target and around everything that kills. It
knows more than we do, so its result is an upper bound, but the bound is about equally loose for every action, and it
accounts for chasers, borders and corners many steps ahead. All simulations run at once, as arrays.

The weights below were chosen by playing seeds from 1000 on; the player is scored on the seeds below 200.
"""

from __future__ import annotations

import functools
import random
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.memory import fits, line, recall
from smartplay_tools.players.rules.messenger.belief import GOAL, MESSAGE, Cases, believe
from smartplay_tools.players.rules.messenger.board import (
    ACTIONS,
    CHASER,
    DRAWS,
    IMMOVABLE,
    MOVEMENTS,
    NOWHERE,
    OFFSETS,
    SHIFT,
    Floats,
    Ints,
    SeenEntities,
    board,
    offsets,
)
from smartplay_tools.players.rules.messenger.casts import FEW_SENTENCES, Cast, Part, casts
from smartplay_tools.players.rules.messenger.manual import Claim, claims
from smartplay_tools.types.messages import Message

HORIZON = 24
"""The most ticks that are simulated."""
DISCOUNT = 0.97
DEATH = -1.5
"""The value of being caught; winning has the value 1."""
AHEAD = {False: 0.5, True: 0.75}
"""The value of a simulation that is not over at the horizon, without and with the message ..."""
FAR = 0.012
"""... less this for every half cell of the remaining distance."""
UNTOUCHABLE = 200.0
FEAR = 32.0
"""The greedy player's cost of being next to something that may touch it, and half a cell away from a chaser."""
PERSISTENCE = 0.05
"""The value of going straight on while no target is in sight."""

MOVES = len(ACTIONS)
HARMLESS = len(MOVEMENTS)
"""The movement of things that are not dangerous."""


def worths(cases: Cases, *, has_message: bool) -> NDArray[np.float64]:
    """Return the mean value of each action over the cases."""
    games = _Games(cases, has_message)
    count = len(cases.cell)
    actions = np.repeat(np.arange(MOVES), count)
    for tick in range(HORIZON):
        games.play(actions, tick)
        if not games.size:
            break
        actions = games.greedy()
    games.stop()
    worth: NDArray[np.float64] = games.value.reshape(MOVES, count).mean(axis=1)
    return worth


def persistence(cases: Cases, last: str | None, *, has_message: bool) -> NDArray[np.float64]:
    """Return the value of repeating the last action, weighted by the probability that no target is in sight.

    A player that forgets where it has searched needs this: it finds more by walking straight on to a border.
    """
    steps = (board().next_cell[:, cases.cell] != cases.cell).mean(axis=1)
    worth: NDArray[np.float64] = steps - 1  # a step into the border has no effect
    if last in _BACK:
        worth[ACTIONS.index(last)] += steps[ACTIONS.index(last)]
        worth[ACTIONS.index(_BACK[last])] -= 1
    worth *= PERSISTENCE * cases.hidden[GOAL if has_message else MESSAGE].mean()
    return worth


_BACK = dict(zip(ACTIONS, (ACTIONS[1], ACTIONS[0], ACTIONS[3], ACTIONS[2]), strict=False))


class _Games:
    """Running simulations, each for one case and one first action; those that are over are removed."""

    def __init__(self, cases: Cases, has_message: bool) -> None:
        """Set up every case once for each first action. Rows are things, columns are simulations."""
        count = len(cases.cell)
        self.value = np.zeros(MOVES * count)
        self.number = np.arange(MOVES * count)
        self.case = np.tile(np.arange(count), MOVES)
        self.us = np.tile(board().spot_of_cell[cases.cell], MOVES)
        self.things = np.tile(cases.spots, MOVES)
        self.has_message = np.full(MOVES * count, has_message)
        self.discount = 1.0
        self._draws = _draws(HORIZON, len(cases.spots), count)
        self._offsets = offsets()
        self.fears = np.tile(cases.movements[:MESSAGE], MOVES) * OFFSETS + SHIFT
        if has_message:
            self.fears[GOAL] = HARMLESS * OFFSETS + SHIFT
        self.steps = np.tile(cases.movements, MOVES) * (DRAWS * OFFSETS) + SHIFT

    @property
    def size(self) -> int:
        """The number of simulations that are not over."""
        return len(self.number)

    def play(self, actions: Ints, tick: int) -> None:
        """Simulate a tick: everything moves depending on our place, then we move, then contacts are evaluated."""
        tables = self._offsets
        steps = self.steps + self._draws[tick][:, self.case] + (self.us - self.things)
        moved = self.things + tables.step[steps]
        self.things = np.where(tables.on_board[moved + SHIFT], moved, self.things)
        self.us = tables.next_spot[actions * OFFSETS + SHIFT + self.us]
        touching = tables.touching[self.us - self.things + SHIFT]
        dead = touching[:GOAL].any(axis=0) | (touching[GOAL] & ~self.has_message)
        took = touching[MESSAGE] & ~dead
        if took.any():
            self.has_message = self.has_message | took
            self.things[MESSAGE, took] = NOWHERE
            self.fears[GOAL, took] = HARMLESS * OFFSETS + SHIFT
            self.steps[MESSAGE, took] = IMMOVABLE * DRAWS * OFFSETS + SHIFT
        won = touching[GOAL] & self.has_message & ~dead
        self.value[self.number[dead]] += self.discount * DEATH
        self.value[self.number[won]] += self.discount
        self.discount *= DISCOUNT
        over = dead | won
        if over.any():
            self._keep(~over)

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        self.number, self.case, self.us = self.number[kept], self.case[kept], self.us[kept]
        self.has_message = self.has_message[kept]
        self.things, self.fears, self.steps = self.things[:, kept], self.fears[:, kept], self.steps[:, kept]

    def _wanted(self) -> Ints:
        wanted: Ints = np.where(self.has_message, self.things[GOAL], self.things[MESSAGE])
        return wanted

    def greedy(self) -> Ints:
        """Return the action that leads nearest to the target, and not near to danger."""
        tables = self._offsets
        spots = tables.next_spot[(np.arange(MOVES) * OFFSETS + SHIFT)[:, None] + self.us]
        cost = tables.distance[spots - self._wanted() + SHIFT] + _fears()[
            spots[:, None] - self.things[:MESSAGE] + self.fears
        ].sum(axis=1)
        best: Ints = cost.argmin(axis=0)
        return best

    def stop(self) -> None:
        """Evaluate the simulations that are not over by their remaining distance."""
        if self.size:
            ahead = np.minimum(self._offsets.distance[self.us - self._wanted() + SHIFT], 36)
            worth = np.where(self.has_message, AHEAD[True], AHEAD[False]) - FAR * ahead
            self.value[self.number] += self.discount * worth


@functools.cache
def _fears() -> Floats:
    """Return movement * OFFSETS + offset -> the cost of this distance from a danger; the last block is all 0."""
    tables = offsets()
    may_touch = (tables.gap <= 2) & (tables.distance <= 3)
    table = np.zeros((HARMLESS + 1, OFFSETS), dtype=np.float32)
    table[:HARMLESS] = UNTOUCHABLE * may_touch
    table[IMMOVABLE] = UNTOUCHABLE * tables.touching
    table[CHASER] += FEAR / np.maximum(tables.distance - 1, 1)
    return table.ravel()


@functools.cache
def _draws(ticks: int, things: int, count: int) -> Ints:
    draw = random.Random(1)
    numbers = [draw.randrange(DRAWS) for _ in range(ticks * things * count)]
    return np.asarray(numbers, dtype=np.int64).reshape(ticks, things, count) * OFFSETS


VIEWS = 4
"""The most observations that are used: each further one doubles the cost of a decision."""


def plays(reading: Reading) -> bool:
    """Whether the actions are steps to the four sides, or none."""
    return set(reading.actions) == set(ACTIONS)


def decide(reading: Reading) -> Message:
    """Read the manual, observe, then take the action with the highest value."""
    return _decide(reading, tuple(map(SeenEntities.of, reading.observations))[-VIEWS:])


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Decide by the newest observations that are remembered or visible, and return the memory that holds them."""
    memory = recall(reading)
    facts = memory.facts or {"clock": 0}
    kept = (
        SeenEntities(
            action, has_message, {name: (distance, direction) for name, (distance, direction) in things.items()}
        )
        for action, has_message, things in facts.get("views", ())
    )
    since = tuple(map(SeenEntities.of, memory.since.observations))
    views = (*kept, *since)[-VIEWS:]
    return _decide(reading, views), _memory(facts["clock"] + len(since), views, cap)


def _decide(reading: Reading, views: Sequence[SeenEntities]) -> Message:
    if "MESSENGER" not in reading.system and reading.is_start:
        return call("read_manual")
    if not views or not views[-1].things:
        return call("observe")
    return call("act", action=choose(claims(reading.system), views))


def _memory(clock: int, views: Sequence[SeenEntities], cap: int | None) -> str:
    """The line that holds these observations; under a cap in tokens, as many of the newest as fit."""
    kept = [[view.action, view.has_message, view.things] for view in views]
    lines = [line({"clock": clock, "views": kept[oldest:]}) for oldest in range(len(kept) + 1)]
    return lines[0] if cap is None else next((each for each in lines if fits(each, cap)), lines[-1])


def choose(manual_claims: tuple[Claim, ...], views: Sequence[SeenEntities]) -> str:
    """Return the best action. If the views fit no case, the oldest are dropped until they do."""
    now = views[-1]
    possible = _casts(manual_claims, views)
    for oldest in range(len(views)):
        cases = believe(possible, views[oldest:])
        if cases is not None:
            worth = worths(cases, has_message=now.has_message)
            worth += persistence(cases, now.action, has_message=now.has_message)
            return ACTIONS[int(worth.argmax())]
    return "Do Nothing"


def _casts(manual_claims: tuple[Claim, ...], views: Sequence[SeenEntities]) -> tuple[tuple[float, Cast], ...]:
    possible = casts(manual_claims, _names(manual_claims, views))
    if views[-1].has_message and len(manual_claims) <= FEW_SENTENCES and len(views[-1].things) == len(manual_claims):
        # Level 1 may start with the message in hand; the message on the board must then not be touched.
        return tuple((weight, {name: _unwanted(parts) for name, parts in cast.items()}) for weight, cast in possible)
    return possible


def _unwanted(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    return tuple(part._replace(role="enemy") if part.role == "message" else part for part in parts)


def _names(manual_claims: Sequence[Claim], views: Sequence[SeenEntities]) -> tuple[str, str, str]:
    """Return the three names of the game: those in view, then those with the most sentences, then placeholders."""
    in_view = [name for view in reversed(views) for name in view.things]
    spoken_of = [claim.entity for claim in manual_claims if claim.entity]
    named = dict.fromkeys([*in_view, *sorted(spoken_of, key=spoken_of.count, reverse=True), "?", "another?", "third?"])
    first, second, third, *_ = named
    return first, second, third
