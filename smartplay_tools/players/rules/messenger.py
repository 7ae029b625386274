"""MESSENGER: read who is what, infer from the visible steps where everything is and how it moves, and look ahead.

An observation gives a distance and a direction, not a place; it hides half a cell, and of two things with one name it
shows the nearer. So for every visible name the player keeps a belief: how probable each offset and each movement is,
given the visible observations and the moves between them. The movement also tells which of two things of one name is
seen, because the manual says of each how it moves. Then every sequence of three actions is played out on the beliefs.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from smartplay_tools.messages import Message
from smartplay_tools.players.reading import Reading, call
from smartplay_tools.players.rules.messenger_manual import Claim, claims

STEPS = {"Move North": (0, -2), "Move South": (0, 2), "Move West": (-2, 0), "Move East": (2, 0), "Do Nothing": (0, 0)}
"""The actions, as half cells to the east and to the south."""

MOVEMENTS = ("chaser", "fleeing", "immovable")
HALF_CELLS = ((0, -1), (0, 1), (-1, 0), (1, 0))

LAST = 18
"""The largest coordinate, in half cells."""

VIEWS = 4
"""How many of the visible observations are used, at most."""

DEPTH = 3
DEATH, SUCCESS = -6.0, 1.0
DISCOUNT = 0.97
NEARER = 0.02
"""What a half cell less to something good is worth."""
FEAR = 0.4
"""What it costs to be a half cell away from a chaser that kills; the farther, the less."""
ELSEWHERE = 0.005
"""What a half cell is worth that leads away from a double of what is wanted, so that the real one comes in sight."""
CRAMPED = 0.004
"""What it costs to be a half cell away from the middle, because borders and corners leave less room to evade."""
JUMP = 0.02
"""How likely a place is that cannot be reached: another thing of the same name has come nearer."""
STAYS_AT_BORDER = 0.15
"""How often a fleeing thing is taken to lose its tick, while it is not known where the border is."""

Offset = tuple[int, int]
Belief = dict[tuple[str, int, int], float]
"""The probability of each movement and place, in half cells to the east and to the south."""


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
    place, things = _situation(claims(reading.system), views[-VIEWS:])
    return call("act", action=max(STEPS, key=lambda action: _value_of(action, place, things, DEPTH)))


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
    is_wanted: bool
    """Whether it is good under any movement."""
    belief: Belief


def _situation(said: tuple[Claim, ...], views: tuple[View, ...]) -> tuple[Offset, tuple[Thing, ...]]:
    """Return where we most probably are, and what we believe of every visible name, on the board's coordinates.

    Nothing tells our place, but the board has an end: we cannot be where something that is seen would be beyond it,
    and a move that changed nothing shows a border. Between places that are as probable, the one in the middle.
    """
    roles = {name: _roles(name, said, views[-1]) for name in views[-1].things}
    priors = {name: {movement: p for movement, (_, p) in told.items()} for name, told in roles.items()}
    found: dict[tuple[Offset, ...], list[Track]] = {}
    best: tuple[float, int] = (-1.0, 0)
    for start in itertools.product(range(0, LAST + 1, 2), repeat=2):
        path, place = _walk((start[0], start[1]), views)
        if path not in found:
            found[path] = [_follow(name, views, path, priors[name]) for name in roles]
        likelihood = math.prod(track.likelihood * sum(_on_board(track.seen, place).values()) for track in found[path])
        central = -abs(place[0] - LAST // 2) - abs(place[1] - LAST // 2)
        if (round(likelihood, 12), central) > best:
            best, here, tracks = (round(likelihood, 12), central), place, found[path]
    wanted = "goal" if views[-1].has_message else "message"
    things = []
    for told, track in zip(roles.values(), tracks, strict=True):
        worth = {movement: SUCCESS if role == wanted else DEATH for movement, (role, _) in told.items()}
        for relative in (track.seen, track.hidden):
            if belief := _normal(_on_board(relative, here)):
                things.append(Thing(worth, SUCCESS in worth.values(), belief))
    return here, tuple(things)


def _on_board(relative: Belief, place: Offset) -> Belief:
    """Turn offsets into places, seen from where we are; drop those that are beyond the board."""
    return {
        (movement, place[0] + east, place[1] + south): probability
        for (movement, east, south), probability in relative.items()
        if 0 <= place[0] + east <= LAST and 0 <= place[1] + south <= LAST
    }


def _walk(place: Offset, views: tuple[View, ...]) -> tuple[tuple[Offset, ...], Offset]:
    """Return the steps that we really made from a place, of those in the views, and where they end."""
    path = []
    for view in views[1:]:
        after = _moved(place, STEPS.get(view.action or "", (0, 0)))
        path.append((after[0] - place[0], after[1] - place[1]))
        place = after
    return tuple(path), place


def _moved(place: Offset, step: Offset) -> Offset:
    east, south = place[0] + step[0], place[1] + step[1]
    return (east, south) if 0 <= east <= LAST and 0 <= south <= LAST else place


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


@dataclass(frozen=True)
class Track:
    """A name, followed through the observations: the thing that is seen, and another that was and went out of sight."""

    likelihood: float
    seen: Belief
    hidden: Belief


def _follow(name: str, views: tuple[View, ...], path: tuple[Offset, ...], prior: Mapping[str, float]) -> Track:
    """Follow a name, given our steps. Where it jumps, another thing of that name has come nearer than the first."""
    likelihood, seen, hidden = 1.0, Belief(), Belief()
    for step, view in zip(((0, 0), *path), views, strict=True):
        shown = view.things.get(name)
        if shown is None:
            seen = hidden = {}
            continue
        seen, hidden = _advance(seen, step), _advance(hidden, step)
        stays = {state: p for state, p in seen.items() if _shown(state[1], state[2]) == shown}
        if stays:
            likelihood *= sum(stays.values())
            seen = stays
        elif not seen:
            seen = _guess(shown, prior)
        else:
            likelihood *= JUMP
            other = {state: p for state, p in hidden.items() if _shown(state[1], state[2]) == shown}
            # Things of one name move differently.
            taken = {m: sum(p for state, p in seen.items() if state[0] == m) for m in prior}
            seen, hidden = other or _guess(shown, {m: p * (1.01 - taken[m]) for m, p in prior.items()}), seen
        seen = _normal(seen)
        hidden = _normal({state: p for state, p in hidden.items() if _shown(state[1], state[2])[0] >= shown[0]})
    return Track(likelihood, seen, hidden)


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
        for x, y, share in _MOVES[movement, _sign(east), _sign(south)]:
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


# What to do.


def _value_of(action: str, place: Offset, things: tuple[Thing, ...], depth: int) -> float:
    """Return what an action is worth if the best is done after it."""
    here = _moved(place, STEPS[action])
    value, left = 0.0, []
    for thing in things:
        belief: Belief = {}
        for (movement, x, y), probability in thing.belief.items():
            for east, south, share in _MOVES[movement, _sign(x - place[0]), _sign(y - place[1])]:
                x_after, y_after = _moved((x, y), (east, south))
                if abs(x_after - here[0]) <= 1 and abs(y_after - here[1]) <= 1:
                    value += probability * share * thing.worth[movement]
                else:
                    state = (movement, x_after, y_after)
                    belief[state] = belief.get(state, 0.0) + probability * share
        left.append(Thing(thing.worth, thing.is_wanted, belief))
    rest = tuple(left)
    if depth > 1:
        return value + DISCOUNT * max(_value_of(following, here, rest, depth - 1) for following in STEPS)
    cramped = abs(here[0] - LAST / 2) + abs(here[1] - LAST / 2)
    return value + sum(_outlook(thing, here) for thing in rest) - CRAMPED * cramped


def _outlook(thing: Thing, here: Offset) -> float:
    """Return what a thing is worth that has not been touched: better the nearer, if it is good."""
    value = 0.0
    for (movement, x, y), probability in thing.belief.items():
        distance = abs(x - here[0]) + abs(y - here[1])
        if thing.worth[movement] > 0:
            value -= NEARER * probability * distance
            continue
        if movement == "chaser":
            value -= FEAR * probability / distance
        if thing.is_wanted:
            value += ELSEWHERE * probability * distance
    return value


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
