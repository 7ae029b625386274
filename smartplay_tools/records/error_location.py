"""Errors in a record, reported in one sentence with the number of the event."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from smartplay_tools.errors import TranscriptError, in_one_line
from smartplay_tools.transcript.events import Event

SENSELESS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    StopIteration,
    TypeError,
    ValueError,
)
"""The exceptions that Python raises if events do not have the structure of their kinds, or come in another order."""


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
