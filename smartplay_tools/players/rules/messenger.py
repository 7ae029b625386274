"""MESSENGER: read who is what, infer from the visible steps where everything is and how it moves, and look ahead.

An observation gives a distance and a direction, not a place; it hides half a cell, and of two things with one name it
shows the nearer. So for every visible name the player keeps a belief: how probable each offset and each movement is,
given the visible observations and the moves between them. The movement also tells which of two things of one name is
seen, because the manual says of each how it moves. Then every sequence of three actions is played out on the beliefs.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
CASES = 6
"""How many cases of where we are are thought through."""
KEPT = 40
"""How many of a belief's states are played out, at most."""
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
    worth = dict.fromkeys(STEPS, 0.0)
    for weight, place, things in _situations(claims(reading.system), views[-VIEWS:]):
        for action, value in _values(place, things, DEPTH).items():
            worth[action] += weight * value
    return call("act", action=max(worth, key=worth.__getitem__))


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


def _situations(said: tuple[Claim, ...], views: tuple[View, ...]) -> Iterator[tuple[int, Offset, list[Thing]]]:
    """Yield cases of where we are, with their weight and with what we then believe of every visible name.

    Nothing tells our place, but the board has an end: we cannot be where something that is seen would be beyond it,
    and a move that changed nothing shows a border.
    """
    roles = {name: _roles(name, said, views[-1]) for name in views[-1].things}
    priors = {name: {movement: p for movement, (_, p) in told.items()} for name, told in roles.items()}
    likelihoods, cases = [], []
    for east, south in itertools.product(range(0, LAST + 1, 2), repeat=2):
        path = _walk((east, south), views)
        if all(_places(shown, at) for at, view in zip(path, views, strict=True) for shown in view.things.values()):
            tracks = [_follow(name, views, path, prior) for name, prior in priors.items()]
            likelihoods.append(math.prod(track.likelihood for track in tracks))
            cases.append((path[-1], tracks))
    wanted = "goal" if views[-1].has_message else "message"
    worths = [{m: SUCCESS if role == wanted else DEATH for m, (role, _) in told.items()} for told in roles.values()]
    for index, weight in _spread(likelihoods).items():
        place, tracks = cases[index]
        yield weight, place, _things(tracks, worths)


def _spread(weights: Sequence[float]) -> Counter[int]:
    """Return how many of `CASES` go to each index: about as its weight says, and the same ones every time."""
    cumulated = list(itertools.accumulate(weights))
    if not cumulated or not cumulated[-1]:
        return Counter()
    return Counter(bisect.bisect_right(cumulated, (i + 0.5) / CASES * cumulated[-1]) for i in range(CASES))


def _things(tracks: Sequence[Track], worths: Sequence[Mapping[str, float]]) -> list[Thing]:
    return [
        Thing(worth, SUCCESS in worth.values(), _likeliest(belief))
        for track, worth in zip(tracks, worths, strict=True)
        for belief in (track.seen, track.hidden)
        if belief
    ]


def _walk(place: Offset, views: tuple[View, ...]) -> list[Offset]:
    """Return where we are at each view, if we start from a place."""
    path = [place]
    for view in views[1:]:
        path.append(_moved(path[-1], STEPS.get(view.action or "", (0, 0))))
    return path


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
        # Two things of one name move differently, so a silent sentence is about what no other claims.
        others = {other.movement for other in about if other is not claim}
        for movement in [claim.movement] if claim.movement else [m for m in MOVEMENTS if m not in others]:
            told[movement] = (claim.role, 0.5)
    return told


@dataclass(frozen=True)
class Track:
    """A name, followed through the observations: the thing that is seen, and another that was and went out of sight."""

    likelihood: float
    seen: Belief
    hidden: Belief


def _follow(name: str, views: tuple[View, ...], path: list[Offset], prior: Mapping[str, float]) -> Track:
    """Follow a name, given our path. Where it jumps, another thing of that name has come nearer than the first."""
    likelihood, seen, hidden = 1.0, Belief(), Belief()
    before = path[0]
    for here, view in zip(path, views, strict=True):
        shown = view.things.get(name)
        if shown is None:
            seen = hidden = {}
            continue
        seen, hidden = _advance(seen, before), _advance(hidden, before)
        places = _places(shown, here)
        stays = {state: p for state, p in seen.items() if state[1:] in places}
        if stays:
            likelihood *= sum(stays.values())
            seen = stays
        elif not seen:
            likelihood *= _share_on_board(shown, here)
            seen = _guess(places, prior)
        else:
            likelihood *= JUMP
            other = {state: p for state, p in hidden.items() if state[1:] in places}
            # Things of one name move differently.
            taken = {m: sum(p for state, p in seen.items() if state[0] == m) for m in prior}
            seen, hidden = other or _guess(places, {m: p * (1.01 - taken[m]) for m, p in prior.items()}), seen
        seen = _normal(seen)
        hidden = _normal({s: p for s, p in hidden.items() if _cells_between(s[1:], here) >= shown[0]})
        before = here
        if not seen:
            return Track(0.0, {}, {})
    return Track(likelihood, seen, hidden)


def _cells_between(place: Offset, here: Offset) -> int:
    return abs(place[0] // 2 - here[0] // 2) + abs(place[1] // 2 - here[1] // 2)


@functools.cache
def _offsets(shown: tuple[int, str]) -> tuple[Offset, ...]:
    """Return every offset that would be shown so, in half cells."""
    span = range(-2 * shown[0], 2 * shown[0] + 2)
    return tuple((east, south) for east in span for south in span if _shown(east, south) == shown)


@functools.cache
def _places(shown: tuple[int, str], here: Offset) -> frozenset[Offset]:
    """Return every place on the board that would be shown so."""
    places = ((here[0] + east, here[1] + south) for east, south in _offsets(shown))
    return frozenset((x, y) for x, y in places if 0 <= x <= LAST and 0 <= y <= LAST)


def _share_on_board(shown: tuple[int, str], here: Offset) -> float:
    return len(_places(shown, here)) / len(_offsets(shown))


def _guess(places: Iterable[Offset], prior: Mapping[str, float]) -> Belief:
    """Believe in each of the places; what never moves stands on whole cells."""
    return _normal(
        {
            (movement, x, y): probability * (4 if movement == "immovable" else 1)
            for movement, probability in prior.items()
            for x, y in sorted(places)
            if movement != "immovable" or not (x % 2 or y % 2)
        }
    )


def _normal(belief: Belief) -> Belief:
    total = sum(belief.values())
    return {state: probability / total for state, probability in belief.items()} if total else {}


def _likeliest(belief: Belief) -> Belief:
    """Keep what is worth thinking ahead with."""
    kept = sorted(belief, key=belief.__getitem__, reverse=True)[:KEPT]
    return _normal({state: belief[state] for state in kept})


def _advance(belief: Belief, here: Offset) -> Belief:
    """Let things move for a tick, by where we stand."""
    after: Belief = {}
    for (movement, x, y), probability in belief.items():
        for x_after, y_after, share in _moves(movement, x, y, here):
            state = (movement, x_after, y_after)
            after[state] = after.get(state, 0.0) + probability * share
    return after


@functools.cache
def _moves(movement: str, x: int, y: int, here: Offset) -> tuple[tuple[int, int, float], ...]:
    """Return where a thing goes in a tick, and how probably: half a cell nearer or farther, never off the board."""
    if movement == "immovable":
        return ((x, y, 1.0),)
    nearer = [(e, s) for e, s in HALF_CELLS if e * (here[0] - x) > 0 or s * (here[1] - y) > 0]
    steps = (nearer or HALF_CELLS) if movement == "chaser" else [step for step in HALF_CELLS if step not in nearer]
    return tuple((*_moved((x, y), step), 1 / len(steps)) for step in steps)


# What to do.


def _values(place: Offset, things: Sequence[Thing], depth: int) -> dict[str, float]:
    """Return what each action is worth if the best is done after it."""
    moved = [_advance(thing.belief, place) for thing in things]  # things move first, by where we still are
    return {action: _value_of(_moved(place, step), things, moved, depth) for action, step in STEPS.items()}


def _value_of(here: Offset, things: Sequence[Thing], moved: Sequence[Belief], depth: int) -> float:
    """Return what it is worth to be somewhere when things have moved: what is touched, and what then lies ahead."""
    value, rest = 0.0, []
    for thing, belief in zip(things, moved, strict=True):
        left: Belief = {}
        for state, probability in belief.items():
            if -1 <= state[1] - here[0] <= 1 and -1 <= state[2] - here[1] <= 1:
                value += probability * thing.worth[state[0]]
            else:
                left[state] = probability
        rest.append(Thing(thing.worth, thing.is_wanted, left))
    if depth > 1:
        return value + DISCOUNT * max(_values(here, rest, depth - 1).values())
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
