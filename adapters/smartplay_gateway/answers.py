"""Answers: what an endpoint did to a prompt, said in the answer of the model as its provider says it, streamed or not.

Anthropic says it in `context_management` and in `usage.iterations`, and begins the content with a block `compaction`;
OpenAI begins the output with an item of that type.
"""

from __future__ import annotations

import asyncio
import json
import re
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from smartplay_gateway.window.messages_format import MESSAGES_FORMAT, block_events
from smartplay_tools import Usage
from smartplay_tools.players.wire import RESPONSES
from smartplay_tools.types.arguments import object_in

if TYPE_CHECKING:
    from starlette.requests import Request

Json = dict[str, Any]

ENDS = ("response.completed", "response.incomplete", "response.failed")
"""The events of Responses that hold the whole answer."""

COUNTS = ("input_tokens", "output_tokens", "cache_creation_input_tokens", "cache_read_input_tokens")
"""The counts of an iteration of Messages."""


GONE = 499
"""The status of a request whose client has gone, as web servers log it; nobody receives it."""


async def while_connected(request: Request, work: Awaitable[Json]) -> Json | None:
    """Return what is awaited; None once the client has gone, after which nothing of it goes on."""

    async def left() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    task, gone = asyncio.ensure_future(work), asyncio.create_task(left())
    try:
        await asyncio.wait({task, gone}, return_when=asyncio.FIRST_COMPLETED)
        return None if gone.done() else task.result()
    finally:
        task.cancel()
        gone.cancel()


@dataclass
class Report:
    """What one answer says beside what the model has said."""

    form: str
    edits: list[Json] | None = None
    """The edits that were applied; None if none were asked for."""
    compaction: Json | None = None
    """The item or the block with a summary."""
    asked: Any = None
    """The usage of the question for it, as it was reported."""
    is_alone: bool = False
    """Whether the model was asked for nothing else."""
    _usage: Json = field(default_factory=dict)
    _has_begun: bool = False

    def empty(self, model: Any, stop: str) -> Json:
        """Return the whole answer of a request after whose compaction nothing was asked."""
        if self.form == "responses":
            answer = RESPONSES.write({"role": "assistant", "content": ""}, str(model), Usage())
            return self.whole({**answer, "output": [], "usage": None})
        answer = MESSAGES_FORMAT.write({"role": "assistant", "content": ""}, Usage(), {"model": model})
        return self.whole({**answer, "content": [], "stop_reason": stop})

    def compacted_response(self, words: Sequence[Json]) -> Json:
        """Return the answer of `/responses/compact`: the words of users, and the item."""
        output = [
            {
                "id": f"msg_{uuid.uuid4().hex}",
                "status": "completed",
                **item,
                "type": "message",
                "content": [{"type": "input_text", "text": item["content"]}]
                if isinstance(item.get("content"), str)
                else item.get("content"),
            }
            for item in words
        ]
        own = {"id": f"resp_{uuid.uuid4().hex}", "object": "response.compaction", "created_at": int(time.time())}
        return {**own, "output": [*output, self.compaction], "usage": added(None, self.asked)}

    def whole(self, answer: Json) -> Json:
        """Return a whole answer with what it says beside."""
        if self.form == "responses":
            if not isinstance(output := answer.get("output"), list):
                return answer
            own = [] if self.compaction is None else [self.compaction]
            usage = answer.get("usage") if self.asked is None else added(answer.get("usage"), self.asked)
            return {**answer, "output": [*own, *output], "usage": usage}
        if answer.get("type") != "message":
            return answer
        if self.compaction is not None:
            answer = {**answer, "content": [self.compaction, *(answer.get("content") or ())]}
        return self._told(answer)

    def _told(self, holder: Json) -> Json:
        """A message, or the event with its usage, with the edits and the iterations in it."""
        told = {**holder}
        if self.edits is not None:
            theirs = holder.get("context_management")
            others = theirs.get("applied_edits") if isinstance(theirs, Mapping) else None
            told["context_management"] = {"applied_edits": [*self.edits, *(others or ())]}
        if self.asked is not None:
            usage = holder["usage"] if isinstance(holder.get("usage"), Mapping) else {}
            others = usage.get("iterations") or ([] if self.is_alone else [iteration("message", self._usage | usage)])
            told["usage"] = {**usage, "iterations": [iteration("compaction", self.asked), *others]}
        return told

    async def passed(self, pieces: AsyncIterator[bytes], *, is_stream: bool) -> AsyncIterator[bytes]:
        """Yield an answer that comes in pieces, with what it says beside."""
        kept = b""
        async for piece in pieces:
            kept += piece
            if is_stream:
                *blocks, kept = re.split(rb"(?:\r?\n){2}", kept)
                for block in blocks:
                    yield self._passed_event(block) + b"\n\n"
        if kept:
            value = None if is_stream else object_in(kept)
            yield kept if value is None else json.dumps(self.whole(value)).encode()

    def _passed_event(self, block: bytes) -> bytes:
        data = b"\n".join(line[5:].strip() for line in block.splitlines() if line.startswith(b"data:"))
        event = object_in(data)
        if event is None:
            return block
        return b"\n\n".join(
            b"event: %b\ndata: %b" % (str(each.get("type")).encode(), json.dumps(each).encode())
            for each in self._events(event)
        )

    def _events(self, event: Json) -> Iterator[Json]:
        """Yield the events that the client gets for an event of the upstream."""
        kind, own = event.get("type"), self.compaction
        if self.form == "responses":
            if own is not None and not self._has_begun and ("output_index" in event or kind in ENDS):
                self._has_begun = True
                for at, step in enumerate(("added", "done")):
                    number = {"sequence_number": event.get("sequence_number", 0) + at, "output_index": 0}
                    yield {"type": f"response.output_item.{step}", **number, "item": own}
            if self._has_begun:
                shifts = {"sequence_number": 2, "output_index": 1}
                event |= {name: event[name] + by for name, by in shifts.items() if type(event.get(name)) is int}
            if kind in ENDS and isinstance(event.get("response"), dict):
                event["response"] = self.whole(event["response"])
            yield event
            return
        if own is not None and type(event.get("index")) is int:
            event["index"] += 1
        if kind == "message_start" and isinstance(message := event.get("message"), Mapping):
            given = message.get("usage")
            self._usage = dict(given) if isinstance(given, Mapping) else {}
        yield self._told(event) if kind == "message_delta" else event
        if kind == "message_start" and own is not None:
            yield from (each for _, each in block_events(0, own))


def iteration(kind: str, usage: Any) -> Json:
    """Return an entry of `usage.iterations`."""
    given = usage if isinstance(usage, Mapping) else {}
    return {"type": kind, **{name: given.get(name) or 0 for name in COUNTS}}


def added(one: Any, other: Any) -> Any:
    """Return the sum of two usages of Responses, field by field."""
    if isinstance(one, Mapping) or isinstance(other, Mapping):
        first, second = (each if isinstance(each, Mapping) else {} for each in (one, other))
        return {name: added(first.get(name), second.get(name)) for name in {**first, **second}}
    counts = [each for each in (one, other) if type(each) is int]
    return sum(counts) if counts else one if other is None else other
