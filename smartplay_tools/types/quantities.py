"""Counts and durations as short text, the same in terminals, notebooks and papers; signs as they are printed."""

from __future__ import annotations

import re

from smartplay_tools.visible import visible

__all__ = ["duration", "figure", "megabytes", "short", "typeset"]


def short(number: float) -> str:
    """Return a count in five characters or so: 1234567 is 1.2M."""
    for unit, size in (("G", 1_000_000_000), ("M", 1_000_000), ("k", 1_000)):
        if number >= size:
            return f"{number / size:.1f}{unit}"
    return f"{number:.0f}"


def duration(seconds: float) -> str:
    """Return a time in seconds, minutes or hours: 5400 is 1.5 h."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def megabytes(count: float) -> str:
    """Return a number of bytes in millions: 98362432 is 98 MB."""
    return f"{count / 1_000_000:,.0f} MB"


def figure(value: float | None, digits: int = 2) -> str:
    """Print a number for people; None is a dash."""
    if value is None:
        return "\N{EN DASH}"
    return f"{value:,.{digits}f}".replace("-", "\N{MINUS SIGN}")


def typeset(text: str) -> str:
    """Return a visible text with the signs of print, where a terminal has others: at most, plus or minus, and minus."""
    return re.sub(r"<=|\+-|(?<![\w-])-(?=\d)", lambda sign: _SIGNS[sign[0]], visible(text))


_SIGNS = {"<=": "\N{LESS-THAN OR EQUAL TO}", "+-": "\N{PLUS-MINUS SIGN}", "-": "\N{MINUS SIGN}"}
