"""The states of the game at every step, which the page draws.

Most come from playing the recorded actions again on a new game, which has information that the text does not contain:
the true odds, the roles, the map. If record and game disagree there is no drawing, because a wrong picture would be
worse than none. Minecraft's path is read from the text, because its engines may need a server.

A drawing lists changes: a value that does not change is not repeated.

Crafter's textures, from PyPI `crafter`, as one small image for the page.

The path of a Minecraft player, and the land around it.

With every engine an observation begins with the player's coordinates, so a path needs no server. The embedded world's
climate is a function of its seed, so for that engine the land can be drawn as well, including parts that were not seen.
"""

from __future__ import annotations

import base64
import functools
import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.episode.config import EpisodeConfig, Setting
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.games.game_registry import close_game, packages_are_imported
from smartplay_tools.games.minecraft.game import Minecraft
from smartplay_tools.games.minecraft.voxel.climate import SPACING, Biome, biomes, climate
from smartplay_tools.games.minecraft.voxel.engine import VoxelEngine
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import CallEvent, compares_pictures
from smartplay_tools.types import ObservationForm
from smartplay_tools.types.arguments import read

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


REPLAYED = (
    "Drawn from the game itself: the recorded actions were played again when this page was made, and every state "
    "hash in the record was reproduced. "
)
SAW = {
    "text": "The player saw the text only.",
    "picture": "The player saw only the pictures that stand in the turns.",
    "both": "The player saw only the text and the pictures that stand in the turns.",
}

MOST_PICTURES = 2_000
LARGEST_PICTURE = 512
"""Pixels of the longer side: a record of a stranger could ask for pictures of any size."""


Drawn = TypeVar("Drawn", dict[str, Any], dict[str, str])


class _NoDrawingError(Exception):
    """There is no drawing; the message is a sentence that says why."""


class Drawings:
    """Draws one episode after the other; those of a cell are played on the same game, which is made once."""

    def __init__(self) -> None:
        self._made: tuple[Any, TextGame, Tools] | None = None

    def __enter__(self) -> Drawings:
        return self

    def __exit__(self, *error: object) -> None:
        self._close()

    def draw(self, record: Record) -> dict[str, Any]:
        """Return the drawing of an episode: its `kind`, its `source`, and the state at every step.

        Without a drawing `kind` is None and `source` says why.
        """
        drawing = self._made_of(record, self._drawing)
        return {"kind": None, "source": f"No drawing: {drawing}"} if isinstance(drawing, str) else drawing

    def pictures(self, record: Record) -> dict[str, Any] | None:
        """Return the pictures that the player was shown, in base64 by their sha256; None if it was shown words.

        They are made again by playing the record; `missing` is a sentence that says why there are none.
        """
        if record.config.observation == "text":
            return None
        files = self._made_of(record, self._pictures)
        if isinstance(files, str):
            return {"files": {}, "missing": f"It is not here: {files}"}
        return {"files": files, "missing": None}

    def _made_of(self, record: Record, make: Callable[[Record], Drawn]) -> Drawn | str:
        """Return what a function makes of a record, or why it makes nothing."""
        try:
            return make(record)
        except _NoDrawingError as error:
            why = str(error)
        except (SmartPlayError, KeyError, TypeError, ValueError) as error:
            why = f"the game cannot be played again here. {error}"
        self._close()
        return why

    def _drawing(self, record: Record) -> dict[str, Any]:
        if record.config.spec.family == "minecraft":
            return draw_walk(record)
        return self._replay(record)

    def _pictures(self, record: Record) -> dict[str, str]:
        config = record.config
        named = {call["data"]["picture"]["sha256"] for call in record.calls if "picture" in call["data"]}
        if len(named) > MOST_PICTURES:
            raise _NoDrawingError(f"the record has {len(named):,} pictures, and a page holds {MOST_PICTURES:,}.")
        game, tools = self._game_of(config)
        if max(game.picture_shape) > LARGEST_PICTURE:
            raise _NoDrawingError(f"a page holds pictures of at most {LARGEST_PICTURE} pixels a side.")
        game.reset(seed=config.seed)
        files: dict[str, str] = {}
        for call in record.calls:
            data = call["data"]
            if data.get("legal") is True:
                _play_again(game, tools, call, config.observation)
            if "picture" in data:
                picture = game.picture()
                if compares_pictures(record.events[0]) and picture.sha256 != data["picture"]["sha256"]:
                    raise _differently("It made other pictures.")
                files[data["picture"]["sha256"]] = picture.base64
        return files

    def _replay(self, record: Record) -> dict[str, Any]:
        config = record.config
        game, tools = self._game_of(config)
        game.reset(seed=config.seed)
        states = [game.drawing()]
        if not states[0]:
            return {
                "kind": None,
                "source": "This game is not drawn: it shows what the player read. `TextGame.drawing` would draw it.",
            }
        acts = [call for call in record.calls if call["data"].get("legal") is True]
        actions = []
        for act in acts:
            actions.append(_play_again(game, tools, act, config.observation))
            states.append(game.drawing())
        kind = "text" if states[0].keys() == {"text"} else config.spec.family
        return {
            "kind": kind,
            "source": REPLAYED + SAW[config.observation],
            "changes": list(changes(states)),
            "names": game.actions,
            "actions": actions,
            "rewards": [act["data"]["reward"] for act in acts],
        }

    def _game_of(self, config: EpisodeConfig) -> tuple[TextGame, Tools]:
        played = (config.game, config.game_sha256, config.setting, config.engine, config.options, config.budget.history)
        cell = (*played, config.observation, config.words.name)
        if self._made is None or self._made[0] != cell:
            self._close()
            if not packages_are_imported() and config.setting.kwargs != Setting.of(config.registered).kwargs:
                # Numbers of a stranger could ask for a world of any size.
                raise _NoDrawingError(f"{config.game} has other numbers here; --plugins draws it.")
            game = config.make_game(config.spec, is_recorded=True)
            self._made = (cell, game, Tools(game, config.words))
        return self._made[1], self._made[2]

    def _close(self) -> None:
        """Close the game. One that disagreed with a record is not used again: it may be broken."""
        if self._made is not None:
            close_game(self._made[1])
            self._made = None


def _play_again(game: TextGame, tools: Tools, act: CallEvent, observation: ObservationForm) -> int:
    """Play a recorded action and return its index; `_NoDrawingError` if anything else comes of it."""
    data = act["data"]
    step = data["step"]
    try:
        action = tools.parse(act["name"], read(act["arguments"])).action
        assert action is not None
        text, reward, _, _ = game.advance(action)
    except Exception as error:  # a record may say anything, and an engine may break: no drawing, with the reason
        raise _differently(f"Step {step} cannot be played ({type(error).__name__}).") from error
    if "state_hash" in data and data["state_hash"] != game.state_hash():
        raise _differently(f"Step {step} has a different state hash.")
    if data["reward"] != reward:
        raise _differently(f"Step {step} has a different reward.")
    if observation == "picture":
        text = tools.words("picture_shown")
    # What was cut for the player says less than the hash.
    shown = without_budget_line(act["text"])
    if not act["cut"] and shown not in (text, f"{text}\n{tools.words('game_is_over')}"):
        raise _differently(f"Step {step} has a different text.")
    return action


def _differently(how: str) -> _NoDrawingError:
    return _NoDrawingError(f"the game played differently when it was played again. {how}")


def changes(states: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the part of each state that differs from the previous one."""
    before: dict[str, Any] = {}
    for state in states:
        yield {name: value for name, value in state.items() if name not in before or before[name] != value}
        before = state


SIDE = 16
"""Pixels along the side of a texture."""

COLUMNS = 8


@functools.cache
def sheet() -> dict[str, Any]:
    """Return the image as a PNG data URI, the index of every texture in it, row by row, and Crafter's lists."""
    from crafter import constants
    from PIL import Image

    from smartplay_tools.games.crafter.facts import ITEMS, MATERIALS, MOST, VITALS

    files = [file for file in sorted(Path(constants.root / "assets").glob("*.png")) if "debug" not in file.stem]
    canvas = Image.new("RGBA", (COLUMNS * SIDE, math.ceil(len(files) / COLUMNS) * SIDE))
    for at, file in enumerate(files):
        with Image.open(file) as texture:
            canvas.paste(texture.convert("RGBA"), (at % COLUMNS * SIDE, at // COLUMNS * SIDE))
    data = io.BytesIO()
    canvas.save(data, "PNG", optimize=True)
    image = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
    facts = {"materials": MATERIALS, "vitals": VITALS, "items": ITEMS, "most": MOST}
    places = {file.stem: at for at, file in enumerate(files)}
    return {"image": image, "side": SIDE, "columns": COLUMNS, "places": places, **facts}


FROM_TEXT = "The path is read from the coordinates in the observations."
WITH_LAND = (
    FROM_TEXT + " The land is computed from the world's seed; the player has never seen this map. "
    "A square is {spacing} x {spacing} blocks."
)

MARGIN = 48
"""Blocks of land around the path."""
NARROWEST = 0.6
"""The shorter side of the map, as a share of the longer."""
LONGEST_SIDE = 160
"""The most squares along a side of a map; their size follows from it."""

_COORDINATES = re.compile(r"^Coordinate \((-?[\d.]+),(-?[\d.]+),(-?[\d.]+)\)\. Facing ([a-z-]+)\.", re.MULTILINE)


def draw_walk(record: Record) -> dict[str, Any]:
    """Return the positions by step and, for the embedded world, the land around them."""
    config, positions = record.config, _positions(record)
    if not positions:
        return {"kind": None, "source": "No drawing: no observation has coordinates."}
    land: dict[str, Any] = {}
    if config.engine == "voxel":
        game = config.spec.make(**config.options, engine="voxel", history=0)
        assert isinstance(game, Minecraft)
        game.reset(seed=config.seed)
        assert isinstance(game.world, VoxelEngine)
        x, y, z = game.world.position
        positions.setdefault(0, (round(x, 2), round(y, 2), round(z, 2), "south"))
        land = _land(game.world.world.seed, [(x, z) for x, _, z, _ in positions.values()])
        land["goal"] = sorted(Biome(number).name for number in game.goal.biomes if number in set(Biome))
    walk = [positions.get(step) for step in range(max(positions) + 1)]
    source = WITH_LAND.format(spacing=land["spacing"]) if land else FROM_TEXT
    return {"kind": "minecraft", "source": source, "walk": walk, **land}


def _positions(record: Record) -> dict[int, tuple[float, float, float, str]]:
    """Return x, y, z and the heading for each observation that has coordinates."""
    texts: dict[int, str] = {}
    for head in record.heads:
        if "observation" in head:
            texts[0] = head["observation"]
    for call in record.calls:
        if (step := call["data"].get("observation_step")) is not None:
            texts[step] = call["text"]
    # If the host manages the context, a text has past observations first, so the last coordinates count.
    matches = {step: _COORDINATES.findall(text) for step, text in texts.items()}
    return {step: (float(m[-1][0]), float(m[-1][1]), float(m[-1][2]), m[-1][3]) for step, m in matches.items() if m}


def _land(seed: int, places: Sequence[tuple[float, float]]) -> dict[str, Any]:
    low, high = np.min(places, axis=0) - MARGIN, np.max(places, axis=0) + MARGIN
    longest = float((high - low).max())
    # A straight path has some land on both sides, too.
    narrow = np.maximum(NARROWEST * longest - (high - low), 0) / 2
    (west, north), (east, south) = low - narrow, high + narrow
    spacing = SPACING * -(-int(longest) // (SPACING * LONGEST_SIDE))
    left, top = int(west // spacing), int(north // spacing)
    x = np.arange(left, int(east // spacing) + 1) * spacing + spacing // 2
    z = np.arange(top, int(south // spacing) + 1) * spacing + spacing // 2
    squares = biomes(climate(seed, x[:, None], z[None, :]))
    names = [Biome(number).name for number in np.unique(squares)]
    letters = {Biome[name].value: chr(ord("a") + at) for at, name in enumerate(names)}
    rows = ["".join(letters[number] for number in row) for row in squares.T.tolist()]
    return {"spacing": spacing, "corner": [left * spacing, top * spacing], "biomes": names, "rows": rows}
