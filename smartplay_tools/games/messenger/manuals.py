"""The sentences of a manual: reading the texts, and drawing the sentences of an episode.

Texts have the structure of the original's data set: entity -> role -> movement -> sentences, where the movement
"unknown" has the sentences that do not mention it. Ours are in the folder `texts`; a user who has the original's files
can name their folder and play with those.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType

from numpy.random import Generator

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.games.messenger import rules

Texts = dict[str, dict[str, dict[str, list[str]]]]

ROLES = ("enemy", "message", "goal")
UNKNOWN = "unknown"
UNKNOWN_PROBABILITY = 0.15
"""The probability that a sentence of level 2 does not mention the movement."""

TEXTS_VARIABLE = "SMARTPLAY_MESSENGER_TEXTS"
"""The environment variable that names a folder of texts, for programs that cannot pass the option."""

OUR_TEXTS = Path(__file__).parent / "texts"

_NAMED: dict[Path, None] = {}
"""The folders that the user has named in this process, and that could be read."""

GRAMMAR, ORIGINAL = "grammar", "original"

ORIGINAL_SHA256 = MappingProxyType(
    {
        "train": "84947d99a9bc36dc5573065ae3ebf85bcf33155afc55f8b21115db1ef5c23623",
        "val": "0f123ffcb646cbe2bf94c1973b536576895827ac5a2c7150cd5d676bbaec990d",
        "test": "0501905522e051d0d84598d4881a08484d64ff1a3bdbf2f9f4fe48d54cf2826a",
    }
)
"""The sha256 of the original's `text_{split}.json`, by split."""


def choose_folder(texts: str | os.PathLike[str] | None, split: rules.Split, sentences: str | None = None) -> Path:
    """Return the folder to read: the one that is named, by the argument or the environment variable, or else ours.

    If `sentences` says which sentences are wanted (see `identify`), it is the first of these that holds them, or one
    that the argument has named before: a record gives the sentences, and no folder.

    Raises:
        InvalidArgumentError: none of them holds the sentences that are wanted.
    """
    named = [Path(folder) for folder in (texts, os.environ.get(TEXTS_VARIABLE)) if folder]
    if sentences is None:
        chosen = named[0] if named else OUR_TEXTS
        load(chosen, split)
    else:
        for chosen in (*named, *_NAMED, OUR_TEXTS):
            if (chosen / _file_name(split)).is_file() and identify(chosen, split) == sentences:
                break
        else:
            raise InvalidArgumentError(
                f"The sentences {sentences!r} of the split {split!r} are not here: "
                f"name the folder that holds them in {TEXTS_VARIABLE}."
            )
    if texts:
        _NAMED[chosen] = None
    return chosen


@functools.cache
def identify(folder: Path, split: rules.Split) -> str:
    """Return which sentences a split has in a folder: "grammar" (ours), "original", or "other:" and their sha256."""
    load(folder, split)
    content = _sha256(folder, split)
    names = {_sha256(OUR_TEXTS, split): GRAMMAR, ORIGINAL_SHA256[split]: ORIGINAL}
    return names.get(content, f"other:{content[:16]}")


def _sha256(folder: Path, split: rules.Split) -> str:
    return hashlib.sha256((folder / _file_name(split)).read_bytes()).hexdigest()


def _file_name(split: rules.Split) -> str:
    return f"text_{split}.json"


@functools.cache
def load(folder: Path, split: rules.Split) -> Texts:
    """Read the texts of a split: the file `text_{split}.json` of the folder."""
    check_choice("split", split, rules.SPLITS)
    file = folder / _file_name(split)
    try:
        texts: Texts = json.loads(file.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InvalidArgumentError(
            f"There is no {file}: texts must name a folder with text_train.json, text_val.json and text_test.json."
        ) from None
    except ValueError as error:
        raise InvalidArgumentError(f"{file} is not JSON in UTF-8: {error}.") from None
    for entity, role in _pairs_played(split):
        for movement in rules.MOVEMENTS:
            try:
                sentences = texts[entity][role][movement]
            except (KeyError, TypeError, IndexError):
                sentences = []
            if not (isinstance(sentences, list) and sentences and all(isinstance(s, str) for s in sentences)):
                raise InvalidArgumentError(
                    f"{file} does not have the structure entity -> role -> movement -> sentences: "
                    f"nothing to read at {entity} -> {role} -> {movement}."
                )
    return texts


def _pairs_played(split: rules.Split) -> Iterator[tuple[str, str]]:
    """Yield every (entity, role) that a manual of the split can need, including those of decoys."""
    for game in rules.GAMES[split]:
        yield from zip(game, ROLES, strict=True)
        yield from ((game.message, "enemy"), (game.goal, "enemy"))


def draw(
    level: int, game: rules.Game, movements: Sequence[rules.Movement], texts: Texts, chance: Generator
) -> list[str]:
    """Draw the sentences of an episode, in random order."""
    sentences = []
    for entity, role, movement in zip(game, ROLES, movements, strict=False):  # decoys: below
        by_movement = texts[entity][role]
        unknown = by_movement.get(UNKNOWN, [])
        if level == 1:
            pool = by_movement["immovable"] + unknown
        elif level == 2 and unknown and chance.random() < UNKNOWN_PROBABILITY:
            pool = unknown
        else:
            pool = by_movement[movement]
        sentences.append(rules.pick(pool, chance))
    if level == 3:
        for entity, movement in zip((game.message, game.goal), movements[3:], strict=True):
            sentences.append(rules.pick(texts[entity]["enemy"][movement], chance))
        sentences.append(_false_lead(game.enemy, movements[0], texts, chance))
    return rules.shuffled(sentences, chance)


def _false_lead(enemy: str, movement: rules.Movement, texts: Texts, chance: Generator) -> str:
    """Draw a sentence that calls the enemy's entity message or goal, with a movement that it does not have."""
    other = rules.pick([m for m in rules.MOVEMENTS if m != movement], chance)
    for role in rules.shuffled(("message", "goal"), chance):
        if pool := texts[enemy].get(role, {}).get(other):
            return rules.pick(pool, chance)
    raise InvalidArgumentError(f"No sentence of the manuals describes {enemy} as a message or goal that is {other}.")
