"""The statistics of our manual sentences, compared with the original's.

    python -m tests.messenger_sentences

prints every figure beside the published one of the original's test split (`data/messenger_figures.toml`), and then
200 sentences drawn at random, to be read: no figure tells whether a sentence sounds like somebody's.
"""

from __future__ import annotations

import random
import re
import statistics
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from smartplay_tools.games.messenger.manuals import OUR_TEXTS, UNKNOWN, Texts, load
from smartplay_tools.games.messenger.rules import MOVEMENTS

PUBLISHED = Path(__file__).parent / "data" / "messenger_figures.toml"
GRAMMAR = tomllib.loads((Path(__file__).parent / "data" / "messenger_grammar.toml").read_text(encoding="utf-8"))
KINDS = (*MOVEMENTS, UNKNOWN)
SENTENCES_TO_READ = 200

POSSESSION = re.compile(
    r"\b(has|have|had|having|holds?|holding|held|carry|carries|carrying|carried|possess\w*|in possession|contains"
    r"|own(s|ed)|bears|keeps (the|an?)|kept|guard(s|ed)|hides|hidden by|belongs|with (the|an?))\b"
)


class Entry(NamedTuple):
    """An entry of the texts, and what it is about."""

    entity: str
    role: str
    kind: str
    text: str


class Figure(NamedTuple):
    """A figure of the original, and ours."""

    name: str
    original: float
    ours: float


def entries(texts: Texts) -> list[Entry]:
    """Return all entries of a split."""
    return [
        Entry(entity, role, kind, text)
        for entity, by_role in texts.items()
        for role, by_kind in by_role.items()
        for kind, sentences in by_kind.items()
        for text in sentences
    ]


def figures(all_entries: list[Entry]) -> Iterator[Figure]:
    """Measure all published figures."""
    published = tomllib.loads(PUBLISHED.read_text(encoding="utf-8"))
    yield from _lengths(all_entries, published)
    for pattern, original in published["forms"].items():
        yield Figure(pattern, original, _share(all_entries, pattern))
    for name, original in published["meaning"].items():
        yield Figure(name, original, _percent(MEANING[name](entry) for entry in all_entries))
    for kind in MOVEMENTS:
        of_kind = [entry for entry in all_entries if entry.kind == kind]
        for pattern, original in published[kind].items():
            yield Figure(f"{kind}: {pattern}", original, _share(of_kind, rf"\b({pattern})\b"))
    for role, counted in published["roles"].items():
        of_role = [entry for entry in all_entries if entry.role == role]
        for word, number in counted["words"].items():
            yield Figure(f"{role}: {word}", 100 * number / counted["entries"], _share(of_role, rf"\b{word}\b"))
    usual = 100 - published["meaning"]["none of the three synonyms"]
    for entity, synonyms in published["synonyms"].items():
        of_entity = [entry for entry in all_entries if entry.entity == entity]
        for word, number in synonyms.items():
            original = usual * number / sum(synonyms.values())
            yield Figure(f"{entity}: {word}", original, _share(of_entity, rf"\b{word}\b"))


def _lengths(all_entries: list[Entry], published: dict[str, Any]) -> Iterator[Figure]:
    lengths = [_words(entry) for entry in all_entries]
    yield Figure("words, mean", published["words"]["mean"], statistics.mean(lengths))
    yield Figure("words, standard deviation", published["words"]["deviation"], statistics.pstdev(lengths))
    for kind in KINDS:
        of_kind = statistics.mean(_words(entry) for entry in all_entries if entry.kind == kind)
        yield Figure(f"words, mean, {kind}", published["words"][kind], of_kind)
    characters = statistics.mean(len(entry.text) for entry in all_entries)
    yield Figure("characters, mean", published["characters"]["mean"], characters)
    for span, original in published["lengths"].items():
        low, high = map(int, span.split("-"))
        yield Figure(f"words: {span}", original, _percent(low <= length <= high for length in lengths))


def _words(entry: Entry) -> int:
    return len(entry.text.split())


def _percent(hits: Iterable[object]) -> float:
    return 100 * statistics.mean(bool(hit) for hit in hits)


def _share(some_entries: list[Entry], pattern: str) -> float:
    return _percent(re.search(pattern, entry.text) for entry in some_entries)


# What only the grammar's word lists can tell.


def phrases(table: str, key: str) -> list[str]:
    """Return the phrases of one of the grammar's lists, without their weights."""
    return [phrase.partition(" *")[0] for phrase in GRAMMAR[table][key]]


def _any_of(words: Iterable[str]) -> str:
    return "(" + "|".join(map(re.escape, words)) + ")"


def _nouns(entry: Entry) -> str:
    return _any_of(phrases("roles", entry.role))


def _adjectives(entry: Entry) -> str:
    return _any_of(phrases("adjectives", entry.role))


def _entity_first(entry: Entry) -> bool:
    entity = re.search(rf"\b{_any_of(phrases('entities', entry.entity))}\b", entry.text)
    role = re.search(rf"\b{_nouns(entry)}\b", entry.text)
    return bool(entity and role and entity.start() < role.start())


def _unusual(entry: Entry) -> bool:
    return not re.search(rf"\b{_any_of(phrases('entities', entry.entity)[:3])}\b", entry.text)


MEANING: dict[str, Callable[[Entry], object]] = {
    "possession": lambda e: POSSESSION.search(e.text),
    "entity before role": _entity_first,
    "adjective": lambda e: re.search(rf"\b{_adjectives(e)}\b", e.text),
    "adjective before the role's noun": lambda e: re.search(rf"\b{_adjectives(e)} {_nouns(e)}\b", e.text),
    "adjective in a clause": lambda e: re.search(rf"\bis {_adjectives(e)}\b(?! {_nouns(e)})", e.text),
    "none of the three synonyms": _unusual,
}


def main() -> None:
    """Print the figures, and sentences to read."""
    test = entries(load(OUR_TEXTS, "test"))
    print(f"{'figure':64}{'original':>10}{'ours':>8}{'apart':>8}")
    for name, original, ours in figures(test):
        print(f"{name:64}{original:10.1f}{ours:8.1f}{ours - original:+8.1f}")
    print()
    for entry in random.Random().sample(test, SENTENCES_TO_READ):
        print(f"{entry.entity:>10} {entry.role:8}{entry.kind:10} {entry.text}")


if __name__ == "__main__":
    main()
