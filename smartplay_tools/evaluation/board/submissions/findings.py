"""Findings: what the check of a submission has to say, one sentence each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

LONGEST_TEXT = 500
"""Characters of a finding; texts in it can come from the bundle."""


@dataclass(frozen=True)
class Finding:
    """Something found in a submission."""

    level: Literal["error", "remark"]
    """An error means that the submission is not verified; a remark is something that a reader should know."""
    kind: str
    """What it is about, in a word: bundle, metadata, plan, seed, suite, coverage, record, row, budget, prompts,
    privileged, engine, end, attempts, results."""
    text: str
    key: str | None = None
    """The episode, if it is about one."""


def error(kind: str, text: str, key: str | None = None) -> Finding:
    """Return an error."""
    return Finding("error", kind, printable(text), key)


def remark(kind: str, text: str, key: str | None = None) -> Finding:
    """Return a remark."""
    return Finding("remark", kind, printable(text), key)


def printable(text: str, longest: int = LONGEST_TEXT) -> str:
    """Return a text as one line without control characters, which a terminal would obey, and cut if it is long."""
    shown = "".join(
        char if char.isprintable() else " " if char.isspace() else "\N{REPLACEMENT CHARACTER}" for char in text
    )
    shown = " ".join(shown.split())
    return shown if len(shown) <= longest else shown[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"


def some(names: Iterable[object], most: int = 5) -> str:
    """Return names with commas between them, and how many more there are."""
    listed = list(names)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(map(str, listed[:most])) + more
