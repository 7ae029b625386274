"""The items of the Agents SDK's runner as canonical messages, and prompts as items."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from agents import ModelResponse
from agents.usage import Usage as AgentsUsage
from openai.types.responses import ResponseFunctionToolCall, ResponseOutputMessage, ResponseOutputText

from smartplay_openai.responses import RESPONSES, read_items
from smartplay_tools import InvalidArgumentError, Message, Prompt, Usage
from smartplay_tools.types.messages import text_of, words_of

Item = Mapping[str, Any]

OVER = "smartplay_over"
"""The id of the message that ends a run."""


def before_the_game(items: Sequence[Item], ours: set[str]) -> list[Message]:
    """The messages that a run begins with; an earlier episode in the same session of the SDK is left out."""
    begin = 0
    for at, item in enumerate(items):
        if item.get("id") == OVER or item.get("name") in ours:
            begin = at + 1
    while begin < len(items) and (items[begin].get("type") == "function_call_output"):
        begin += 1
    return RESPONSES.read({"input": list(items[begin:])}).messages if begin < len(items) else []


def since_reply(items: Sequence[Item], first_call: str) -> list[Message]:
    """The results and the user messages after the latest reply's first call, read from the end."""
    for at in range(len(items) - 1, -1, -1):
        if items[at].get("type") == "function_call" and items[at].get("call_id") == first_call:
            return [message for item in items[at + 1 :] for message in _from_item(item)]
    raise InvalidArgumentError(
        "The runner's input has no trace of the model's latest reply. The window decides what a model sees: leave out "
        "input filters and nested histories of handoffs, and go on with the items of the run."
    )


def has_calls(items: Sequence[Item]) -> bool:
    """Whether there is any call of a tool among the items of a run."""
    return any(item.get("type") == "function_call" for item in items)


def known_by(item: Item) -> tuple[Any, str]:
    """Return what tells an item from others, and its text."""
    text, _ = words_of(item.get("output", item.get("content", item.get("arguments"))))
    return (item.get("type"), item.get("role"), item.get("call_id"), text), text


def _from_item(item: Item) -> list[Message]:
    if item.get("type") == "function_call_output":
        return [{"role": "tool", "tool_call_id": item["call_id"], "content": item.get("output")}]
    return [{"role": "user", "content": _text(item["content"])}] if item.get("role") == "user" else []


def input_of(prompt: Prompt, *, mark: bool) -> list[Any]:
    """The prompt as input items. The SDK's converter knows an output without an id only as a plain message."""
    return [
        {"role": item["role"], "content": _text(item["content"])}
        if item.get("type") == "message" and item.get("role") == "assistant" and "id" not in item
        else item
        for item in RESPONSES.conversation(prompt, mark=mark)["input"]
    ]


def read_response(response: ModelResponse) -> Message:
    """A reply in canonical form."""
    return read_items([item.model_dump(exclude_unset=True) for item in response.output])


def _text(content: Any) -> str:
    """The text of a message; parts that are not text are an `InvalidArgumentError`."""
    return content if isinstance(content, str) else text_of({"content": content})


def usage_of(usage: AgentsUsage) -> Usage | None:
    """The usage of a reply; None if the provider has reported none."""
    if not usage.input_tokens and not usage.output_tokens:
        return None
    return Usage(
        prompt=usage.input_tokens,
        reply=usage.output_tokens,
        cached=usage.input_tokens_details.cached_tokens or 0,
        written=getattr(usage.input_tokens_details, "cache_write_tokens", None) or 0,
        reasoning=usage.output_tokens_details.reasoning_tokens or 0,
        requests=usage.requests,
    )


def calls_in(response: ModelResponse) -> list[ResponseFunctionToolCall]:
    """The calls of a response."""
    return [item for item in response.output if isinstance(item, ResponseFunctionToolCall)]


def last_words(text: str, usage: AgentsUsage) -> ModelResponse:
    """Return words that end the agent's run, and that the model has not said."""
    content = ResponseOutputText(text=text, type="output_text", annotations=[])
    message = ResponseOutputMessage(id=OVER, content=[content], role="assistant", status="completed", type="message")
    return ModelResponse(output=[message], usage=usage, response_id=None)
