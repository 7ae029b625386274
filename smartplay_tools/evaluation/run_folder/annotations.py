"""Notes that people write about the turns of an episode, in a file beside its record, which stays as it is."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.transcript.lines import parse_json

SUFFIX = ".notes.json"
"""The end of the file's name, in place of the record's `.jsonl`."""

LONGEST = 10_000
"""Characters of a note."""


def notes_file(record: Path) -> Path:
    """Return the file of the notes about a record."""
    return record.with_name(record.name.removesuffix(".jsonl") + SUFFIX)


def record_of(notes: Path) -> Path:
    """Return the record that the notes of a file are about."""
    return notes.with_name(notes.name.removesuffix(SUFFIX) + ".jsonl")


def notes_in(folder: Path) -> list[Path]:
    """Return the files of notes in a folder, in the order of their names."""
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as files:
        return sorted(folder / file.name for file in files if file.name.endswith(SUFFIX) and file.name[0] != ".")
    return []


def read_notes(record: Path) -> dict[int, str]:
    """Return the notes about a record by turn; a file that holds something else is an `InvalidArgumentError`."""
    path = notes_file(record)
    if not path.is_file():
        return {}
    try:
        listed: Any = parse_json(path.read_bytes())
        notes = {int(note["turn"]): str(note["note"]) for note in listed}
    except (KeyError, TypeError, ValueError, RecursionError):
        raise InvalidArgumentError(f"{path} is damaged: it is not a list of notes.") from None
    return dict(sorted(notes.items()))


def write_note(record: Path, turn: int, note: str) -> dict[int, str]:
    """Write the note about a turn, in one operation, and return all notes; an empty note is deleted."""
    if turn < 0 or len(note) > LONGEST:
        raise InvalidArgumentError(f"A note is about a turn from 0 on, and has at most {LONGEST:,} characters.")
    notes = read_notes(record)
    notes.pop(turn, None)
    if note.strip():
        notes[turn] = note.strip()
    path = notes_file(record)
    if not notes:
        path.unlink(missing_ok=True)
        return {}
    part = path.with_name(f".{path.name}.part")
    part.write_text(json.dumps(as_list(notes), indent=1) + "\n", encoding="utf-8", newline="\n")
    part.replace(path)
    return dict(sorted(notes.items()))


def as_list(notes: Mapping[int, str]) -> Sequence[Mapping[str, Any]]:
    """Return notes as they are written: a list by turn."""
    return [{"turn": turn, "note": note} for turn, note in sorted(notes.items())]
