"""Replay: play a transcript again and compare everything exactly.

A replay verifies three things: that no event was changed, lost or moved (the chain), that the same replies lead to the
same results and counts (the play), and that every prompt has its sha256. A replay writes its own record: if its
bytes are the same, all three hold; otherwise they are checked one by one. Versions may differ, because a replay is
meant to show whether another version plays the same. It cannot verify who wrote the replies.

Anything wrong with a record is a difference, even where it stops the replay: events that lack the fields of their kind,
or come in an order in which nothing can be played. An exception means that there is nothing to compare: the file is not
a transcript, or the episode that it names cannot be played on this machine.

A record holds the digests of its pictures, and a replay makes them again and compares them. Older records hold digests
of PNG files, which are no longer made to the byte: their pictures keep the recorded digests and are not compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from smartplay_tools.context.tokens import Tokenizer
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.errors import SENSELESS, TranscriptError, in_one_line
from smartplay_tools.games.game_registry import close_game
from smartplay_tools.records.driver import Driver, picture_names
from smartplay_tools.records.prompts import sent_prompts
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import Event, compares_pictures, event_fault
from smartplay_tools.transcript.file import check_format, is_event, read_transcript
from smartplay_tools.transcript.hashing import chained_lines, event_line
from smartplay_tools.types import EpisodeResult
from smartplay_tools.types.arguments import canonical
from smartplay_tools.types.pictures import NO_PICTURES, Picture

PICTURES_ARE_NOT_COMPARED = "Pictures are not compared, because the record has digests of PNG files and not of pixels."


@dataclass(frozen=True)
class Replay:
    """The result of a replay."""

    events: int
    differences: list[str]
    """One sentence per difference; empty if the play is identical."""
    result: EpisodeResult | None
    """The result of the replayed episode; None if the transcript is incomplete or cannot be played to its end."""
    resumed: tuple[int, ...] = ()
    """The events, counted from 1, at which the episode was continued from its record."""
    has_host_part: bool = False
    """Whether a host added messages or tools to the prompts."""
    not_compared: str | None = None
    """A sentence that says what could not be compared; None if everything was."""

    @property
    def complete(self) -> bool:
        """Whether the record holds the episode to its end, and could be played to it."""
        return self.result is not None

    @property
    def identical(self) -> bool:
        """Whether the record is complete and nothing differs."""
        return self.complete and not self.differences


def replay(
    source: str | Path | Sequence[Event], *, tokenizer: str | Tokenizer | None = None, calls_compactor: bool = False
) -> Replay:
    """Replay a transcript, given as a file or its events, and list every difference.

    A record that is broken in any way has `differences`; where its events cannot be played on, the last of them says
    which event and why. What is not a transcript is a `TranscriptError`, and an episode whose game, engine or
    tokenizer is not here is the `SmartPlayError` that says so.

    `tokenizer` is required if the record was counted with one that does not ship with this package: a name in a record
    opens nothing, unless the program has named the same tokenizer before. What a compactor returned is taken from the
    record; with `calls_compactor` it is called again, with the recorded replies, and compared.
    """
    if isinstance(source, str | Path):
        record = Record.read(source, checks_fields=False)
    else:
        record = Record(read_events(source, checks_fields=False))
    return replay_record(record, tokenizer=tokenizer, calls_compactor=calls_compactor)


def replay_record(record: Record, *, tokenizer: str | Tokenizer | None = None, calls_compactor: bool = False) -> Replay:
    """Replay a record that has been read."""
    recorded, written = record.events, record.written
    if written is None:
        written = b"".join(event_line(event) + b"\n" for event in recorded)
    compactor: Literal["called", "recorded"] = "called" if calls_compactor else "recorded"
    driver = Driver(recorded, tokenizer=tokenizer, config=record.config, compactor=compactor)
    differences: list[str] = []
    try:
        stop = _stop(driver)
        # The same bytes are the same events with the same chain, and the prompts that the replay has just made.
        if stop is not None:
            differences = [*_broken(recorded), *driver.differences(to_end=False), stop]
        elif driver.record.written != written:
            differences = [*_broken(recorded), *driver.differences(), *_tampered(recorded)]
    finally:
        close_game(driver.episode.game)
    resumed = tuple(number for number, event in enumerate(recorded, start=1) if event["event"] == "resume")
    result = driver.episode.result if record.is_complete else None
    not_compared = None if compares_pictures(recorded[0]) else PICTURES_ARE_NOT_COMPARED
    return Replay(len(recorded), differences, result, resumed, driver.has_host_part, not_compared)


def _stop(driver: Driver) -> str | None:
    """Feed the record; return the sentence about the event at which it cannot be played on, or None."""
    try:
        driver.run()
    except TranscriptError as error:
        return str(error)
    return None


def read_events(source: str | Path | Sequence[Event], *, checks_fields: bool = True) -> list[Event]:
    """Return the events of a transcript, a file or a list, whose format this version reads.

    Without `checks_fields` the events of a list may have any.
    """
    if isinstance(source, str | Path):
        return read_transcript(source)
    events = list(source)
    for number, event in enumerate(events, start=1):
        fault = (event_fault(event) if checks_fields else None) if is_event(event) else "is not an event"
        if fault is not None:
            raise TranscriptError(f"The events are not a transcript: number {number} {fault.rstrip('.')}.")
    if not events or events[0]["event"] != "start":
        raise TranscriptError("The events are not a transcript: they do not begin with a start event.")
    check_format(events[0])
    return events


def _broken(recorded: Sequence[Event]) -> Iterator[str]:
    for number in broken_links(recorded):
        kind = recorded[number - 1]["event"]
        yield f"Event {number} ({kind}), or an event before it, was changed: its chain is broken."


def _tampered(recorded: Sequence[Event]) -> Iterator[str]:
    try:
        for sent in sent_prompts(recorded):
            if sent.sha256 != sent.recorded_sha256:
                yield f"The rebuilt prompt of turn {sent.turn} has a different sha256 than in the record."
    except SENSELESS as error:
        yield f"The prompts of the record cannot be rebuilt: {type(error).__name__}: {in_one_line(error)}."


def recorded_pictures(source: str | Path | Sequence[Event]) -> Mapping[str, Picture]:
    """Return every picture that the model of a record was shown, by its sha256.

    The record is played again. A picture that the record names and the replay does not make is a `TranscriptError`,
    except where pictures are not compared (`Replay.not_compared`).
    """
    events = read_events(source)
    if not events or EpisodeConfig.from_event(events[0]).observation == "text":
        return NO_PICTURES
    made: list[Picture] = []
    driver = Driver(events, on_picture=made.append)
    try:
        driver.run()
    finally:
        close_game(driver.episode.game)
    pictures = {picture.sha256: picture for picture in made}
    shown = list(picture_names(events))
    if missing := [sha256 for sha256 in shown if sha256 not in pictures]:
        raise TranscriptError(f"The record shows a picture that its game does not make here: {missing[0]}.")
    return {sha256: pictures[sha256] for sha256 in shown}


def broken_links(events: Iterable[Event]) -> Iterator[int]:
    """Yield the numbers, from 1, of the events whose chain does not follow from the event and the chain before it."""
    before = ""
    for number, event in enumerate(events, start=1):
        plain = {name: value for name, value in event.items() if name != "chain"}
        if event.get("chain") != chained_lines([plain], before)[1] or next(reversed(event)) != "chain":
            yield number
        before = str(event.get("chain"))


def comparable(events: Iterable[Event]) -> list[Any]:
    """Return the parts by which two transcripts are compared: their calls, heads and prompt hashes.

    Ids, usage, versions and times are left out, and arguments are compared as JSON values.
    """
    kept: list[Any] = []
    for event in events:
        match event["event"]:
            case "call":
                same = [event[key] for key in ("turn", "position", "name", "text", "is_error", "data")]
                kept.append(["call", *same, canonical(event["arguments"])])
            case "head":
                kept.append(["head", event["messages"], event["tools"]])
            case "view":
                kept.append(["view", event["sha256"]])
    return kept
