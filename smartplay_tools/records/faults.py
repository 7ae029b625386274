"""Faults of records: what Python raises about their events and values, as errors that say where."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from smartplay_tools.errors import SENSELESS, SmartPlayError, TranscriptError, in_one_line
from smartplay_tools.transcript.events import Event


class ErrorLocation:
    """The event that is looked at, and its number from 1 on; 0 before the first one."""

    def __init__(self) -> None:
        self.number, self.event = 0, Event()


@contextmanager
def record_named() -> Iterator[ErrorLocation]:
    """Turn what Python raises about a record into a `TranscriptError`, which names the event that is looked at.

    `with record_named() as at: for at.number, at.event in enumerate(events, start=1): ...`

    Before the first event, while an episode is made of a record's config and start, our own errors say it themselves.
    """
    at = ErrorLocation()
    try:
        yield at
    except SENSELESS as error:
        if isinstance(error, TranscriptError) or (isinstance(error, SmartPlayError) and not at.number):
            raise
        what = in_one_line(error)
        if not at.number:
            why = f"{type(error).__name__}: {what}"
        elif isinstance(error, KeyError):
            why = f"event {at.number} ({at.event.get('event')}) has no field {error}"
        else:
            why = f"event {at.number} ({at.event.get('event')}): {(what or 'out of place').rstrip('.')}"
        raise TranscriptError(f"The record cannot be replayed: {why}.") from error
