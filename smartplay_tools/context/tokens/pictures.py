"""Rules by which providers count the tokens of a picture: here the ways to count, in the files of providers the rules.

A rule is a part of the tokenizer: `o200k_base+claude-28` counts words with o200k_base and pictures by `claude-28`, and
records have that name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from fractions import Fraction
from typing import Any

from smartplay_tools.providers.tables import merged

__all__ = ["RULES", "PictureRule"]


@dataclass(frozen=True)
class PictureRule:
    """A provider's rule."""

    name: str
    title: str
    """The models that count so."""
    way: str
    examples: Sequence[tuple[int, int, int]]
    """Width, height and tokens, as the source has them."""
    source: str
    read_on: date
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def count(self, width: int, height: int) -> int:
        """Return the tokens of a picture of this many pixels."""
        return _WAYS[self.way](width, height, **self.numbers)


def _patches(width: int, height: int, side: int) -> int:
    return math.ceil(width / side) * math.ceil(height / side)


def _claude(width: int, height: int, *, edge: int, most: int) -> int:
    """Patches of 28 pixels after scaling down to `edge`; a picture with more than `most` is scaled down to `most`."""
    longest = max(width, height)
    if longest > edge:
        width, height = max(1, width * edge // longest), max(1, height * edge // longest)
    return min(most, _patches(width, height, 28))


def _openai_patches(width: int, height: int, *, factor: str, most: int = 1_536) -> int:
    """Patches of 32 pixels, after scaling down to at most `most` of them, times the model's factor, rounded up."""
    patches = _patches(width, height, 32)
    if patches > most:
        shrink = math.sqrt(32**2 * most / (width * height))
        across, down = width * shrink / 32, height * shrink / 32
        shrink *= min(math.floor(across) / across, math.floor(down) / down)
        # Whole patches, but for the rounding of floats.
        patches = min(most, math.ceil(width * shrink / 32 - 1e-6) * math.ceil(height * shrink / 32 - 1e-6))
    return math.ceil(patches * Fraction(factor))


def _openai_tiles(width: int, height: int, *, base: int, tile: int) -> int:
    """`base` plus `tile` per 512-pixel tile, after scaling down into 2,048 x 2,048 and to a shorter side of 768."""
    shrink = min(Fraction(1), Fraction(2_048, max(width, height)))
    shrink = min(shrink, Fraction(768, min(width, height)))
    return base + tile * math.ceil(width * shrink / 512) * math.ceil(height * shrink / 512)


def _gemini_tiles(width: int, height: int) -> int:
    """258; if a side has over 384 pixels, 258 for each tile, whose side is two thirds of the picture's shorter side."""
    if max(width, height) <= 384:
        return 258
    side = max(1, math.floor(min(width, height) / 1.5))
    return 258 * _patches(width, height, side)


def _always(width: int, height: int, *, tokens: int) -> int:
    return tokens


_WAYS: Mapping[str, Callable[..., int]] = {
    "claude": _claude,
    "openai_patches": _openai_patches,
    "openai_tiles": _openai_tiles,
    "gemini_tiles": _gemini_tiles,
    "always": _always,
}


RULES: Mapping[str, PictureRule] = {name: PictureRule(name, **fields) for name, fields in merged("pictures").items()}
"""Every rule by its name."""
