"""A whole conversation: every message of an episode, as if there had been no window.

In the record of a window, the manual that a model has read is in the head of every later prompt, and the result that
read it refers to it there; in a whole conversation the manual is that result. The record of an episode whose host
managed the context has calls and answers only: its conversation has a message for each turn of calls, and the head is
that of a new episode of the same config. The words that the host's model said with its calls are in no record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

from smartplay_tools.context.turns import Turn, TurnBuilder
from smartplay_tools.conversation.ids import CallIds
from smartplay_tools.episode.episode import Episode
from smartplay_tools.episode.tools import schema
from smartplay_tools.transcript.events import CallEvent
from smartplay_tools.types.messages import Message, read_calls

if TYPE_CHECKING:
    from smartplay_tools.records.record import Record


@dataclass(frozen=True)
class WholeConversation:
    """The head, the tools and the turns of an episode."""

    head: Sequence[Message]
    """The messages before the first reply."""
    tools: list[dict[str, Any]]
    """The tools, each a function of chat completions."""
    turns: Sequence[Turn]
    """The turns, each manual that was read in its place."""

    @property
    def messages(self) -> list[Message]:
        """All messages, in their order."""
        return [*self.head, *(message for turn in self.turns for message in turn.messages)]


def whole_conversation(record: Record) -> WholeConversation:
    """Return the conversation of a record; one of the paper's protocol has none (`InvalidArgumentError`)."""
    if record.config.context == "host":
        head, tools = _head_of_a_host(record)
        calls = _renumbered(record.calls)
        turns = _turns_of_a_host(calls)
    else:
        turns, calls = record.turns, record.calls
        head, tools = record.head_messages, record.tools
    read = {(call["turn"], call["position"]) for call in calls if call["data"].get("manual")}
    return WholeConversation(head, tools, [_with_manual(turn, read) for turn in turns])


def _with_manual(turn: Turn, read: set[tuple[int, int]]) -> Turn:
    """The turn whose results that read the manual are the manual."""
    if turn.manual is None or not any(number == turn.number for number, _ in read):
        return turn
    items = (
        replace(item, message={**item.message, "content": turn.manual})
        if (turn.number, item.position) in read
        else item
        for item in turn.items
    )
    return replace(turn, items=tuple(items))


def _head_of_a_host(record: Record) -> tuple[list[Message], list[dict[str, Any]]]:
    with Episode.from_config(record.config) as episode:
        return episode.head, [{"type": "function", "function": schema(tool, "json")} for tool in episode.tools]


def _renumbered(calls: Sequence[CallEvent]) -> Sequence[CallEvent]:
    """The calls with their place among those of their turn that were played: a repeated call is not recorded."""
    turns = (list(group) for _, group in groupby(calls, key=lambda call: call["turn"]))
    return [{**call, "position": at} for own in turns for at, call in enumerate(own)]


def _turns_of_a_host(calls: Sequence[CallEvent]) -> Sequence[Turn]:
    builder, ids = TurnBuilder(), CallIds()
    for number, group in groupby(calls, key=lambda call: call["turn"]):
        own = list(group)
        taken = ids.take([""] * len(own), number)
        message = _asking(own, taken)
        builder.open(number, message, read_calls(message, taken))
        for call in own:
            builder.add_result(call["position"], call["text"], call["data"])
    builder.close()
    return builder.turns


def _asking(calls: Sequence[CallEvent], ids: Sequence[str]) -> Message:
    """The message of a model that makes these calls."""
    return {
        "role": "assistant",
        "content": None,
        "tool_calls": [
            {
                "id": call_id,
                "type": "function",
                "function": {"name": call["name"], "arguments": call["arguments"] or "{}"},
            }
            for call, call_id in zip(calls, ids, strict=True)
        ],
    }
