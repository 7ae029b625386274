"""A reply as the host gets it, and the state of each of its calls.

A host runs the calls of a reply through a transport that knows neither the reply nor the ids of its calls, so which
call is meant has to be told from its name and its arguments.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools import Message, ToolResult, Usage
from smartplay_tools.context import Turn
from smartplay_tools.players.wire import RequestError
from smartplay_tools.types.arguments import meaning, read
from smartplay_tools.types.messages import Call, MessageToolCall, words_of

LOST = 20
"""After this many requests in a row without the latest reply's call ids, the host is assumed not to keep ids."""


def call_id(handle: str, number: int, position: int) -> str:
    """Return an id that cannot be guessed, is not used twice, and is the same after a restart."""
    digest = hashlib.sha256(f"{handle} {number} {position}".encode()).hexdigest()
    return f"call_{digest[:24]}"


@dataclass
class Slot:
    """A call of a reply."""

    call: Call
    host_id: str
    name: str | None
    """The host's name of the tool; None for a call that no host can run, which is answered here."""
    is_foreign: bool = False
    result: ToolResult | None = None
    is_delivered: bool = False
    edited: str | None = None
    """The meaning of the arguments with which the host had it played, if they are not the model's."""

    def has(self, arguments: Any) -> bool:
        """Whether the call has these arguments, however their JSON is written: clients parse and print it."""
        return meaning(self.call.arguments) == meaning(read(arguments))

    def as_sent(self) -> MessageToolCall:
        """Return the call in the host's form."""
        function: Any = {"name": self.name, "arguments": self.call.arguments.text or "{}"}
        return {"id": self.host_id, "type": "function", "function": function}


@dataclass
class PendingReply:
    """A reply as the host gets it."""

    message: Message
    usage: Usage
    slots: list[Slot] = field(default_factory=list)
    """All calls of the model's message."""
    sent: Sequence[Slot] = ()
    """The calls that the host is sent with this reply."""
    repeats: int = 0

    @classmethod
    def of(
        cls,
        turn: Turn,
        usage: Usage,
        *,
        own: Mapping[str, str],
        foreign: Mapping[str, str | None],
        call_id: Callable[[int, int], str],
        one_call: bool = False,
    ) -> PendingReply:
        """Return a turn's reply as the host gets it: its words and thoughts, and the calls that the host can run.

        Arguments:
            turn: the turn that the reply has opened.
            usage: what the reply took.
            own: the host's names of the game's tools, by the model's.
            foreign: the host's name of each of its other tools, by the model's name; None for a tool no longer offered.
            call_id: returns the id of a call, given the number of its turn and its place in it.
            one_call: whether the host takes one call at a time; `rest` has the others.
        """
        slots = [
            Slot(
                call,
                call_id(turn.number, position),
                None if call.arguments.values is None else {**own, **foreign}.get(call.name),
                call.name in foreign,
            )
            for position, call in enumerate(turn.calls)
        ]
        message: Message = {"role": "assistant", "content": turn.assistant["content"]}
        if thoughts := turn.assistant.get("reasoning_content"):
            message = {**message, "reasoning_content": thoughts}
        return cls._with_calls(message, usage, slots, 0, one_call)

    @classmethod
    def _with_calls(cls, message: Message, usage: Usage, slots: list[Slot], begin: int, one: bool) -> PendingReply:
        sent = [slot for slot in slots[begin:] if slot.name is not None][: 1 if one else None]
        if sent:
            message = {**message, "tool_calls": [slot.as_sent() for slot in sent]}
        return cls(message, usage, slots, sent)

    @property
    def end(self) -> int:
        """The position after the latest call that the host was sent."""
        return self.slots.index(self.sent[-1]) + 1 if self.sent else 0

    def rest(self, *, one_call: bool) -> PendingReply | None:
        """Return a reply with the calls that the host was not sent yet, which costs nothing; None if there are none."""
        none: Message = {"role": "assistant", "content": None}
        following = self._with_calls(none, Usage(requests=0), self.slots, self.end, one_call)
        return following if following.sent else None

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

    def check_played(self, calls: Mapping[str, tuple[str, Any]]) -> None:
        """Raise a `RequestError` if a call that was played has another name or other arguments among a host's calls.

        `calls` has the host's calls by id. A call of the host's own tool may differ, because the host runs it.
        """
        for slot in self.sent:
            if slot.host_id not in calls or slot.result is None or slot.is_foreign:
                continue
            name, arguments = calls[slot.host_id]
            if name != slot.name or not (slot.has(arguments) or meaning(read(arguments)) == slot.edited):
                raise RequestError(
                    400,
                    f"The call {slot.host_id} of {slot.name} has been played with {slot.call.arguments.text or '{}'}; "
                    "what was played cannot be changed. Send the call back as it was; to have other arguments played, "
                    "run the tool with them before its result is there.",
                    code="call_was_played",
                )

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

    def called(self, name: str, arguments: Any, before: PendingReply | None) -> Slot | None:
        """Find the call that a host runs: the first that waits, else one that was answered, else one that it edited.

        A call that only the reply `before` has, and that was answered, is a late copy.
        """
        named = [slot for slot in self.sent if slot.call.name == name and not slot.is_foreign]
        same = [slot for slot in named if slot.has(arguments)]
        waiting = [slot for slot in same if not slot.is_delivered]
        late = [slot for slot in (before.slots if before else ()) if slot.call.name == name and slot.has(arguments)]
        answered = [slot for slot in reversed(late) if slot.result is not None and not slot.is_foreign]
        edited = [slot for slot in named if not slot.is_delivered]
        return next(iter([*waiting, *reversed(same), *answered, *edited]), None)
