"""A reply as the host gets it, and the state of each of its calls.

A host runs the calls of a reply through a transport that knows neither the reply nor the ids of its calls, so which
call is meant has to be told from its name and its arguments.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

from smartplay_openai.problems import RequestError
from smartplay_tools import Message, ToolResult, Usage
from smartplay_tools.context import Turn
from smartplay_tools.types.arguments import Arguments, read
from smartplay_tools.types.messages import Call, MessageToolCall, words_of

LOST = 20
"""After this many requests in a row without the latest reply's call ids, the host is assumed not to keep ids."""


def call_id(handle: str, number: int, position: int) -> str:
    """Return an id that cannot be guessed, is not used twice, and is the same after a restart."""
    digest = hashlib.sha256(f"{handle} {number} {position}".encode()).hexdigest()
    return f"call_{digest[:24]}"


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

    @classmethod
    def of(
        cls,
        turn: Turn,
        usage: Usage,
        *,
        names: Mapping[str, str],
        foreign: Set[str],
        call_id: Callable[[int, int], str],
    ) -> PendingReply:
        """Return a turn's reply as the host gets it: its words and thoughts, and the calls that the host can run.

        Arguments:
            turn: the turn that the reply has opened.
            usage: what the reply took.
            names: the host's names of the game's tools.
            foreign: the names of the host's own tools.
            call_id: returns the id of a call, given the number of its turn and its place in it.
        """
        slots, calls = [], []
        for position, call in enumerate(turn.calls):
            name = call.name if call.name in foreign else names.get(call.name)
            slot = Slot(call, call_id(turn.number, position), call.name in foreign)
            slot.is_sent = name is not None and call.arguments.values is not None
            slots.append(slot)
            if slot.is_sent:
                function: Any = {"name": name, "arguments": call.arguments.text or "{}"}
                calls.append(MessageToolCall(id=slot.host_id, type="function", function=function))
        message: Message = {"role": "assistant", "content": turn.assistant["content"]}
        if calls:
            message = {**message, "tool_calls": calls}
        if thoughts := turn.assistant.get("reasoning_content"):
            message = {**message, "reasoning_content": thoughts}
        return cls(message, usage, slots)

    @property
    def sent(self) -> Sequence[Slot]:
        """The calls that the host was sent."""
        return [slot for slot in self.slots if slot.is_sent]

    def edited(self, results: Mapping[str, Any]) -> Iterator[str]:
        """Yield the names of the calls whose results the host has changed, which the model sees as they were.

        Hosts put words around a result, and send it as JSON text, too.
        """
        for slot in self.sent:
            if slot.result is not None and not slot.is_foreign and slot.host_id in results:
                shown, text = words_of(results[slot.host_id])[0], slot.result.text
                spelled = (text, json.dumps(text)[1:-1], json.dumps(text, ensure_ascii=False)[1:-1])
                if not any(spelling in shown for spelling in spelled):
                    yield slot.call.name

    def count_repeat(self, *, is_retry: bool) -> None:
        """Take note that it is given again; `RequestError` for a host that seems not to keep the ids of calls."""
        self.repeats += not is_retry and bool(self.slots)
        if self.repeats > LOST:
            raise RequestError(
                400,
                "The requests do not have the ids of the latest reply's tool calls. Use an agent that sends the tool "
                "calls of the model back to it.",
                code="call_ids_lost",
            )

    def called(self, name: str, arguments: Any) -> Slot | None:
        """Find the call that a host runs: the first that waits, else one that was answered, else one that it edited."""
        named = [slot for slot in self.sent if slot.call.name == name and not slot.is_foreign]
        same = [slot for slot in named if slot.has(arguments)]
        waiting = [slot for slot in same if not slot.is_delivered]
        edited = [slot for slot in named if not slot.is_delivered]
        return next(iter([*waiting, *reversed(same), *edited]), None)


def _meaning(arguments: Arguments) -> str:
    return arguments.text if arguments.values is None else json.dumps(arguments.values, sort_keys=True)
