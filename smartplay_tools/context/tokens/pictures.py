"""Rules by which providers count the tokens of a picture, each with the page and the day on which it was read.

A rule is a part of the tokenizer: `o200k_base+claude-28` counts words with o200k_base and pictures by `claude-28`, and
records have that name. Providers change their rules and do not always publish them whole, so a rule here is never
changed: another one gets another name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from fractions import Fraction
from functools import partial

__all__ = ["RULES", "PictureRule"]

Count = Callable[[int, int], int]
"""Width and height, in pixels, to tokens."""


@dataclass(frozen=True)
class PictureRule:
    """A provider's rule."""

    name: str
    title: str
    """The models that count so."""
    count: Count
    examples: Mapping[tuple[int, int], int]
    """(width, height) to tokens, as the source has them."""
    source: str
    read_on: date


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


_READ_ON = date(2026, 11, 24)
_CLAUDE = "https://platform.claude.com/docs/en/build-with-claude/vision"
_OPENAI = "https://platform.openai.com/docs/guides/images-vision"
_GEMINI = "https://ai.google.dev/gemini-api/docs/image-understanding"
_GEMINI_3 = "https://ai.google.dev/gemini-api/docs/media-resolution"
_COUNTED = "https://community.openai.com/t/introducing-gpt-5-4-mini-and-nano-our-most-capable-small-models-yet/1377015"
_MEASURED = "https://huggingface.co/datasets/JOHNISKING/image-token-cost"

_RULES = (
    PictureRule(
        "claude-28",
        "Claude, up to 1,568 pixels and tokens",
        partial(_claude, edge=1_568, most=1_568),
        {(200, 200): 64, (1_000, 1_000): 1_296, (1_092, 1_092): 1_521},
        _CLAUDE,
        _READ_ON,
    ),
    PictureRule(
        "claude-28-high",
        "Claude, high resolution: up to 2,576 pixels and 4,784 tokens",
        partial(_claude, edge=2_576, most=4_784),
        {(200, 200): 64, (1_000, 1_000): 1_296, (1_928, 1_928): 4_761},
        _CLAUDE,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x1.2",
        "GPT-5 mini as it is billed, and later models where a picture has up to 1,536 patches",
        partial(_openai_patches, factor="1.2"),
        {(256, 256): 77, (512, 512): 308, (768, 1_024): 922, (1_280, 720): 1_104, (1_024, 1_024): 1_229},
        _COUNTED,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x1.2-2500",
        "GPT-5.4 and later, high detail: up to 2,500 patches",
        partial(_openai_patches, factor="1.2", most=2_500),
        {(768, 768): 692, (1_920, 1_080): 2_448, (2_560, 1_440): 2_931, (3_840, 2_160): 2_931, (4_032, 3_024): 2_942},
        _MEASURED,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x1.5",
        "GPT-5 nano as it is billed",
        partial(_openai_patches, factor="1.5"),
        {(1_600, 1_600): 2_282},
        _COUNTED,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x1.62",
        "GPT-4.1 mini, and others of a factor of 1.62",
        partial(_openai_patches, factor="1.62"),
        {(1_024, 1_024): 1_659, (1_800, 2_400): 2_353},
        _OPENAI,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x1.72",
        "o4-mini",
        partial(_openai_patches, factor="1.72"),
        {(1_024, 1_024): 1_762, (1_800, 2_400): 2_498},
        _OPENAI,
        _READ_ON,
    ),
    PictureRule(
        "openai-32x2.46",
        "GPT-4.1 nano, and others of a factor of 2.46",
        partial(_openai_patches, factor="2.46"),
        {(1_024, 1_024): 2_520, (1_800, 2_400): 3_572},
        _OPENAI,
        _READ_ON,
    ),
    *(
        PictureRule(
            name,
            f"{models}, high detail",
            partial(_openai_tiles, base=base, tile=2 * base),
            {(1_024, 1_024): 9 * base, (2_048, 4_096): 13 * base},
            _OPENAI,
            _READ_ON,
        )
        for name, models, base in (
            ("openai-tiles", "GPT-4o and GPT-4.1", 85),
            ("openai-tiles-70", "GPT-5", 70),
            ("openai-tiles-75", "o1 and o3", 75),
        )
    ),
    PictureRule(
        "gemini-258",
        "Gemini 2",
        _gemini_tiles,
        {(384, 384): 258, (960, 540): 1_548},
        _GEMINI,
        _READ_ON,
    ),
    *(
        PictureRule(
            f"gemini3-{resolution}",
            f"Gemini 3, media resolution {resolution}",
            partial(_always, tokens=tokens),
            {(252, 252): tokens, (3_840, 2_160): tokens},
            _GEMINI_3,
            _READ_ON,
        )
        for resolution, tokens in (("low", 280), ("medium", 560), ("high", 1_120), ("ultra-high", 2_240))
    ),
)

RULES: Mapping[str, PictureRule] = {rule.name: rule for rule in _RULES}
"""Every rule by its name."""
