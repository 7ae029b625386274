"""The generator of our manual sentences: it expands `grammar.toml` with a fixed stream of random numbers.

The original's sentences were crowdsourced, and we may not copy them. The properties that make them hard are published
in figures: three synonyms for everything, role and entity in either order, the movement in any of a dozen places, a few
typing mistakes. The grammar says the same things in our words with the same frequencies.

    python -m smartplay_tools.games.messenger.grammar

writes the files in `texts/`. The files are stored instead of being generated at run time, because a changed manual
would be a changed benchmark.
"""

from __future__ import annotations

import functools
import json
import random
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.games.messenger.manuals import OUR_TEXTS, ROLES, UNKNOWN, Texts
from smartplay_tools.games.messenger.rules import ENTITIES, MOVEMENTS, SPLITS, Split
from smartplay_tools.types.tables import read_table

SEED = 2024

KINDS = (*MOVEMENTS, UNKNOWN)
"""What a sentence says about the movement."""


def counts(split: Split, entity: str, role: str) -> Sequence[int]:
    """Return how many sentences a pair has in a split, in the order of `KINDS`."""
    by_role = grammar()["counts"]["train" if split == "train" else "evaluation"]
    numbers: Sequence[int] = by_role[role].get(entity, [0] * len(KINDS))
    return numbers


def write_texts() -> Iterator[tuple[Split, Texts]]:
    """Yield the texts of every split. No sentence occurs twice, neither within a split nor across them."""
    chance = random.Random(SEED)
    written: set[str] = set()
    for split in SPLITS:
        writer = Writer(chance)
        texts: Texts = {entity: {role: {} for role in ROLES} for entity in ENTITIES}
        for entity in ENTITIES:
            for role in ROLES:
                for kind, number in zip(KINDS, counts(split, entity, role), strict=True):
                    sentences = texts[entity][role][kind] = []
                    while len(sentences) < number:
                        sentence = writer.sentence(entity, role, kind)
                        if sentence not in written:
                            written.add(sentence)
                            sentences.append(sentence)
        yield split, texts


class Writer:
    """Writes sentences, one after the other, from one stream of random numbers."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self._grammar = grammar()
        self._shares = self._grammar["shares"]
        self._decks: dict[tuple[str, str], list[str]] = {}

    def sentence(self, entity: str, role: str, kind: str) -> str:
        """Write a sentence that says of the entity that it is, or has, the role and how it moves."""
        noise = self._chance.random()
        if kind != UNKNOWN and noise < self._shares["lost_movement"]:
            kind = UNKNOWN
        elif kind != UNKNOWN and noise < self._shares["lost_movement"] + self._shares["wrong_movement"]:
            kind = self._chance.choice([other for other in MOVEMENTS if other != kind])
        text = self._fill(self._template(role, kind), self._slots(entity, role, kind), kind)
        return self._finish(text)

    def _template(self, role: str, kind: str) -> str:
        place = UNKNOWN if kind == UNKNOWN else self._weighted(self._shares["place"][kind])
        if place == "you":
            place = f"you_{kind}"
        has = "has" if self._happens(self._shares["possession"][role]) else "is"
        first = "entity" if self._happens(self._shares["entity_first"]) else "role"
        return self._one_of(self._grammar[place][has][first])

    def _slots(self, entity: str, role: str, kind: str) -> dict[str, Sequence[str]]:
        """Return the phrases that may fill each slot of a template; entity and role are already chosen."""
        grammar = self._grammar
        noun, adjective = self._deal("roles", role), self._deal("adjectives", role)
        synonym = self._deal("entities", entity)
        direct = f"{adjective} {noun}"
        with_role, with_entity = {
            "direct": (direct, synonym),
            "entity": (noun, f"{adjective} {synonym}"),
            "clause": (f"{noun} {self._chance.choice(('that', 'that', 'which'))} is {adjective}", synonym),
            "none": (noun, synonym),
        }[self._weighted(self._shares["adjective"])]
        relatives = grammar["relatives"]["somebody" if entity in grammar["pronouns"] else "something"]
        return {
            "E": [with_entity],
            "R": [with_role],
            "N": [noun if with_role == noun else direct],
            "REL": relatives,
            "WHICH": grammar["relatives"]["something"],
            "IT": grammar["pronouns"].get(entity, ["it"]),
            "THING": grammar["things"].get(kind, ["object"]),
            **grammar["possession"][role],
            **grammar["passive"],
            **grammar.get(kind, {}),
        }

    def _fill(self, phrase: str, slots: Mapping[str, Sequence[str]], kind: str) -> str:
        """Fill the slots of a phrase, recursively."""
        while match := re.search(r"\b[A-Z]+\b", phrase):
            tells_movement = match[0] in ("VP", "VING", "MOD")
            filling = self._deal(kind, match[0]) if tells_movement else self._one_of(slots[match[0]])
            phrase = phrase[: match.start()] + filling + phrase[match.end() :]
        return phrase

    def _finish(self, text: str) -> str:
        """Add articles, contractions, typing mistakes and the full stop to a sentence."""
        shares = self._shares
        noise = self._chance.random()
        if noise < shares["before"]:
            text = f"{self._one_of(self._grammar['around']['before'])} {text}"
        elif noise < shares["before"] + shares["behind"]:
            text = f"{text} {self._one_of(self._grammar['around']['behind'])}"
        if text.startswith("the ") and self._happens(shares["article_a"]):
            text = "a" + text.removeprefix("the")
        text = re.sub(r"\ba (?=[aeiou])(?!one\b)", "an ", text)
        text = re.sub(r"\b(over )?(it|there) is\b", self._contract, text)
        if self._happens(shares["typo"]):
            text = self._slip(text)
        if "'" in text and self._happens(shares["broken_apostrophe"]):
            text = text.replace("'", "â€™")
        return text if self._happens(shares["no_final_stop"]) else f"{text}."

    def _contract(self, match: re.Match[str]) -> str:
        """Sometimes contract "it is" and "there is", but not "the dog over there is ..."."""
        is_contracted = self._happens(0.3)
        return f"{match[2]}'s" if is_contracted and not match[1] else match[0]

    def _slip(self, text: str) -> str:
        """Mistype one word: replace it by another, or drop, double or swap a letter."""
        words = text.split(" ")
        slips = self._grammar["slips"]
        places = [i for i, word in enumerate(words) if word in slips]
        if places and self._happens(0.35):
            place = self._chance.choice(places)
            words[place] = slips[words[place]]
            return " ".join(words)
        place = self._chance.choice([i for i, word in enumerate(words) if len(word) > 3 and word.isalpha()])
        word = words[place]
        letter = self._chance.randrange(1, len(word) - 1)
        words[place] = self._chance.choice(
            (
                word[:letter] + word[letter + 1 :],
                word[:letter] + word[letter] + word[letter:],
                word[:letter] + word[letter + 1] + word[letter] + word[letter + 2 :],
            )
        )
        return " ".join(words)

    def _happens(self, probability: float) -> bool:
        return self._chance.random() < probability

    def _weighted(self, weights: Mapping[str, float]) -> str:
        return self._chance.choices(list(weights), list(weights.values()))[0]

    def _deal(self, table: str, key: str) -> str:
        """Draw from a shuffled deck with as many copies of each phrase as its weight, so that its share is exact."""
        deck = self._decks.setdefault((table, key), [])
        if not deck:
            deck += [
                phrase for phrase, weight in _weights(tuple(self._grammar[table][key])).items() for _ in range(weight)
            ]
            self._chance.shuffle(deck)
        return deck.pop()

    def _one_of(self, phrases: Sequence[str]) -> str:
        """Draw from phrases with weights, written like `plane *41`."""
        return self._weighted(_weights(tuple(phrases)))


@functools.cache
def _weights(phrases: tuple[str, ...]) -> dict[str, int]:
    parts = (phrase.partition(" *") for phrase in phrases)
    return {text: int(weight or 1) for text, _, weight in parts}


def phrases(table: str, key: str) -> list[str]:
    """Return the phrases of one of the grammar's lists, without their weights."""
    return list(_weights(tuple(grammar()[table][key])))


@functools.cache
def grammar() -> dict[str, Any]:
    """Return the contents of `grammar.toml`."""
    return read_table(__package__, "grammar.toml")


def as_json(texts: Texts) -> str:
    """Return texts in the format of the files: one sentence per line."""
    return json.dumps(texts, indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Write the files."""
    for split, texts in write_texts():
        (OUR_TEXTS / f"text_{split}.json").write_text(as_json(texts), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
