"""Streams: how the pieces of a field become its value, and those of calls the calls.

Providers stream thoughts as lists of parts, some with an index and some without, and end a part with its signature. A
reply of which the pieces stay apart is refused when it goes back.

A piece of a call belongs to the call with its index or its id. Servers give all calls one index, or leave it out, or
count pieces of a call on: what has neither a name nor an id never begins a call where there is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from smartplay_tools.players.wire.problems import objects
from smartplay_tools.providers.reply_fields import NEIGHBOURS, NOT_COUNTED
from smartplay_tools.types.arguments import meaning, read


def merged(before: Any, piece: Any) -> Any:
    """Return a value to which a piece of a stream is added: texts are joined, parts of one kind become one."""
    if isinstance(before, str) and isinstance(piece, str):
        return before + piece
    if isinstance(before, list) and isinstance(piece, list):
        parts = before.copy()
        for part in piece:
            at = _begun(parts, part)
            parts[at:] = [merged(parts[at], part), *parts[at + 1 :]] if at < len(parts) else [part]
        return parts
    if isinstance(before, Mapping) and isinstance(piece, Mapping):
        return {**before, **{name: _merged_field(name, before.get(name), value) for name, value in piece.items()}}
    return piece if before is None or piece not in (None, "") else before


def _merged_field(name: str, before: Any, piece: Any) -> Any:
    return (piece or before) if name in NOT_COUNTED else merged(before, piece)


def _begun(parts: Sequence[Any], piece: Any) -> int:
    """The place of the part that a piece continues; the end of the parts if it begins another one.

    Pieces of one part have its index, where their server counts; otherwise they follow each other up to its signature.
    """
    end = len(parts)
    kind = piece.get("type") if isinstance(piece, Mapping) else None
    if not isinstance(kind, str):
        return end
    same = [at for at, part in enumerate(parts) if isinstance(part, Mapping) and part.get("type") == kind]
    if (index := piece.get("index")) is not None:
        return next((at for at in same if parts[at].get("index") == index), end)
    is_next = bool(same) and same[-1] == end - 1 and not parts[-1].get("signature")
    return end - 1 if is_next and kind in NEIGHBOURS else end


@dataclass
class StreamedCall:
    """A call of a stream, as far as its pieces have come."""

    index: int
    id: str = ""
    name: str = ""
    arguments: Any = ""
    latest: Any = ""
    """The latest piece of the arguments."""
    own: dict[str, Any] = field(default_factory=dict)
    """What the server has added."""

    @property
    def is_whole(self) -> bool:
        """Whether it has its name and arguments that are an object."""
        return bool(self.name) and read(once(self.arguments, self.latest)).problem is None

    def whole(self) -> dict[str, Any]:
        """Return the call as a whole answer has it."""
        function = {"name": self.name, "arguments": once(self.arguments, self.latest)}
        return {"id": self.id, "type": "function", "function": function, **self.own}


def add_call(calls: list[StreamedCall], part: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Add a piece, with what a server has added to it, to the calls of a stream."""
    (function,) = objects([part.get("function")]) or ({},)
    call_id, name, arguments = part.get("id") or "", function.get("name") or "", function.get("arguments")
    call = _continued(calls, part.get("index"), call_id, name, arguments)
    if call is None:
        index = part.get("index")
        call = StreamedCall(index if isinstance(index, int) else calls[-1].index if calls else 0)
        calls.append(call)
    call.own |= own
    call.id, call.name = call.id or call_id, call.name or name  # names are whole, and some servers repeat them
    if call.arguments == "" and arguments is not None:
        call.arguments = arguments
    else:
        call.arguments = merged(call.arguments, arguments)
    call.latest = arguments or call.latest


def _continued(
    calls: Sequence[StreamedCall], index: Any, call_id: str, name: str, arguments: Any
) -> StreamedCall | None:
    """The call that a piece continues; None if it begins another."""
    if not calls:
        return None
    named = calls[-1] if not call_id else next((call for call in reversed(calls) if call.id == call_id), None)
    if isinstance(index, int):
        call = next((call for call in reversed(calls) if call.index == index), None)
        if call is None:
            return None if name else named
        is_other = bool(call.id and call_id and name)  # some servers give all calls of a reply the index 0
    else:
        call, is_other = named or calls[-1], bool(call_id)  # some leave it out
    if not call_id and not call.id:
        # Neither tells a call from the next: one whose arguments are whole is over when a name and arguments follow.
        return None if name and arguments and call.arguments and call.is_whole else call
    return None if is_other and call.id != call_id else call


def once(arguments: Any, latest: Any) -> Any:
    """Return streamed arguments without their beginning, if the latest piece has all of them again, as vLLM's last may.

    What was said twice by the model is not in such pieces, and stays its mistake.
    """
    is_text = isinstance(arguments, str) and isinstance(latest, str)
    if not is_text or latest == arguments or read(arguments).problem is None:
        return arguments
    before, again = arguments.removesuffix(latest), read(latest)
    is_again = latest.startswith(before) or meaning(read(before)) == meaning(again)
    return latest if again.problem is None and is_again else arguments


PIECES = {
    "response.function_call_arguments": "arguments",
    "response.output_text": "text",
    "response.refusal": "refusal",
}
"""The field of an item, or of a part of it, of which each kind of event in a Responses stream has a piece."""


class StreamedItems:
    """The output of a Responses stream: items as their last events have them, or as they have come until then."""

    def __init__(self) -> None:
        self._items: dict[int, dict[str, Any]] = {}
        self._latest: dict[int, Any] = {}
        """The latest pieces of arguments."""
        self._done: set[int] = set()

    def add(self, event: Mapping[str, Any]) -> None:
        """Take an event; one without an index is of the item that has begun last."""
        (what, _, end), item = str(event.get("type")).rpartition("."), event.get("item")
        begun = [at for at in self._items if at not in self._done and end != "added"]
        at = event.get("output_index")
        at = at if isinstance(at, int) else begun[-1] if begun else len(self._items)
        if what == "response.output_item" and isinstance(item, Mapping) and at not in self._done:
            self._items[at] = {**item}
            self._done |= {at} if end == "done" else set()
        elif what in PIECES and at in begun:
            field = PIECES[what]
            if field == "arguments":
                holder, self._latest[at] = self._items[at], event.get("delta") or self._latest.get(at)
            else:
                holder = self._part(at, event.get("content_index"), what.removeprefix("response."))
            before = holder.get(field)
            holder[field] = merged(before, event.get("delta")) if end == "delta" else event.get(field, before)

    def _part(self, at: int, place: Any, kind: str) -> dict[str, Any]:
        """A part of a message's content, which begins with its first piece."""
        parts = [{**part} for part in objects(self._items[at].get("content"))]
        if not parts or (isinstance(place, int) and place >= len(parts)):
            parts.append({"type": kind})
        self._items[at]["content"] = parts
        return parts[place if isinstance(place, int) and 0 <= place < len(parts) else -1]

    @property
    def output(self) -> list[dict[str, Any]]:
        """The items in their order."""
        return [self._whole(at) for at in sorted(self._items)]

    @property
    def is_whole(self) -> bool:
        """Whether nothing is open, and there are calls, which are all whole: then nothing more has to come."""
        calls = [item for item in self.output if item.get("type") == "function_call"]
        whole = [bool(call.get("name")) and read(call.get("arguments")).problem is None for call in calls]
        return self._done == self._items.keys() and bool(calls) and all(whole)

    def _whole(self, at: int) -> dict[str, Any]:
        item = self._items[at]
        return {**item, "arguments": once(item["arguments"], self._latest.get(at))} if "arguments" in item else item
