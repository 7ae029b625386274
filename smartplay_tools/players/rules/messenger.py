"""MESSENGER: read who is what, infer from the visible steps where everything is and how it moves, and look ahead.

An observation gives a distance and a direction, not a place; it hides half a cell, and of two things with one name it
shows the nearer. So for every visible name the player keeps a belief: how probable each offset and each movement is,
given the visible observations and the moves between them. The movement also tells which of two things of one name is
seen, because the manual says of each how it moves. Then every sequence of three actions is played out on the beliefs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from smartplay_tools.messages import Message
from smartplay_tools.players.reading import Reading, call
from smartplay_tools.players.rules.messenger_manual import Claim, claims

STEPS = {"Move North": (0, -2), "Move South": (0, 2), "Move West": (-2, 0), "Move East": (2, 0), "Do Nothing": (0, 0)}
"""The actions, as half cells to the east and to the south."""

MOVEMENTS = ("chaser", "fleeing", "immovable")
HALF_CELLS = ((0, -1), (0, 1), (-1, 0), (1, 0))

DEPTH = 3
DEATH, SUCCESS = -3.0, 1.0
DISCOUNT = 0.97
NEARER = 0.02
"""What a half cell less to something good is worth."""
STAYS_AT_BORDER = 0.15
"""How often a fleeing thing is taken to lose its tick, because the border is not seen."""

Offset = tuple[int, int]
Belief = dict[tuple[str, int, int], float]
"""The probability of each movement and offset from us, in half cells to the east and to the south."""


def plays(reading: Reading) -> bool:
    """Whether the actions are steps to the four sides, or none."""
    return set(reading.actions) == set(STEPS)


def decide(reading: Reading) -> Message:
    """Read the manual, look, then take the first of the best three actions."""
    if "MESSENGER" not in reading.system and reading.is_start:
        return call("read_manual")
    views = tuple(map(View.of, reading.observations))
    if not views or not views[-1].things:
        return call("observe")
    things = tuple(_things(claims(reading.system), views))
    return call("act", action=max(STEPS, key=lambda action: _value_of(action, things, DEPTH)))


# What is seen.


@dataclass(frozen=True)
class View:
    """An observation, read."""

    action: str | None
    has_message: bool
    things: Mapping[str, tuple[int, str]]
    """Name -> distance in cells, direction."""

    @classmethod
    def of(cls, text: str) -> View:
        """Read an observation."""
        action = re.search(r"^You took action (.+)\.$", text, flags=re.MULTILINE)
        things = re.findall(r"^- (\w+) (\d+) steps (?:to your |with )([\w-]+)$", text, flags=re.MULTILINE)
        return cls(
            action[1] if action else None,
            "already have the message" in text,
            {name: (int(distance), direction) for name, distance, direction in things},
        )


def _shown(east: int, south: int) -> tuple[int, str]:
    """Return how an offset would be shown: as a distance in cells and a direction."""
    east, south = east // 2, south // 2  # we stand on whole cells
    parts = ["north" if south < 0 else "south"] if south else []
    if east:
        parts.append("west" if east < 0 else "east")
    return abs(east) + abs(south), "-".join(parts) or "you"


# What is believed.


@dataclass(frozen=True)
class Thing:
    """A visible name: what it is if it moves in a way, and where it may be."""

    worth: Mapping[str, float]
    """Movement -> what touching such a thing is worth: `SUCCESS` or `DEATH`."""
    belief: Belief


def _things(said: tuple[Claim, ...], views: tuple[View, ...]) -> Iterator[Thing]:
    now = views[-1]
    for name in now.things:
        roles = _roles(name, said, now)
        prior = {movement: probability for movement, (_, probability) in roles.items()}
        wanted = "goal" if now.has_message else "message"
        worth = {movement: SUCCESS if role == wanted else DEATH for movement, (role, _) in roles.items()}
        yield Thing(worth, _believe(name, views, prior))


def _roles(name: str, said: tuple[Claim, ...], now: View) -> dict[str, tuple[str | None, float]]:
    """Return movement -> (role, probability) for the thing of that name that is seen."""
    about = [claim for claim in said if claim.entity == name]
    if not about:
        # A sentence that names nobody we know is about somebody of whom nothing else is said.
        spoken_of = {claim.entity for claim in said}
        about = [claim for claim in said if claim.entity is None or (claim.entity not in now.things and len(said) <= 3)]
        about = about if len(spoken_of & set(now.things)) == len(now.things) - 1 else []
    if len(about) == 1:
        (claim,) = about
        return {m: (claim.role, 0.94 if m == claim.movement else 0.03 if claim.movement else 1 / 3) for m in MOVEMENTS}
    told: dict[str, tuple[str | None, float]] = dict.fromkeys(MOVEMENTS, ("enemy", 0.02))
    for claim in about:
        for movement in [claim.movement] if claim.movement else MOVEMENTS:
            told[movement] = (claim.role, 0.5)
    return told


def _believe(name: str, views: tuple[View, ...], prior: Mapping[str, float]) -> Belief:
    """Follow a name through the visible observations. Where it jumps, another thing of its name has come nearer."""
    belief: Belief = {}
    for view in views:
        if name not in view.things:
            belief = {}
            continue
        seen = view.things[name]
        step = STEPS.get(view.action or "", (0, 0))
        belief = _normal({s: p for s, p in _advance(belief, step).items() if _shown(s[1], s[2]) == seen})
        belief = belief or _guess(seen, prior)
    return belief


def _guess(seen: tuple[int, str], prior: Mapping[str, float]) -> Belief:
    """Believe in every offset that would be shown so; what never moves stands on whole cells."""
    span = range(-2 * seen[0], 2 * seen[0] + 2)
    offsets = [(east, south) for east in span for south in span if _shown(east, south) == seen]
    return _normal(
        {
            (movement, east, south): probability * (4 if movement == "immovable" else 1)
            for movement, probability in prior.items()
            for east, south in offsets
            if movement != "immovable" or not (east % 2 or south % 2)
        }
    )


def _normal(belief: Belief) -> Belief:
    total = sum(belief.values())
    return {state: probability / total for state, probability in belief.items()} if total else {}


def _advance(belief: Belief, step: Offset) -> Belief:
    """Let a tick pass: the thing goes by where we stand, then we make a step."""
    after: Belief = {}
    for (movement, east, south), probability in belief.items():
        for x, y, share in _moves(movement, (east > 0) - (east < 0), (south > 0) - (south < 0)):
            state = (movement, east + x - step[0], south + y - step[1])
            after[state] = after.get(state, 0.0) + probability * share
    return after


def _moves_of(movement: str, east: int, south: int) -> list[tuple[int, int, float]]:
    """Return (east, south, probability) of a thing's half step; `east` and `south` are the signs of its offset."""
    if movement == "immovable":
        return [(0, 0, 1.0)]
    nearer = [(x, y) for x, y in HALF_CELLS if x * east < 0 or y * south < 0]
    if movement == "chaser":
        open_to = nearer or list(HALF_CELLS)
        return [(x, y, 1 / len(open_to)) for x, y in open_to]
    open_to = [step for step in HALF_CELLS if step not in nearer]
    return [(0, 0, STAYS_AT_BORDER), *((x, y, (1 - STAYS_AT_BORDER) / len(open_to)) for x, y in open_to)]


_MOVES = {(m, x, y): _moves_of(m, x, y) for m in MOVEMENTS for x in (-1, 0, 1) for y in (-1, 0, 1)}


def _moves(movement: str, east: int, south: int) -> list[tuple[int, int, float]]:
    return _MOVES[movement, east, south]


# What to do.


def _value_of(action: str, things: tuple[Thing, ...], depth: int) -> float:
    """Return what an action is worth if the best is done after it."""
    value, left = 0.0, []
    for thing in things:
        touched, belief = 0.0, {}
        for state, probability in _advance(thing.belief, STEPS[action]).items():
            if abs(state[1]) <= 1 and abs(state[2]) <= 1:
                touched += probability * thing.worth[state[0]]
            else:
                belief[state] = probability
        value += touched
        left.append(Thing(thing.worth, belief))
    rest = tuple(left)
    if depth > 1:
        return value + DISCOUNT * max(_value_of(following, rest, depth - 1) for following in STEPS)
    return value + sum(map(_outlook, rest))


def _outlook(thing: Thing) -> float:
    """Return what a thing is worth that has not been touched: better the nearer, if it is good."""
    value = 0.0
    for (movement, east, south), probability in thing.belief.items():
        if thing.worth[movement] > 0:
            value -= NEARER * probability * (abs(east) + abs(south))
    return value
