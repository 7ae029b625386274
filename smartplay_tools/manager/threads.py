"""Threads: the records of a manager's conversations, a file for each."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from smartplay_tools.context.view import ranges_of
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.manager.fitted import Conversation, FittedPrompt
from smartplay_tools.manager.forms import Given
from smartplay_tools.manager.plain import plain
from smartplay_tools.manager.record import CHANGES, ThreadRecord
from smartplay_tools.manager.tools import recorded_tool
from smartplay_tools.transcript.hashing import canonical_json

RECORDS = 64
"""How many records are kept open; a server that runs for months sees many."""


class ThreadRecords:
    """The records of the threads in a folder."""

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        self._folder, self._settings = folder, settings
        self._open: dict[str, ThreadRecord] = {}

    def record(self, thread: str | None, head: Sequence[Given] = ()) -> ThreadRecord:
        """Return the record of a thread, by default that of a head; one that was not written for long is read again."""
        if thread is None:
            thread = hashlib.sha256(canonical_json(head)).hexdigest()[:16]
        elif not re.fullmatch(r"[\w.-]{1,100}", thread) or thread.startswith("."):
            raise InvalidArgumentError(f"{thread!r} cannot name a thread: at most 100 letters, digits, dots, _ and -.")
        record = self._open.pop(thread, None) or ThreadRecord(self._folder / f"{thread}.jsonl", self._settings)
        self._open[thread] = record
        if len(self._open) > RECORDS:
            del self._open[next(iter(self._open))]
        return record


def recorded(
    record: ThreadRecord, prompt: FittedPrompt, conversation: Conversation, beside: Mapping[str, Any], cap: int | None
) -> FittedPrompt:
    """Write a prompt into the record of its thread, and return it with its place there."""
    shown = [plain(message, "A message")[0] for message in prompt.messages]
    facts: dict[str, Any] = {name: ranges_of(getattr(prompt, name)) for name in CHANGES if getattr(prompt, name)}
    facts |= {"form": conversation.form.name, "made": prompt.made, "tokens": prompt.tokens}
    facts |= {"cap": cap, "parts": dict(prompt.parts)}
    told = {**beside, "tools": [recorded_tool(tool) for tool in beside["tools"]]}
    number = record.prompt(conversation.data, shown, prompt.costs, told, facts)
    return replace(prompt, recorded_as=(record.path.stem, number))
