"""Wording: every sentence of this library that a model is sent, in a data file for each version (`v1.toml`).

A record names the version in its config, because a changed word changes the benchmark: what an episode says is read
from `Wording.of(config.prompts)`, whatever the newest version is. A new version is a new file, with the sentences that
are not those of the version before, and another `VERSION`.
Games have their own texts (observations, manuals), and the sentences of the paper's protocol are the paper's.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from smartplay_tools.errors import InvalidArgumentError, TranscriptError
from smartplay_tools.types.tables import read_table

VERSION = "v3"
"""The version that new episodes have, which every transcript contains."""


class Wording:
    """The sentences of one version, by name: `words("noted", tokens=12, cap=40)`."""

    def __init__(self, version: str, texts: Mapping[str, str]) -> None:
        self.version = version
        self.texts = texts
        """The sentences by name, with their placeholders."""

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
        """Return a version; one that this release does not have is an `InvalidArgumentError`."""
        if version not in versions():
            raise InvalidArgumentError(
                f"There are no prompts {version!r} in this release; it knows {', '.join(versions())}."
            )
        texts: dict[str, str] = {}
        for each in versions()[: versions().index(version) + 1]:
            texts |= read_table(__package__, f"{each}.toml")
        return Wording(version, texts)

    @staticmethod
    def recorded(start: Mapping[str, Any]) -> Wording:
        """Return the version in the start event of a record; `TranscriptError` if this release does not have it."""
        version = start["config"].get("prompts", VERSION)
        try:
            return Wording.of(version)
        except InvalidArgumentError:
            known = ", ".join(versions())
            raise TranscriptError(
                f"The record was made with prompts {version!r}, which this release does not know; it knows {known}. "
                "Use the release that made it, or a later one."
            ) from None

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
        return Wording.of, (self.version,)


@functools.cache
def versions() -> Sequence[str]:
    """Return all versions that this release has, oldest first."""
    names = (file.name.removesuffix(".toml") for file in resources.files(__package__).iterdir() if file.name[0] == "v")
    return sorted((name for name in names if name[1:].isdecimal()), key=lambda name: int(name[1:]))


@functools.cache
def in_any_version(name: str) -> tuple[str, ...]:
    """Return a sentence in every version, for readers of prompts, which do not say with which they were made."""
    return tuple(dict.fromkeys(Wording.of(version)(name) for version in versions()))


@functools.cache
def beginnings(name: str) -> tuple[str, ...]:
    """Return how a sentence begins in every version, up to its first placeholder."""
    return tuple(dict.fromkeys(text.partition("{")[0] for text in in_any_version(name)))
