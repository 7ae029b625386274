"""How our manual sentences compare with the original's, in figures.

    python -m smartplay_tools.games.messenger.statistics

prints every figure beside the published one of the original's test split, and then 200 sentences drawn at random, to
be read: no figure tells whether a sentence sounds like somebody's.
"""

from __future__ import annotations

import random
import re
import statistics
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from smartplay_tools.games.messenger.grammar import KINDS, phrases
from smartplay_tools.games.messenger.manuals import OUR_TEXTS, ROLES, Texts, load

SENTENCES_TO_READ = 200


class Entry(NamedTuple):
    """A sentence and what it is about."""

    entity: str
    role: str
    kind: str
    text: str

    @property
    def words(self) -> list[str]:
        """The words, without punctuation."""
        return re.findall(r"[\w'’€™-]+", self.text)


class Figure(NamedTuple):
    """A figure: the original's, and how to measure it. Shares are in percent."""

    name: str
    original: float
    measure: Callable[[list[Entry]], float]


def entries(texts: Texts) -> list[Entry]:
    """Return all sentences of a split."""
    return [
        Entry(entity, role, kind, text)
        for entity, by_role in texts.items()
        for role, by_kind in by_role.items()
        for kind, sentences in by_kind.items()
        for text in sentences
    ]


def share(
    holds: Callable[[Entry], object], *, among: Callable[[Entry], object] = lambda entry: True
) -> Callable[[list[Entry]], float]:
    """Return a measure: the percentage of entries of which something holds."""

    def measure(all_entries: list[Entry]) -> float:
        chosen = [entry for entry in all_entries if among(entry)]
        return 100 * sum(bool(holds(entry)) for entry in chosen) / len(chosen)

    return measure


def matches(pattern: str) -> Callable[[Entry], object]:
    """Return a test: whether the pattern is found in the text."""
    found = re.compile(pattern)
    return lambda entry: found.search(entry.text)


def _of_kind(*kinds: str) -> Callable[[Entry], object]:
    return lambda entry: entry.kind in kinds


def _of_role(role: str) -> Callable[[Entry], object]:
    return lambda entry: entry.role == role


def _position(entry: Entry, words: Iterable[str]) -> int:
    found = re.search(r"\b(" + "|".join(map(re.escape, words)) + r")\b", entry.text)
    return found.start() if found else -1


def _entity_first(entry: Entry) -> bool:
    return 0 <= _position(entry, phrases("entities", entry.entity)) < _position(entry, phrases("roles", entry.role))


POSSESSES = (
    r"\b(has|have|had|having|holds?|holding|held|carry|carries|carrying|carried|possess\w*|contains|owns|owned|bears|keeps "
    r"the|keeps a|kept|is with|with the|with a|with an|guards|guarded|in possession|belongs|hides|hidden by|comes with the)\b"
)
PASSIVE = r"\b(held|carried|had|possessed|kept|owned|guarded|hidden) by\b"

_MOVING = _of_kind("chaser", "fleeing", "immovable")


def _figures() -> Iterator[Figure]:
    yield Figure("words: mean", 10.2, lambda all_: statistics.mean(len(e.words) for e in all_))
    yield Figure("words: standard deviation", 2.3, lambda all_: statistics.pstdev(len(e.words) for e in all_))
    for kind, mean in zip(KINDS, (10.5, 10.5, 10.0, 8.0), strict=True):
        yield Figure(
            f"words: mean, {kind}",
            mean,
            lambda all_, kind=kind: statistics.mean(len(e.words) for e in all_ if e.kind == kind),
        )
    yield Figure("characters: mean", 56, lambda all_: statistics.mean(len(e.text) for e in all_))
    for low, high, percent in (
        (1, 6, 2.9),
        (7, 8, 19.3),
        (9, 9, 16.4),
        (10, 10, 17.6),
        (11, 11, 17.9),
        (12, 13, 17.9),
        (14, 99, 7.9),
    ):
        yield Figure(
            f"words: {low} to {high}", percent, share(lambda e, low=low, high=high: low <= len(e.words) <= high)
        )
    yield Figure("possession", 38, share(matches(POSSESSES)))
    yield Figure("passive possession", 8, share(matches(PASSIVE)))
    yield Figure("in the hands or possession of", 2, share(matches(r"\bin (the )?(hands|possession) of\b")))
    yield Figure("entity before role", 57, share(_entity_first))
    yield Figure("relative clause", 43, share(matches(r"\b(?<!^)(that|which|who)\b")))
    yield Figure("comma", 13, share(matches(",")))
    yield Figure("two sentences", 5, share(matches(r"\. \w")))
    yield Figure("final full stop", 92, share(matches(r"\.$")))
    for first, percent in (("the", 79), ("an?", 5.5), ("you|your|you're", 3), ("there|there's", 2), (r"\w+ing", 4.5)):
        yield Figure(f"first word: {first}", percent, share(matches(rf"^({first})\b")))
    yield Figure("you or your", 42, share(matches(r"\byour?\b")))
    yield Figure("object, item, thing, entity", 10, share(matches(r"\b(object|item|thing|entity)\b")))
    yield Figure("contraction", 7, share(matches(r"\w(['’]|â€™)\w")))
    yield Figure("he, she, his, her", 2, share(matches(r"\b(he|she|his|her)\b")))
    adjective = {role: "|".join(map(re.escape, phrases("adjectives", role))) for role in ROLES}
    noun = {role: "|".join(map(re.escape, phrases("roles", role))) for role in ROLES}
    yield Figure("role adjective: present", 95, share(lambda e: re.search(rf"\b({adjective[e.role]})\b", e.text)))
    yield Figure(
        "role adjective: before the noun",
        74,
        share(lambda e: re.search(rf"\b({adjective[e.role]}) ({noun[e.role]})\b", e.text)),
    )
    yield Figure(
        "role adjective: in a clause",
        10,
        share(lambda e: re.search(rf"\bis ({adjective[e.role]})\b(?! ({noun[e.role]}))", e.text)),
    )
    for role, words in (
        (
            "enemy",
            {
                "enemy": 184,
                "adversary": 137,
                "opponent": 131,
                "foe": 23,
                "deadly": 161,
                "dangerous": 144,
                "lethal": 117,
            },
        ),
        (
            "message",
            {"report": 121, "document": 109, "message": 105, "classified": 109, "secret": 108, "restricted": 91},
        ),
        (
            "goal",
            {"goal": 138, "target": 117, "objective": 87, "vital": 94, "essential": 92, "crucial": 73, "important": 41},
        ),
    ):
        total = {"enemy": 504, "message": 362, "goal": 360}[role]
        for word, number in words.items():
            yield Figure(f"{role}: {word}", 100 * number / total, share(matches(rf"\b{word}\b"), among=_of_role(role)))
    for entity, numbers in (
        ("airplane", (36, 41, 44)), ("mage", (47, 34, 36)), ("dog", (45, 22, 21)), ("bird", (47, 40, 37)), ("fish", (29, 29, 30)),
        ("scientist", (37, 38, 41)), ("thief", (25, 25, 31)), ("ship", (38, 23, 26)), ("ball", (32, 19, 33)), ("robot", (33, 30, 17)),
        ("queen", (31, 28, 29)), ("sword", (33, 27, 24)),
    ):  # fmt: skip
        for synonym, number in zip(phrases("entities", entity)[:3], numbers, strict=True):
            among = lambda e, entity=entity: e.entity == entity
            yield Figure(
                f"{entity}: {synonym}", 96.7 * number / sum(numbers), share(matches(rf"\b{synonym}\b"), among=among)
            )
    yield Figure(
        "none of the three synonyms", 3.3, share(lambda e: _position(e, phrases("entities", e.entity)[:3]) < 0)
    )
    for kind, patterns in MOVEMENT_WORDS.items():
        for pattern, percent in patterns.items():
            yield Figure(f"{kind}: {pattern}", percent, share(matches(rf"\b({pattern})\b"), among=_of_kind(kind)))
    yield Figure("fleeing: from you", 50, share(matches(r"\bfrom you\b"), among=_of_kind("fleeing")))


MOVEMENT_WORDS: dict[str, dict[str, float]] = {
    "chaser": {
        r"coming|comes": 30, r"chas\w+": 25, r"approach\w+": 13.6, r"head\w+": 6.3, r"moving": 6.8, r"inching": 3, r"pursu\w+": 3.3,
    },
    "fleeing": {
        r"running": 29.4, r"runs": 7.6, r"fleeing|flees?": 29.1, r"escap\w+": 7.1, r"getting away": 3.3, r"evad\w+": 3.3, r"leaving": 2.5,
    },
    "immovable": {
        r"not moving|isn't moving": 16, r"(cannot|can't|can not) be moved": 14, r"(cannot|can't|can not) move": 5, r"(does not|doesn't) move": 6.6,
        r"stationary": 13, r"immovable": 12.2, r"motionless": 5.1, r"still": 4.8, r"unmoving": 3.6, r"immobile": 3.1,
    },
}  # fmt: skip
"""The words that tell the movement, with their share in the original, in percent."""

FIGURES = tuple(_figures())


def report(all_entries: list[Entry]) -> list[tuple[str, float, float]]:
    """Return (name, original's figure, ours) for every figure."""
    return [(figure.name, figure.original, figure.measure(all_entries)) for figure in FIGURES]


def main() -> None:
    """Print the figures, and sentences to read."""
    test = entries(load(OUR_TEXTS, "test"))
    print(f"{'figure':48}{'original':>10}{'ours':>10}{'apart':>8}")
    for name, original, ours in report(test):
        print(f"{name:48}{original:10.1f}{ours:10.1f}{ours - original:+8.1f}")
    forms = [word for entry in test for word in entry.words]
    print(f"{'word forms':48}{618:10}{len(set(forms)):10}")
    print()
    for entry in random.Random(1).sample(test, SENTENCES_TO_READ):
        print(f"{entry.entity:>10} {entry.role:8}{entry.kind:10} {entry.text}")


if __name__ == "__main__":
    main()
