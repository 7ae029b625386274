"""The possible meanings of MESSENGER's manual: the roles and movements of all things, as casts with probabilities.

A manual of six sentences calls every name an enemy and also something else, and a single sentence does not show which
of the two is true. The casts are all the possible meanings: one name is the enemy, and one of its two sentences is a
false lead; each of the other two names has two things, the real one and a decoy. The probability of a cast follows from
the sentences as they were read, including possible errors in reading.

In every game of the training split, the enemy, the message and the goal all move differently, and so do the two decoys;
the manual does not say this. It often leaves a single cast.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from smartplay_tools.players.rules.messenger.board import MOVEMENTS
from smartplay_tools.players.rules.messenger.manual import Claim
from smartplay_tools.types.sums import added


class Part(NamedTuple):
    """The role of a thing, and its movement."""

    role: str
    movement: int


Cast = Mapping[str, tuple[Part, ...]]
"""Name -> the things of that name, the real one first."""

FEW_SENTENCES = 3
"""A manual with at most this many sentences has no decoys."""
SILENT = (0.2, 0.2, 0.6)
"""The movements of things without decoys whose movement the manual omits, as it does for things that stand still."""
MOST_CASTS = 16
NEGLIGIBLE = 0.004
ODD = 0.05
"""The probability that a sentence is read as one about another name."""


@functools.lru_cache(maxsize=64)
def casts(claims: tuple[Claim, ...], names: tuple[str, ...]) -> tuple[tuple[float, Cast], ...]:
    """Return the probable casts of three names with their probabilities, the most probable first."""
    about = _by_name(claims, names)
    possible = _without_decoys(about) if len(claims) <= FEW_SENTENCES else _with_decoys(about)
    ordered = sorted(possible, key=lambda weighted: -weighted[0])[:MOST_CASTS]
    total = added(weight for weight, _ in ordered)
    if not total:
        return ()
    return tuple((weight / total, cast) for weight, cast in ordered if weight >= NEGLIGIBLE * total)


def _by_name(claims: tuple[Claim, ...], names: tuple[str, ...]) -> dict[str, list[Claim]]:
    """Sort the sentences by name. One without a known name is about a name that has too few sentences."""
    about = {name: [claim for claim in claims if claim.entity == name] for name in names}
    loose = [claim for claim in claims if claim.entity not in names]
    per_name = 1 if len(claims) <= FEW_SENTENCES else 2
    short = [name for name in names if len(about[name]) < per_name]
    if len(short) == 1:
        about[short[0]] += loose
    return about


def _without_decoys(about: Mapping[str, Sequence[Claim]]) -> Iterator[tuple[float, Cast]]:
    for enemy, message, goal in itertools.permutations(about):
        for moves in itertools.product(range(len(MOVEMENTS)), repeat=3):
            roles = Part("enemy", moves[0]), Part("message", moves[1]), Part("goal", moves[2])
            parts = dict(zip((enemy, message, goal), roles, strict=True))
            weight = 1.0
            for name, part in parts.items():
                for claim in about[name]:
                    weight *= _fit(claim, part) if claim.movement else _fit(claim, part) * SILENT[part.movement]
            yield weight, {name: (part,) for name, part in parts.items()}


def _with_decoys(about: Mapping[str, Sequence[Claim]]) -> Iterator[tuple[float, Cast]]:
    for enemy, message, goal in itertools.permutations(about):
        for moves in itertools.permutations(range(len(MOVEMENTS))):
            real = Part("enemy", moves[0]), Part("message", moves[1]), Part("goal", moves[2])
            # The false lead has another movement than the enemy.
            leads = [Part(role, movement) for role in ("message", "goal") for movement in moves[1:]]
            enemy_fit = added(_pair_fit(about[enemy], (real[0], lead)) for lead in leads) / len(leads)
            for decoys in itertools.permutations(range(len(MOVEMENTS)), 2):
                if decoys[0] == moves[1] or decoys[1] == moves[2]:
                    continue
                messages = real[1], Part("enemy", decoys[0])
                goals = real[2], Part("enemy", decoys[1])
                weight = enemy_fit * _pair_fit(about[message], messages) * _pair_fit(about[goal], goals)
                yield weight, {enemy: (real[0],), message: messages, goal: goals}


def _pair_fit(claims: Sequence[Claim], parts: tuple[Part, Part]) -> float:
    """Return the likelihood of the sentences about a name, given its two things."""
    if not claims:
        return ODD**2
    if len(claims) == 1:
        return ODD * max(_fit(claims[0], part) for part in parts)
    fits = (_fit(claim, parts[0]) * _fit(other, parts[1]) for claim, other in itertools.permutations(claims, 2))
    return max(fits) * ODD ** (len(claims) - 2)


def _fit(claim: Claim, part: Part) -> float:
    """Return the probability that a sentence about a part is read as this claim."""
    role = 1 / 3 if claim.role is None else 0.97 if claim.role == part.role else 0.015
    movement = 1 / 3 if claim.movement is None else 0.94 if claim.movement == MOVEMENTS[part.movement] else 0.03
    return role * movement
