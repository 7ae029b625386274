"""The states of the game at every step, which the page draws.

They come from playing the recorded actions again on a new game, which has information that the text does not contain:
the true odds, the roles, the map. If record and game disagree there is no drawing, because a wrong picture would be
worse than none.

A drawing lists changes: a value that does not change is not repeated.

Crafter's textures, from PyPI `crafter`, as one small image for the page.
"""

from __future__ import annotations

import base64
import functools
import io
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.episode.config import Setting
from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.games.base import TextGame
from smartplay_tools.games.game_registry import close_game, packages_are_imported
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import CallEvent, compares_pictures
from smartplay_tools.types import ObservationForm
from smartplay_tools.types.arguments import read

REPLAYED = (
    "Drawn from the game itself: the recorded actions were played again when this page was made, and every state "
    "hash in the record was reproduced. "
)
NOT_DRAWN = {
    "kind": None,
    "source": "This game is not drawn: it shows what the player read. `TextGame.drawing` would draw it.",
}
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


def draw(record: Record) -> dict[str, Any]:
    """Return the drawing of an episode: its `kind`, its `source`, and the state at every step.

    Without a drawing `kind` is None and `source` says why.
    """
    drawing = _made_of(record, _drawing)
    return {"kind": None, "source": f"No drawing: {drawing}"} if isinstance(drawing, str) else drawing


def pictures(record: Record) -> dict[str, Any] | None:
    """Return the pictures that the player was shown, in base64 by their sha256; None if it was shown words.

    They are made again by playing the record; `missing` is a sentence that says why there are none.
    """
    if record.config.observation == "text":
        return None
    files = _made_of(record, _pictures)
    if isinstance(files, str):
        return {"files": {}, "missing": f"It is not here: {files}"}
    return {"files": files, "missing": None}


def _made_of(record: Record, make: Callable[[Record, TextGame], Drawn]) -> Drawn | str:
    """Return what a function makes of a record with a new game, or why it makes nothing."""
    config = record.config
    try:
        if not packages_are_imported() and config.setting.kwargs != Setting.of(config.registered).kwargs:
            # Numbers of a stranger could ask for a world of any size.
            raise _NoDrawingError(f"{config.game} has other numbers here; --plugins draws it.")
        game = config.make_game(config.spec, is_recorded=True)
        try:
            return make(record, game)
        finally:
            close_game(game)
    except _NoDrawingError as error:
        return str(error)
    except (SmartPlayError, KeyError, TypeError, ValueError) as error:
        return f"the game cannot be played again here. {error}"


def _pictures(record: Record, game: TextGame) -> dict[str, str]:
    named = {call["data"]["picture"]["sha256"] for call in record.calls if "picture" in call["data"]}
    if len(named) > MOST_PICTURES:
        raise _NoDrawingError(f"the record has {len(named):,} pictures, and a page holds {MOST_PICTURES:,}.")
    if max(game.picture_shape) > LARGEST_PICTURE:
        raise _NoDrawingError(f"a page holds pictures of at most {LARGEST_PICTURE} pixels a side.")
    game.reset(seed=record.config.seed)
    files: dict[str, str] = {}
    for call, _ in _played(record, game):
        if "picture" in call["data"]:
            picture = game.picture()
            recorded = call["data"]["picture"]["sha256"]
            if compares_pictures(record.events[0]) and picture.sha256 != recorded:
                raise _differently("It made other pictures.")
            files[recorded] = picture.base64
    return files


def _drawing(record: Record, game: TextGame) -> dict[str, Any]:
    if type(game).drawing is TextGame.drawing:  # and its engine may need a server
        return NOT_DRAWN
    game.reset(seed=record.config.seed)
    states = [game.drawing()]
    if not states[0]:
        return NOT_DRAWN
    actions, rewards = [], []
    for call, action in _played(record, game):
        if action is not None:
            actions.append(action)
            rewards.append(call["data"]["reward"])
            states.append(game.drawing())
    return {
        "kind": "text" if states[0].keys() == {"text"} else record.config.spec.family,
        "source": REPLAYED + SAW[record.config.observation],
        "changes": list(changes(states)),
        "names": game.actions,
        "actions": actions,
        "rewards": rewards,
    }


def _played(record: Record, game: TextGame) -> Iterator[tuple[CallEvent, int | None]]:
    """Yield the calls of a record, each after its action, if it is legal, has been played again on the game."""
    tools = Tools(game, record.config.words)
    for call in record.calls:
        legal = call["data"].get("legal") is True
        yield call, _play_again(game, tools, call, record.config.observation) if legal else None


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
