"""Pictures of an episode to share: a card of one turn as PNG, and turns as a GIF, with what prompts could see.

A game that draws itself, as Crafter does, is shown as it draws itself, from its verified record played again; of any
other game the picture has the text that the player read. Below is the context band, a cell for each turn so far: blue
where the prompt of the turn showed it, orange where a part of it was left out, grey where it was gone.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smartplay_tools.episode.tools import Tools
from smartplay_tools.errors import InvalidArgumentError, damage_named, extra_named
from smartplay_tools.games.game_registry import close_game
from smartplay_tools.records.accounts import ShownAs, shown_turns
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import ViewEvent, concerns_summary
from smartplay_tools.types.arguments import read
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from PIL.Image import Image

SIZE = (1200, 630)
"""Pixels of a picture, the usual size of a card in a post."""

MARGIN = 48
FRAME_MILLISECONDS = 500
MOST_FRAMES = 300
LINE_CHARACTERS = 110
"""Characters of a line in the smallest font."""

FONTS = (34, 28, 22, 18)
TEXT_HEIGHT = 335

PAPER, INK, SOFT = "#f4f5f7", "#1b2230", "#5a6474"
SEEN, MARKED, GONE = "#3b7dd8", "#e08a1e", "#d3d8e0"
IN_PART: Sequence[ShownAs] = ("trimmed", "masked", "notes", "pinned")
COLOURS: Mapping[ShownAs, str] = {"whole": SEEN, "gone": GONE, **dict.fromkeys(IN_PART, MARKED)}
PICTURES = "rgb_array"


@dataclass(frozen=True)
class _Shot:
    """A turn as it is drawn."""

    turn: int
    view: ViewEvent
    calls: str
    answer: str
    score: float
    step: int
    image: Any
    """The game's picture of itself after the turn; None if it makes none."""
    shown: Sequence[ShownAs]
    """How its prompt showed each turn before it."""


def write_card(record: str | Path, out: str | Path, *, turn: int | None = None) -> Path:
    """Write the card of a turn, of the last one if none is given, as PNG; return its path."""
    episode, shots = _read(record)
    chosen = shots[-1].turn if turn is None else turn
    shot = next((shot for shot in shots if shot.turn == chosen), None)
    if shot is None:
        raise InvalidArgumentError(f"{record} has no prompt of turn {chosen}; it has turns 0 to {shots[-1].turn}.")
    return _save(Path(out), [_picture(episode, shot, shots[-1].turn)])


def write_gif(record: str | Path, out: str | Path, *, turns: tuple[int, int] | None = None) -> Path:
    """Write the turns from the first to the last of `turns`, or all, as an animated GIF; return its path."""
    episode, shots = _read(record)
    first, last = (0, shots[-1].turn) if turns is None else turns
    chosen = [shot for shot in shots if first <= shot.turn <= last]
    if not chosen or len(chosen) > MOST_FRAMES:
        raise InvalidArgumentError(
            f"An animation has 1 to {MOST_FRAMES} turns; {record} has turns 0 to {shots[-1].turn} (--turns)."
        )
    return _save(Path(out), [_picture(episode, shot, shots[-1].turn) for shot in chosen])


def _read(record: str | Path) -> tuple[Record, list[_Shot]]:
    with damage_named(record):
        episode = Record.read(record)
        return episode, list(_shots(episode))


def _save(out: Path, pictures: Sequence[Image]) -> Path:
    out.parent.mkdir(parents=True, exist_ok=True)
    first, *others = (picture.quantize(64) for picture in pictures)
    more: dict[str, Any] = {"save_all": True, "append_images": others, "duration": FRAME_MILLISECONDS, "loop": 0}
    first.save(out, **(more if out.suffix == ".gif" else {}))
    return out


def _shots(record: Record) -> Iterator[_Shot]:
    """Yield every turn that has a prompt."""
    if record.is_paper:
        raise InvalidArgumentError("Pictures to share are of episodes with tool calls, not of the paper's protocol.")
    views = {view["turn"]: view for view in record.views if not concerns_summary(view)}
    if not views:
        raise InvalidArgumentError("The record has no prompt yet.")
    calls = grouped(record.calls, lambda call: call["turn"])
    score, step, answer, images = 0.0, 0, "", _images(record)
    image = next(images, None)
    for turn, view in sorted(views.items()):
        texts = []
        for call in calls.get(turn, []):
            texts.append(f"{call['name']} {call['arguments']}")
            answer = call["text"]
            if call["data"].get("legal") is True:
                score, step = call["data"]["score"], call["data"]["step"]
                image = next(images, image)
        yield _Shot(turn, view, ", ".join(texts), answer, score, step, image, shown_turns(record, view))


def _images(record: Record) -> Iterator[Any]:
    """Yield the game's pictures of itself: at the start and after every played action; none if it makes none."""
    config = record.config
    if PICTURES not in config.registered.load().metadata["render_modes"]:
        return
    options = {**config.options, "render_mode": PICTURES}
    with ExitStack() as stack:
        game = config.model_copy(update={"options": options}).make_game(config.spec, is_recorded=True)
        stack.callback(close_game, game)
        game.reset(seed=config.seed)
        tools = Tools(game, record.config.words)
        yield game.render()
        for call in record.calls:
            if call["data"].get("legal") is True:
                action = tools.parse(call["name"], read(call["arguments"])).action
                if action is None:
                    return
                game.advance(action)
                if call["data"].get("state_hash", game.state_hash()) != game.state_hash():
                    raise InvalidArgumentError("The game played differently when it was played again: no picture.")
                yield game.render()


def _picture(record: Record, shot: _Shot, last: int) -> Image:
    with extra_named("A picture", "evaluation"):
        from PIL import Image, ImageDraw, ImageFont
    picture = Image.new("RGB", SIZE, PAPER)
    draw = ImageDraw.Draw(picture)

    def write(x: int, y: int, text: str, size: int, colour: str = INK) -> None:
        draw.text((x, y), text, fill=colour, font=ImageFont.load_default(size))

    write(MARGIN, 34, record.game, 40)
    write(MARGIN, 86, f"{record.player or 'unnamed'}, seed {record.seed}", 26, SOFT)
    cap = record.budget.get("prompt_tokens")
    limit = "" if cap is None else f" of {cap:,}"
    facts = f"turn {shot.turn} of {last}    score {shot.score:g}    prompt {shot.view['tokens']:,}{limit} tokens"
    write(MARGIN, 132, facts, 28)
    if shot.image is not None:
        drawn = Image.fromarray(shot.image)
        side = 330
        picture.paste(drawn.resize((side * drawn.width // drawn.height, side), Image.Resampling.NEAREST), (MARGIN, 184))
        left, wide = MARGIN + side * drawn.width // drawn.height + 32, 76
    else:
        left, wide = MARGIN, LINE_CHARACTERS
    size, lines = _fitting([shot.calls, *shot.answer.splitlines()], wide)
    for number, line in enumerate(lines):
        write(left, 188 + round(1.22 * size) * number, line, size, INK if number else SEEN)
    _band(draw, shot)
    write(MARGIN, 588, _in_words(shot), 20, SOFT)
    return picture


def _fitting(text: Sequence[str], wide: int) -> tuple[int, list[str]]:
    """The largest font at which a text fits, and its lines there; `wide` is the room in characters of the smallest.

    At the smallest font a text that does not fit is cut.
    """
    for size in FONTS:
        room = wide * FONTS[-1] // size
        lines = [part for line in text for part in textwrap.wrap(line, room) or [""]]
        if len(lines) * 1.22 * size <= TEXT_HEIGHT:
            break
    return size, lines[: int(TEXT_HEIGHT / (1.22 * size))]


def _band(draw: Any, shot: _Shot) -> None:
    width = (SIZE[0] - 2 * MARGIN) / max(1, len(shot.shown))
    for turn, colour in enumerate(COLOURS[kind] for kind in shot.shown):
        x = MARGIN + turn * width
        draw.rectangle((x, 540, x + max(1.0, width - (2 if width > 6 else 0)), 574), fill=colour)


def _in_words(shot: _Shot) -> str:
    gone = shot.shown.count("gone")
    partly = len(shot.shown) - gone - shot.shown.count("whole")
    return (
        f"Of {len(shot.shown)} earlier turns the model saw {shot.shown.count('whole')} in full"
        f"{f', {partly} in part' if partly else ''}; {gone} had left its window."
    )
