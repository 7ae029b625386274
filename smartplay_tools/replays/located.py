"""Errors in a record, reported in one sentence with the number of the event."""

from __future__ import annotations

from types import TracebackType

from smartplay_tools.errors import TranscriptError, in_one_line
from smartplay_tools.transcript.events import Event

SENSELESS = (AssertionError, AttributeError, IndexError, KeyError, TypeError, ValueError)
"""The exceptions that Python raises if an event does not have the structure of its kind."""


class located:  # noqa: N801  # used like a function; a generator's context would take a twentieth of a replay
    """Turn an exception about an event, the `number`-th of its record, into a `TranscriptError` that names it."""

    def __init__(self, number: int, event: Event) -> None:
        self._number, self._event = number, event

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, TranscriptError) or not isinstance(error, SENSELESS):
            return
        where = f"event {self._number} ({self._event.get('event')})"
        if isinstance(error, KeyError):
            raise TranscriptError(f"The record cannot be replayed: {where} has no field {error}.") from error
        what = in_one_line(error) or "out of place"
        raise TranscriptError(f"The record cannot be replayed: {where}: {what.rstrip('.')}.") from error
