"""A player that reads Crafter's pictures: it puts what the pixels show into the game's words, and plays as `rule` does.

    smartplay-tools play Crafter-v0 --observation picture --player experiments/rule_pixels.py:RulePixelsPlayer

It shows that a picture says what the words say: by day it plays the same actions. It looks at pictures only, even where
words are sent with them. `docs/pictures.md` says what a picture of Crafter cannot say.

By day every cell is compared with all that it can show in the light of every hour, and is identified exactly. At night
the original covers the view with noise, which is the same in red, green and blue: what it leaves are their differences,
and the most likely cell is taken. In the corners of the darkest hours nothing is left, and grass is assumed.

Pictures of other sizes than the usual one are not read.
"""

from __future__ import annotations

import functools
import io
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.context.prompts.wording import in_any_version
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.crafter.creatures import light
from smartplay_tools.games.crafter.facts import (
    AREA,
    ARROW,
    CARRIED,
    COW,
    MATERIALS,
    MOST,
    PLANT,
    PLAYER,
    SKELETON,
    VIEW,
    ZOMBIE,
)
from smartplay_tools.games.crafter.pictures import (
    BODIES,
    BRIGHTEST_GRAIN,
    DARKEST_GRAIN,
    GRID,
    LAYERS,
    NIGHT,
    SATURATION,
    UNIT,
    asleep,
    lit,
    tiles,
    vignette,
)
from smartplay_tools.games.crafter.text import describe
from smartplay_tools.games.crafter.views import Scene, Sight
from smartplay_tools.games.crafter.world import COLUMN, EAST, NORTH, SOUTH, WEST, place
from smartplay_tools.players.rule import RulePlayer
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message, pictures_of, text_of
from smartplay_tools.types.pictures import Picture

HOURS = 300
"""The steps of a day."""

SLEEPING = LAYERS.index("player-sleep")
_SIDES = {"left": WEST, "right": EAST, "up": NORTH, "down": SOUTH}
FACING = {LAYERS.index(f"player-{side}"): at for side, at in _SIDES.items()}
"""By layer: where the player looks."""

_THINGS = {"player": PLAYER, "cow": COW, "zombie": ZOMBIE, "skeleton": SKELETON, "arrow": ARROW, "plant": PLANT}
SHOWN = (0, *(_THINGS[body.partition("-")[0]] for body in BODIES))
"""By layer: the id of what the text names; 0 where it names the ground."""

_COLUMNS, _ROWS = VIEW
_CENTER = (_COLUMNS // 2) * _ROWS + _ROWS // 2
_WALKED = [MATERIALS.index(name) + 1 for name in ("grass", "sand", "path")]
_LIKELY = [(ground, 0) for ground in range(len(MATERIALS) + 1)]
_LIKELY += [(ground, layer) for layer in range(1, len(LAYERS)) for ground in _WALKED]
"""What a cell is likely to show: a ground, or a thing on one that can be walked on."""

Cells = list[tuple[int, int]]
"""Ground and layer of each cell of the view, column by column."""


@dataclass(frozen=True)
class PictureView:
    """What a picture shows."""

    cells: Cells
    amounts: dict[str, int]

    @property
    def sleeping(self) -> bool:
        """Whether the player is asleep."""
        return self.cells[_CENTER][1] == SLEEPING

    @property
    def facing(self) -> int | None:
        """Where the player looks, which a picture of it asleep does not show."""
        return FACING.get(self.cells[_CENTER][1])

    def text(self, facing: int) -> str:
        """Return the observation in the game's words, the action apart; `facing` is where a sleeper looks."""
        surface = bytearray(COLUMN * COLUMN)
        outside_left = sum(self.cells[x * _ROWS + _ROWS // 2][0] == 0 for x in range(_COLUMNS // 2))
        outside_above = sum(self.cells[(_COLUMNS // 2) * _ROWS + y][0] == 0 for y in range(_ROWS // 2))
        # Far from the border unless it is in view: the text says nothing near the border.
        x = _COLUMNS // 2 - outside_left if outside_left else AREA // 2
        y = _ROWS // 2 - outside_above if outside_above else AREA // 2
        at = place(x, y)
        for number, (ground, layer) in enumerate(self.cells):
            across, down = number // _ROWS - _COLUMNS // 2, number % _ROWS - _ROWS // 2
            surface[at + across * COLUMN + down] = SHOWN[layer] or ground
        sight = Sight(surface, at, self.facing or facing, self.amounts, self.sleeping)
        return describe(sight, dead=not self.amounts["health"])


def read_picture(picture: Picture) -> PictureView:
    """Return what a picture shows; a picture of another size is an `InvalidArgumentError`."""
    return _read(picture.sha256, picture)


@functools.lru_cache(64)
def _read(sha256: str, picture: Picture) -> PictureView:
    # Only pictures need the imaging library.
    from PIL import Image

    with Image.open(io.BytesIO(picture.png)) as image:
        whole = np.array(image)
    scale = picture.width // (GRID * UNIT)
    pixels = whole[::scale, ::scale] if scale else whole
    if not np.array_equal(whole, pixels.repeat(scale, 0).repeat(scale, 1)) or pixels.shape[:2] != (GRID * UNIT,) * 2:
        raise InvalidArgumentError("rule-pixels reads pictures of Crafter at picture_size=64 only.")
    cells = pixels.reshape(GRID, UNIT, GRID, UNIT, 3).transpose(2, 0, 4, 1, 3)
    view, below = cells[:, :_ROWS].reshape(-1, 3 * UNIT * UNIT), cells[:, _ROWS:]
    return PictureView(_by_day(view) or _by_night(view), _amounts(below))


def _amounts(cells: NDArray[np.uint8]) -> dict[str, int]:
    """The vitals and items below the view, which are always lit."""
    digits, amounts = _carried(), {}
    for number, name in enumerate(CARRIED):
        amounts[name] = digits[number].get(cells[number % GRID, number // GRID].tobytes(), 0)
    return amounts


@functools.cache
def _carried() -> list[dict[bytes, int]]:
    return [{item[amount].tobytes(): amount for amount in range(1, MOST + 1)} for item in tiles(UNIT).carried]


# By day.


@functools.cache
def _daylights() -> list[float]:
    return sorted({light(hour).daylight for hour in range(HOURS)}, reverse=True)


@functools.cache
def _appearances(daylight: float, *, is_asleep: bool) -> dict[bytes, tuple[int, int]]:
    """By the bytes of a cell: what it shows by day."""
    table = tiles(UNIT).cells
    grounds, layers = table.shape[:2]
    planes = table.transpose(2, 0, 1, 3, 4).reshape(3, -1, UNIT)
    seen = lit(planes, cast(Scene, SimpleNamespace(daylight=daylight, grain=None)))
    shown = asleep(seen) if is_asleep else seen.astype(np.uint8)
    cells = shown.reshape(3, grounds * layers, UNIT, UNIT).transpose(1, 0, 2, 3)
    return {cells[at].tobytes(): divmod(at, layers) for at in reversed(range(grounds * layers))}


def _by_day(view: NDArray[np.uint8]) -> Cells | None:
    """Every cell of a view without noise; None if there is no such light."""
    shown = [cell.tobytes() for cell in np.ascontiguousarray(view)]
    for daylight in _daylights():
        if daylight < 0.5:
            break
        for is_asleep in (False, True):
            appearances = _appearances(daylight, is_asleep=is_asleep)
            center = appearances.get(shown[_CENTER])
            if center is None or (center[1] == SLEEPING) != is_asleep:
                continue
            cells = [appearances.get(cell) for cell in shown]
            if None not in cells:
                return cast(Cells, cells)
    return None


# At night.


@dataclass(frozen=True)
class _Expected:
    """What each cell shows at night, by cell, candidate and pixel, apart from the noise."""

    differences: NDArray[np.float32]
    """Red, green and blue, less their mean."""
    brightness: NDArray[np.float32]
    """Their mean, with the noise's."""
    spread: NDArray[np.float32]
    """How far the noise can change it."""


@functools.lru_cache(16)
def _expected(daylight: float, first: int = 0, stop: int = _COLUMNS * _ROWS) -> _Expected:
    table = np.stack([tiles(UNIT).cells[ground, layer] for ground, layer in _LIKELY])
    colours = table.reshape(len(_LIKELY), 3, -1).transpose(0, 2, 1).astype(np.float32)
    strength = _strength(daylight)[first:stop, None, :, None]
    noise = (DARKEST_GRAIN + BRIGHTEST_GRAIN) / 2
    dark = (1 - strength) * colours[None] + strength * noise
    grey = dark @ np.array([0.299, 0.587, 0.114], np.float32)
    faded = grey[..., None] + SATURATION * (dark - grey[..., None])
    seen = daylight * colours[None] + (1 - daylight) * (0.5 * faded + 0.5 * np.array(NIGHT, np.float32))
    mean = seen.mean(axis=-1)
    spread = (1 - daylight) * 0.5 * strength[..., 0] * (BRIGHTEST_GRAIN - DARKEST_GRAIN) / 2
    return _Expected(seen - mean[..., None], mean, np.broadcast_to(spread, mean.shape))


@functools.lru_cache(256)
def _strength(daylight: float) -> NDArray[np.float32]:
    """The share of noise in each pixel, by cell."""
    whole = (2 * (0.5 - daylight) * vignette(_COLUMNS * UNIT, _ROWS * UNIT)).astype(np.float32)
    return whole.reshape(_ROWS, UNIT, _COLUMNS, UNIT).transpose(2, 0, 1, 3).reshape(_COLUMNS * _ROWS, UNIT * UNIT)


def _misfit(seen: NDArray[np.float32], expected: _Expected) -> NDArray[np.float32]:
    """How badly each cell fits each candidate."""
    mean = seen.mean(axis=-1)
    differences = ((seen - mean[..., None])[:, None] - expected.differences) ** 2
    beyond = np.maximum(np.abs(mean[:, None] - expected.brightness) - expected.spread - 1, 0) ** 2
    misfit: NDArray[np.float32] = differences.sum(axis=(-2, -1)) + beyond.sum(axis=-1)
    return misfit


def _by_night(view: NDArray[np.uint8]) -> Cells:
    """The most likely cells of a view with noise; the hour is that in which the player in the middle fits best."""
    seen = view.reshape(-1, 3, UNIT * UNIT).transpose(0, 2, 1).astype(np.float32)
    if (seen[..., 0] == seen[..., 1]).all():
        return _in_sleep(seen)
    middle = slice(_CENTER, _CENTER + 1)
    nights = [daylight for daylight in _daylights() if daylight < 0.5]
    players = [at for at, (_, layer) in enumerate(_LIKELY) if layer in FACING]
    fits = [float(_misfit(seen[middle], _middle(daylight))[0, players].min()) for daylight in nights]
    daylight = nights[int(np.argmin(fits))]
    misfit = _misfit(seen, _expected(daylight))
    misfit[:, _LIKELY.index((_WALKED[0], 0))] -= 1  # grass, where the pixels do not tell
    cells = [_LIKELY[at] for at in misfit.argmin(axis=1)]
    cells[_CENTER] = _LIKELY[players[int(misfit[_CENTER, players].argmin())]]
    return cells


@functools.lru_cache(256)
def _middle(daylight: float) -> _Expected:
    return _expected(daylight, _CENTER, _CENTER + 1)


def _in_sleep(seen: NDArray[np.float32]) -> Cells:
    """A view in sleep, of which only the brightness is left: that of a night with noise says nothing."""
    cells: Cells = [(_WALKED[0], 0)] * (_COLUMNS * _ROWS)
    cells[_CENTER] = _WALKED[0], SLEEPING
    return cells


def texts_of(pictures: list[Any]) -> list[str]:
    """Return the words of consecutive pictures; a sleeper looks where it last looked."""
    facing, texts = SOUTH, []
    for picture in pictures:
        seen = read_picture(picture)
        facing = seen.facing or facing
        texts.append(seen.text(facing))
    return texts


class RulePixelsPlayer(RulePlayer):
    """Plays Crafter by the rules of `rule`, from the pixels of its pictures."""

    name = "rule-pixels"
    observations = ("picture", "both")

    def reply(self, prompt: Prompt) -> Reply:
        """Decide as `rule` would, from words made of the pictures."""
        return super().reply(replace(prompt, shared=in_words(prompt)))


def in_words(prompt: Prompt) -> list[Message]:
    """Return the messages of a prompt with every picture as text of the game, which replaces the text sent with it."""
    shown = [prompt.pictures[part["sha256"]] for message in prompt.messages for part in pictures_of(message)]
    texts = iter(texts_of(shown))
    return [_worded(message, next(texts)) if pictures_of(message) else message for message in prompt.messages]


def _worded(message: Message, text: str) -> Message:
    worded = message.copy()
    over = next((line for line in in_any_version("game_is_over") if text_of(message).endswith(line)), None)
    worded["content"] = text if over is None else f"{text}\n{over}"
    return worded
