"""Chains of trials in the records of a run: what a trial leaves, and whether the next one has begun with it."""

from __future__ import annotations

from pathlib import Path

from smartplay_tools.context.strategies.files import FileError
from smartplay_tools.episode.carried import STORES, Carried
from smartplay_tools.errors import TranscriptError, in_one_line
from smartplay_tools.records.error_location import SENSELESS
from smartplay_tools.records.record import Record


def left_by(path: Path) -> Carried:
    """Return what the trial of a finished record leaves to the next one of its chain.

    A call that came after the end of the game was not played, so its answer is not the last result.
    """
    record = Record.read(path)
    carry, before = record.config.carry, carried_in(record)
    if carry is None:
        raise TranscriptError(f"{path} is of an episode that leaves nothing to another one.")
    played = [call for call in record.calls if call["data"].get("mistake") != "over"]
    store = STORES[carry]
    try:
        held = store.after(record.calls, None if before is None else getattr(before, store.kept))
    except (*SENSELESS, FileError) as error:
        raise TranscriptError(f"{path} has calls with answers that are impossible: {in_one_line(error)}.") from error
    result = played[-1]["text"] if played else None
    return Carried(record=record.events[-1]["chain"], result=result, **{store.kept: held})


def carried_in(record: Record) -> Carried | None:
    """Return what the episode of a record began with."""
    return None if record.start is None else Carried.of(record.start)


def chain_fault(record: Record, before: Path | None) -> str | None:
    """Return why a record does not follow in its chain, None if it does; `before` is the record of the trial before.

    The first trial of a chain begins with nothing, and so does every trial of a run that carries nothing.
    """
    began_with = carried_in(record)
    if before is None:
        return None if began_with is None else "It has something carried, and there is no trial before it in its chain."
    if not before.exists():
        return f"The trial before it in its chain, {before.stem}, has no record."
    if began_with is None:
        return f"It has nothing carried from the trial before it in its chain, {before.stem}."
    left = left_by(before)
    if began_with.record != left.record:
        return (
            f"It was played after another record of {before.stem}, the trial before it in its chain "
            f"({began_with.record[:8]}, not {left.record[:8]})."
        )
    return None if began_with == left else f"What it has carried is not what {before.stem} left."
