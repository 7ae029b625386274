"""Anthropic's Messages interface at the window, for Claude Code, the Claude Agent SDK and Anthropic's clients.

It is read as leniently as OpenAI's: `cache_control`, thinking, betas and the tools of Anthropic's servers are left out
and named. Thoughts of the model are sent to clients that ask for `thinking`. The client's tool runner sends, in a
`thread`, only the results of the latest calls; a thread that a restart has made unknown is refused with the code at
which the client sends everything again.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator, Mapping
from typing import Any

from smartplay_gateway.surfaces import MESSAGES
from smartplay_gateway.window.formats import (
    CompletionRequest,
    HostFormat,
    Ignored,
    fields_of,
    functions_of,
    json_schema,
    messages_of,
)
from smartplay_tools import Message, Usage
from smartplay_tools.players.conversion import encodable, halves
from smartplay_tools.players.wire import Event, RequestError, objects, read_tools
from smartplay_tools.types.messages import calls_of, text_of, words_of

OURS, THEIRS = "call_", "toolu_"
"""What the ids of calls begin with: in the window, and in this interface."""

USED = {"messages", "system", "tools", "thread"}
PLACEHOLDER = "DeferredToolPlaceholder"
"""A tool of Claude Code's that stands for those it has not loaded."""

COMPACTION = "CRITICAL: Respond with TEXT ONLY"
"""With these words Claude Code asks for a summary of its messages, in a request that offers all tools."""

DELTAS = {
    "text": ("text", "text_delta", "text"),
    "thinking": ("thinking", "thinking_delta", "thinking"),
    "tool_use": ("input", "input_json_delta", "partial_json"),
    "compaction": ("content", "compaction_delta", "content"),
}
"""For each type of block: the field that is streamed, the type of its pieces, and the field that has them."""

NOTHING = "..."
"""Replaces an empty message, which the interface does not have."""


class MessagesFormat(HostFormat):
    """Anthropic's Messages."""

    path = "/v1/messages"
    alive = 'event: ping\ndata: {"type": "ping"}\n\n'

    def read(self, body: Mapping[str, Any]) -> CompletionRequest:
        """Return what a request says."""
        messages = messages_of(body, "messages")
        ignored = Ignored(fields=fields_of(body, USED))
        system = [ignored.hear("system", body["system"])] if body.get("system") else []
        results, calls = dict[str, Any](), dict[str, tuple[str, Any]]()
        for message in objects(messages):
            role, content = str(message.get("role")), message.get("content")
            blocks = content if isinstance(content, list) else [{"type": "text", "text": content or ""}]
            answers = [block for block in objects(blocks) if block.get("type") == "tool_result"]
            results |= {_ours(str(block.get("tool_use_id"))): block.get("content") for block in answers}
            kept = [block for block in objects(blocks) if block.get("type") != "tool_result"]
            used = [block for block in kept if block.get("type") == "tool_use"]
            calls |= {_ours(str(block.get("id"))): (str(block.get("name")), block.get("input")) for block in used}
            if kept and not used:
                text = ignored.hear(role, kept)
                system += [text] if role == "system" else []
        functions, left_out = _functions(body)
        text = json.dumps(body)
        if "cache_control" in text:
            ignored.fields = sorted({*ignored.fields, "cache_control"})
        thread = body.get("thread")
        output, choice = body.get("output_config"), body.get("tool_choice")
        continues = isinstance(thread, Mapping) and thread.get("type") == "continue"
        return CompletionRequest(
            read_tools({"tools": functions}, None, strict=False),
            results,
            text.replace(THEIRS, OURS),
            ignored,
            "\n\n".join(system),
            left_out,
            calls,
            one_call=isinstance(choice, Mapping) and choice.get("disable_parallel_tool_use") is True,
            forbids_calls=_forbids_calls(choice, messages),
            answer_schema=json_schema(
                output.get("format") if isinstance(output, Mapping) else body.get("output_format")
            ),
            continues=continues,
            messages=() if continues else messages,
        )

    def write(self, message: Message, usage: Usage, body: Mapping[str, Any]) -> dict[str, Any]:
        """Return the message; tokens read from and written to the cache are counted apart, as the interface does."""
        text, calls = text_of(message), calls_of(message)
        blocks: list[dict[str, Any]] = [{"type": "text", "text": text}] if text.strip() or not calls else []
        for call in calls:
            function = call["function"]
            given = {"name": function["name"], "input": encodable(json.loads(function["arguments"] or "{}"))}
            blocks.append({"type": "tool_use", "id": THEIRS + call["id"].removeprefix(OURS), **given})
        if blocks[0].get("text") == "":
            blocks[0]["text"] = NOTHING
        thinking = body.get("thinking")
        if isinstance(thinking, Mapping) and thinking.get("type") != "disabled":
            thoughts = message.get("reasoning_content")
            blocks = [*([{"type": "thinking", "thinking": thoughts, "signature": ""}] if thoughts else []), *blocks]
        return {
            "id": f"msg_{uuid.uuid4().hex[:24]}",
            "type": "message",
            "role": "assistant",
            "model": str(body["model"]),
            "content": blocks,
            "stop_reason": "tool_use" if calls else "end_turn",
            "stop_sequence": None,
            "usage": {
                "input_tokens": usage.prompt - (usage.cached or 0) - usage.written,
                "cache_creation_input_tokens": usage.written,
                "cache_read_input_tokens": usage.cached or 0,
                "output_tokens": usage.reply,
            },
        }

    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield the message's events: text and input in two pieces each, so that readers have to join them."""
        begun = {**answer, "content": [], "stop_reason": None, "usage": {**answer["usage"], "output_tokens": 0}}
        yield _event("message_start", message=begun)
        for index, block in enumerate(answer["content"]):
            yield from block_events(index, block)
        end = {"stop_reason": answer["stop_reason"], "stop_sequence": None}
        yield _event("message_delta", delta=end, usage=answer["usage"])
        yield _event("message_stop")

    def failure(self, error: RequestError) -> Event:
        """Return the event of a stream that ends without a message."""
        return "error", MESSAGES.refusal(error)


def _functions(body: Mapping[str, Any]) -> tuple[list[Any], list[str]]:
    """The tools of a request as functions, and what those are that Anthropic's servers run."""
    tools = body.get("tools")
    if isinstance(tools, list):
        tools = [_function(tool) for tool in tools if not isinstance(tool, Mapping) or tool.get("name") != PLACEHOLDER]
    return functions_of({"tools": tools})


def _function(tool: Any) -> Any:
    """A tool in OpenAI's form, if it is a function; Claude Code's that have `defer_loading` are as good as others."""
    is_function = isinstance(tool, Mapping) and ("input_schema" in tool or tool.get("type") in (None, "custom"))
    return {**tool, "type": "function", "parameters": tool.get("input_schema")} if is_function else tool


def _forbids_calls(choice: Any, messages: list[Any]) -> bool:
    if isinstance(choice, Mapping) and choice.get("type") == "none":
        return True
    said = objects(messages)
    return bool(said) and COMPACTION in words_of(said[-1].get("content"))[0]


def _ours(call_id: str) -> str:
    return OURS + call_id.removeprefix(THEIRS)


def block_events(index: int, block: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the events of a block. A compaction comes in one piece; one that is signed begins with it."""
    field, kind, name = DELTAS[block["type"]]
    whole: Any = block[field]
    if kind == "compaction_delta":
        begun, pieces = (block, []) if "signature" in block else ({**block, field: None}, [whole])
    else:
        begun = {**block, field: type(whole)()}
        pieces = [*halves(whole if isinstance(whole, str) else json.dumps(whole))]
    yield _event("content_block_start", index=index, content_block=begun)
    for piece in pieces:
        yield _event("content_block_delta", index=index, delta={"type": kind, name: piece})
    yield _event("content_block_stop", index=index)


def _event(kind: str, **data: Any) -> tuple[str, dict[str, Any]]:
    return kind, {"type": kind, **data}


MESSAGES_FORMAT = MessagesFormat()
