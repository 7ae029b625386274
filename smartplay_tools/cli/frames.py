"""Pictures of an episode, one for every step, as PNG files.

A game that draws itself, as Crafter does, is shown as it draws itself; of any other game the picture is the text that
its player reads. All pictures of text have one size, so that they can be made into a video.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from smartplay_tools.games.base import TextGame
from smartplay_tools.games.specs import get_spec

if TYPE_CHECKING:
    from PIL.Image import Image

SIZE = (960, 540)
"""Pixels of a picture of text."""

MARGIN = 24
LARGEST, SMALLEST = 24, 9
"""Font sizes: the largest at which the text fits is taken."""

PAPER, INK, FAINT = "#ffffff", "#1b1b1b", "#6e6e6e"


def picture_options(game: str) -> dict[str, str]:
    """Return the options with which a game draws itself; none if it is shown as text."""
    draws_itself = "rgb_array" in get_spec(game).load().metadata["render_modes"]
    return {"render_mode": "rgb_array"} if draws_itself else {}


class FrameWriter:
    """Writes `<step>.png` after every step, and `00000.png` for the start, into a folder."""

    def __init__(self, folder: Path, game: TextGame) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._step = 0
        self._write(game)

    def __call__(self, game: TextGame) -> None:
        """Write the picture of the step that was just played."""
        self._step += 1
        self._write(game)

    def _write(self, game: TextGame) -> None:
        from PIL import Image

        drawn = game.render()
        picture = text_picture(drawn, self._step) if isinstance(drawn, str) else Image.fromarray(drawn)
        picture.save(self._folder / f"{self._step:05}.png")


def text_picture(text: str, step: int) -> Image:
    """Return a picture of an observation. A text that does not fit at the smallest font makes the picture higher."""
    from PIL import Image, ImageDraw, ImageFont

    width, height = SIZE
    for size in range(LARGEST, SMALLEST - 1, -1):
        font: Any = ImageFont.load_default(size)
        lines = [part for line in text.split("\n") for part in _wrapped(line, font, width - 2 * MARGIN)]
        spacing = round(1.4 * size)
        needed = 3 * MARGIN + spacing * (len(lines) + 1)
        if needed <= height:
            break
    picture = Image.new("RGB", (width, max(height, needed)), PAPER)
    draw = ImageDraw.Draw(picture)
    draw.text((MARGIN, MARGIN), f"step {step}", fill=FAINT, font=font)
    for number, line in enumerate(lines, start=1):
        draw.text((MARGIN, 2 * MARGIN + spacing * number), line, fill=INK, font=font)
    return picture


def _wrapped(line: str, font: Any, width: int) -> list[str]:
    """Return a line in parts that fit the width, broken at spaces, and within longer words."""
    parts, rest = [], line
    while font.getlength(rest) > width:
        fits = next(n for n in range(len(rest) - 1, 0, -1) if n == 1 or font.getlength(rest[:n]) <= width)
        space = rest.rfind(" ", 0, fits + 1)
        at = space if space > 0 else fits
        parts.append(rest[:at])
        rest = rest[at:].removeprefix(" ")
    return [*parts, rest]
