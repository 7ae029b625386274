"""Faults of records: what Python raises about their events and values, as errors that say where."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

from smartplay_tools.errors import SENSELESS, SmartPlayError, TranscriptError, in_one_line
from smartplay_tools.transcript.events import Event


@contextmanager
def record_named() -> Iterator[None]:
    """Turn what Python raises while an episode is made of a record's config and start into a `TranscriptError`."""
    try:
        yield
    except SmartPlayError:
        raise
    except SENSELESS as error:
        why = f"{type(error).__name__}: {in_one_line(error)}"
        raise TranscriptError(f"The record cannot be replayed: {why}.") from error


class ErrorLocation:
    """Turn an exception about the event that is looked at into a `TranscriptError` that names it.

    `with ErrorLocation() as at: for at.number, at.event in enumerate(events, start=1): ...`
    """

    number: int
    event: Event

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, TranscriptError) or not isinstance(error, SENSELESS):
            return
        where = f"event {self.number} ({self.event.get('event')})"
        if isinstance(error, KeyError):
            raise TranscriptError(f"The record cannot be replayed: {where} has no field {error}.") from error
        what = in_one_line(error) or "out of place"
        raise TranscriptError(f"The record cannot be replayed: {where}: {what.rstrip('.')}.") from error
