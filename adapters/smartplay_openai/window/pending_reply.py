"""A reply as the host gets it, and what has become of each of its calls.

A host runs the calls of a reply through a transport that knows neither the reply nor the ids of its calls, so which
call is meant has to be told from its name and its arguments.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools import Message, ToolResult, Usage
from smartplay_tools.arguments import Arguments, read
from smartplay_tools.messages import Call


@dataclass
class Slot:
    """A call of the latest reply."""

    call: Call
    host_id: str
    is_foreign: bool = False
    is_sent: bool = True
    """Whether the host was sent it; calls that no host could run are answered here."""
    result: ToolResult | None = None
    is_delivered: bool = False

    def has(self, arguments: Any) -> bool:
        """Whether the call has these arguments, however their JSON is written: clients parse and print it."""
        return _meaning(self.call.arguments) == _meaning(read(arguments))


@dataclass
class PendingReply:
    """A reply as the host gets it."""

    message: Message
    usage: Usage
    slots: list[Slot] = field(default_factory=list)
    repeats: int = 0

    @property
    def sent(self) -> Sequence[Slot]:
        """The calls that the host was sent."""
        return [slot for slot in self.slots if slot.is_sent]

    def called(self, name: str, arguments: Any) -> Slot | None:
        """Find the call that a host runs: the first that waits, else one that was answered, else one that it edited."""
        named = [slot for slot in self.sent if slot.call.name == name and not slot.is_foreign]
        same = [slot for slot in named if slot.has(arguments)]
        waiting = [slot for slot in same if not slot.is_delivered]
        edited = [slot for slot in named if not slot.is_delivered]
        return next(iter([*waiting, *reversed(same), *edited]), None)


def _meaning(arguments: Arguments) -> str:
    return arguments.text if arguments.values is None else json.dumps(arguments.values, sort_keys=True)
