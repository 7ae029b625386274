"""The pictures of a record, which holds only their digests: made again by replay, and compared with these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from smartplay_tools.context.tokens import Tokenizer
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.errors import TranscriptError
from smartplay_tools.records.driver import Driver
from smartplay_tools.records.replays import read_events
from smartplay_tools.transcript.events import Event
from smartplay_tools.types.pictures import NO_PICTURES, Picture

if TYPE_CHECKING:
    from smartplay_tools.games.base import TextGame


def recorded_pictures(
    source: str | Path | Sequence[Event], *, tokenizer: str | Tokenizer | None = None
) -> Mapping[str, Picture]:
    """Return every picture that the model of a record was shown, by its sha256.

    The record is played again. A picture that the record names and the replay does not make is a `TranscriptError`.
    `tokenizer` is required if the record was counted with a tokenizer object of yours.
    """
    events = read_events(source)
    if not events or EpisodeConfig.from_event(events[0]).observation == "text":
        return NO_PICTURES
    made: dict[str, Picture] = {}

    def keep(game: TextGame) -> None:
        picture = game.picture()
        made[picture.sha256] = picture

    driver = Driver(events, tokenizer=tokenizer, on_step=keep)
    try:
        keep(driver.episode.game)
        driver.run()
    finally:
        driver.episode.game.close()
    calls = [event["data"] for event in events if event["event"] == "call"]
    shown = [data["picture"]["sha256"] for data in calls if "picture" in data]
    if missing := [sha256 for sha256 in shown if sha256 not in made]:
        raise TranscriptError(f"The record shows a picture that its game does not make here: {missing[0]}.")
    return {sha256: made[sha256] for sha256 in shown}
