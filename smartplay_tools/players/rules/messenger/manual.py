"""Rules that read MESSENGER's manual: the entity of each sentence, the role it gives, and the movement it describes.

The word lists were compiled by hand from sentences of the training split; a test checks that each word and each pattern
occurs there. The player is scored on other sentences. Grammar is not parsed: a sentence of these manuals names one
entity, one role and mostly one movement, in any order, so it is enough to find their words, with a tolerance of one
letter for typing mistakes, and to use certain sentences to decide uncertain ones.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from smartplay_tools.types.sums import added

ENTITIES = {
    "airplane": "airplane plane jet aircraft aeroplane flying",
    "mage": "mage wizard sorcerer magician warlock alchemist",
    "dog": "dog hound canine beagle",
    "bird": "bird hawk eagle falcon fowl prey",
    "fish": "fish whale shark scaly",
    "scientist": "scientist scholar researcher professor analyst investigator expert",
    "thief": "thief robber bandit burglar looter",
    "ship": "ship boat ferry vessel barge tugboat",
    "ball": "ball orb sphere spherical round",
    "robot": "robot bot humanoid android cyborg droid automaton machine",
    "queen": "queen princess empress ruler monarch",
    "sword": "sword blade saber knife weapon",
}

ROLES = {
    "enemy": (
        "enemy adversary opponent foe rival nemesis antagonist opposition assailant deadly dangerous lethal "
        "threatening harmful fatal treacherous menacing destructive murderous pernicious poisonous toxic fierce "
        "villainous vicious hostile nasty ruthless hazardous evil sinister brutal mortal"
    ),
    "message": (
        "report document message paper information file letter memo note script text communication classified secret "
        "restricted hidden confidential top-secret private cryptic covert clandestine confined sensitive banned "
        "forbidden sealed encrypted undisclosed exclusive"
    ),
    "goal": (
        "goal target objective mission mark aim purpose destination vital essential crucial important critical main "
        "primary key imperative paramount principal fundamental ultimate basic significant necessary central pivotal "
        "valuable final"
    ),
}

# In this order, because "moving away" is not an approach, and "not moving away" does not occur.
MOVEMENTS = {
    "immovable": (
        r"(not|n\W{1,4}t|never|cannot|unable to|able to) (be )?mov"
        r"|stationar|immov|immob|unmov|motionless|\bstill\b|non-moving|\bfixed\b|\bidle\b|inanimate|stagnant|static"
        r"|stuck|budge|\bput\b|in (its|one|the same) place|in place|\bplace\b|not moved|has not"
    ),
    "fleeing": (
        r"away|flee|escap|\brun|\bleav|evad|evas|elud|elus|dodg|avoid|retreat|opposite|\boff\b|further|depart"
        r"|sprint|scurr|slipping|won't let"
    ),
    "chaser": (
        r"toward|chas|approach|coming|comes (?!as|with)|\bhead|inch|pursu|follow(?! the)|hunt|gaining|stalk|creep"
        r"|closer|closing|your way|advanc|after you|tail|near you|inching near|creeping near|rush|get you|drawing"
        r"|close to you|incoming|oncoming|way to you"
    ),
}


@dataclass(frozen=True, slots=True)
class Claim:
    """The content of a sentence."""

    entity: str | None
    role: str | None
    movement: str | None


def claims(system: str) -> tuple[Claim, ...]:
    """Read the sentences of a manual, which are a separate paragraph after the context."""
    _, _, manual = system.partition("MESSENGER")
    paragraphs = manual.split("\n\n")
    lines = paragraphs[1].split("\n") if len(paragraphs) > 1 else []
    return _read(tuple(lines))


@functools.lru_cache(maxsize=64)
def _read(lines: tuple[str, ...]) -> tuple[Claim, ...]:
    roles = _roles([_scores(line, ROLES) for line in lines])
    return tuple(
        Claim(_best(_scores(line, ENTITIES)), role, _movement(line)) for line, role in zip(lines, roles, strict=True)
    )


def _roles(scores: Sequence[Mapping[str, float]]) -> list[str | None]:
    """Choose the roles; three sentences are about three different ones."""
    if len(scores) != len(ROLES):
        return [_best(score) for score in scores]
    orders = itertools.permutations(ROLES)
    best = max(orders, key=lambda order: added(score[role] for score, role in zip(scores, order, strict=True)))
    return list(best)


def _best(scores: Mapping[str, float]) -> str | None:
    name = max(scores, key=scores.__getitem__)
    return name if scores[name] else None


def _movement(line: str) -> str | None:
    return next((movement for movement, pattern in MOVEMENTS.items() if re.search(pattern, line)), None)


def _scores(line: str, lists: Mapping[str, str]) -> dict[str, float]:
    """Count the words of each list: 1 for a word that occurs, 0.5 for one with a typing mistake."""
    words = re.findall(r"[a-z][a-z-]*", line.lower())
    return {name: added(_likeness(word, listed) for word in words) for name, listed in lists.items()}


@functools.lru_cache(maxsize=4096)
def _likeness(word: str, phrase: str) -> float:
    listed = phrase.split()
    if word in listed:
        return 1.0
    return 0.5 if any(_one_slip_apart(word, other) for other in listed) else 0.0


def _one_slip_apart(one: str, other: str) -> bool:
    """Whether one letter was lost, added, changed or swapped with its neighbour. Short words have to match exactly."""
    if min(len(one), len(other)) < 4 or abs(len(one) - len(other)) > 1:
        return False
    common = next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
    rest, other_rest = one[common:], other[common:]
    swapped = rest[:2] == other_rest[1::-1] and rest[2:] == other_rest[2:]
    return swapped or rest[1:] == other_rest[1:] or rest[1:] == other_rest or rest == other_rest[1:]
