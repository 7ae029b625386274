"""Wording: every sentence of this library that a model is sent, in a data file for each version (`v1.toml`).

A record names the version in its config, because a changed word changes the benchmark: what an episode says is read
from `Wording.of(config.prompts)`, whatever the newest version is. A new version is a new file, with the sentences that
are not those of the version before, and another `VERSION`.
Games have their own texts (observations, manuals), and the sentences of the paper's protocol are the paper's.

A user's wording (`load_wording`) has other words for the newest version: every sentence, with the same placeholders.
Its name ends with the digest of its sentences, and a record contains those that differ, so that it replays anywhere.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, TranscriptError, in_one_line
from smartplay_tools.types.tables import read_table

VERSION = "v3"
"""The version that new episodes have, which every transcript contains."""

PARAPHRASES = ("brief", "formal", "friendly")
"""The wordings in this package: the sentences of version 3 in other words."""

_OWN: dict[str, Wording] = {}
"""The wordings that this process has met, by name: readers of prompts know their sentences."""


class Wording:
    """The sentences of one version, by name: `words("noted", tokens=12, cap=40)`."""

    def __init__(self, version: str, texts: Mapping[str, str], name: str = "") -> None:
        self.version = version
        self.texts = texts
        """The sentences by name, with their placeholders."""
        self.name = name or version
        """The version, or the name of a wording with its digest."""

    @property
    def takes_numbers(self) -> bool:
        """Whether `act` takes an action's number as a JSON number, which was a mistake under version 1."""
        return self.version != "v1"

    @property
    def has_grid(self) -> bool:
        """Whether a window with slack moves on the grid (`context.grid`), and not by the fold of earlier versions."""
        return self.version not in ("v1", "v2")

    @staticmethod
    @functools.cache
    def of(version: str) -> Wording:
        """Return a version, or a wording that was met; an unknown one is an `InvalidArgumentError`."""
        if version in _OWN:
            return _OWN[version]
        if version not in versions():
            raise InvalidArgumentError(
                f"There are no prompts {version!r} in this release; it knows {', '.join(versions())}."
            )
        texts: dict[str, str] = {}
        for each in versions()[: versions().index(version) + 1]:
            texts |= read_table(__package__, f"{each}.toml")
        return Wording(version, texts)

    @staticmethod
    def own(version: str, name: str, sentences: Mapping[str, Any]) -> Wording:
        """Return a version with other words; `InvalidArgumentError` if the digest is of others."""
        if name not in _OWN:
            texts = {**Wording.of(version).texts, **sentences}
            _check(name, texts, Wording.of(version).texts)
            if not name.endswith(_digest(texts)):
                raise InvalidArgumentError(f"The sentences of the wording {name} are not those that its digest is of.")
            _OWN[name] = Wording(version, texts, name)
            in_any_version.cache_clear()
            beginnings.cache_clear()
        return _OWN[name]

    @property
    def changed(self) -> dict[str, str]:
        """The sentences that are not those of the version."""
        usual = Wording.of(self.version).texts
        return {name: text for name, text in self.texts.items() if text != usual[name]}

    @staticmethod
    def recorded(start: Mapping[str, Any]) -> Wording:
        """Return the wording in the start event of a record; `TranscriptError` if this release does not have it."""
        version = start["config"].get("prompts", VERSION)
        try:
            words = Wording.of(version)
        except InvalidArgumentError:
            known = ", ".join(versions())
            raise TranscriptError(
                f"The record was made with prompts {version!r}, which this release does not know; it knows {known}. "
                "Use the release that made it, or a later one."
            ) from None
        if (name := start["config"].get("wording")) is None:
            return words
        try:
            return Wording.own(version, name, start["config"].get("sentences", {}))
        except InvalidArgumentError as error:
            raise TranscriptError(f"The record cannot be read: {error}") from None

    def __call__(self, name: str, /, **values: object) -> str:
        """Return a sentence with values for all its placeholders; without any it is returned as it is written."""
        text = self.texts[name]
        return text.format(**values) if values else text

    def around(self, name: str, placeholder: str) -> tuple[str, str]:
        """Return what a sentence says before a placeholder, and what it says after it."""
        before, _, after = self.texts[name].partition(f"{{{placeholder}}}")
        return before, after

    def cut(self, missing: int) -> str:
        """Return the notice in a text that was cut."""
        return self("cut", missing=missing)

    def __reduce__(self) -> tuple[Any, ...]:
        return (
            (Wording.of, (self.version,))
            if self.name == self.version
            else (Wording.own, (self.version, self.name, self.changed))
        )


def load_wording(place: str) -> Wording:
    """Return the wording of a file, or a paraphrase of this package; `InvalidArgumentError` if it is not complete."""
    import tomllib

    path = resources.files(__package__).joinpath(f"{place}.toml") if place in PARAPHRASES else Path(place)
    try:
        texts = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        named = ", ".join(PARAPHRASES)
        raise InvalidArgumentError(
            f"The prompts {place} cannot be read ({error.strerror}); name a file, or a paraphrase: {named}."
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidArgumentError(f"{place} is not TOML: {in_one_line(error)}.") from None
    usual = Wording.of(VERSION).texts
    texts = {**usual, **texts} if place in PARAPHRASES else texts
    _check(place, texts, usual)
    name = f"{Path(place).stem}-{_digest(texts)}"
    return Wording.own(VERSION, name, {key: text for key, text in texts.items() if text != usual[key]})


def _check(place: str, texts: Mapping[str, Any], usual: Mapping[str, str]) -> None:
    """Raise an `InvalidArgumentError` unless these are all sentences of a version, with its placeholders."""
    if missing := [name for name in usual if name not in texts]:
        raise InvalidArgumentError(
            f"The prompts {place} lack {', '.join(missing[:5])}; give every sentence of {VERSION}."
        )
    if unknown := [name for name in texts if name not in usual]:
        raise InvalidArgumentError(f"The prompts {place} have {', '.join(unknown[:5])}, which no sentence is called.")
    for name, text in texts.items():
        if not isinstance(text, str) or not text.strip():
            raise InvalidArgumentError(f"The prompts {place} have no text for {name}; write a sentence.")
        wanted, found = _parts(usual[name]), _parts(text)
        must_begin = name in ("error", "episode_is_over")  # readers of prompts know these by their beginning
        if sorted(wanted[1:]) != sorted(found[1:]) or (must_begin and not found[0].strip()):
            places = " ".join(f"{{{each}}}" for each in wanted[1:]) or "no placeholder"
            begins = ", after a word of its own" if must_begin else ""
            raise InvalidArgumentError(f"{name} in the prompts {place} must have {places}, once each{begins}.")


def _parts(text: str) -> list[str]:
    """The text before the first placeholder, and the names of all placeholders."""
    return [re.split(r"{\w+}", text)[0], *re.findall(r"{(\w+)}", text)]


def _digest(texts: Mapping[str, str]) -> str:
    return hashlib.sha256("".join(f"{name}\t{text!r}\n" for name, text in sorted(texts.items())).encode()).hexdigest()[
        :16
    ]


def known() -> Sequence[str]:
    """Return the names of all versions, and of the wordings that this process has met."""
    return (*versions(), *_OWN)


@functools.cache
def versions() -> Sequence[str]:
    """Return all versions that this release has, oldest first."""
    names = (file.name.removesuffix(".toml") for file in resources.files(__package__).iterdir() if file.name[0] == "v")
    return sorted((name for name in names if name[1:].isdecimal()), key=lambda name: int(name[1:]))


@functools.cache
def in_any_version(name: str) -> tuple[str, ...]:
    """Return a sentence in every version, for readers of prompts, which do not say with which they were made."""
    return tuple(dict.fromkeys(Wording.of(version)(name) for version in known()))


@functools.cache
def beginnings(name: str) -> tuple[str, ...]:
    """Return how a sentence begins in every version, up to its first placeholder."""
    return tuple(dict.fromkeys(text.partition("{")[0] for text in in_any_version(name)))
