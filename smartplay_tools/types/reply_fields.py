"""The fields of a reply: which are counted, which go back to the model, and how the pieces of a stream are merged.

Providers put thoughts, signatures and further data beside the words and calls of a reply, each under names of its own.
A field goes back under the name under which it came, whole. Counted is every text in it that a person could read, at
any depth, also in fields that nobody has listed here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["NOT_COUNTED", "NOT_SENT", "REPLY_FIELDS", "merged"]


@dataclass(frozen=True, slots=True)
class ReplyField:
    """A field of a reply, or a type of its parts."""

    interface: Literal["chat", "Responses", "Messages"]
    name: str
    said_by: str
    """Which providers send it, or what it holds."""
    is_counted: bool = True
    is_sent: bool = True
    """Whether it goes back to the model."""
    pieces: str = "joined"
    """How its pieces in a stream are merged."""
    empty: str = "as none"
    """What an empty value means; null is always as if the field were not there."""


_CHAT = (
    ReplyField("chat", "content", "the words; Mistral's thoughts are parts of it, which go back before the words"),
    ReplyField("chat", "refusal", "the words of a refusal, where there are no others", pieces="joined"),
    ReplyField(
        "chat", "tool_calls", "the calls; arguments are text or an object", pieces="name: the first; arguments: joined"
    ),
    ReplyField("chat", "reasoning_content", "DeepSeek, Kimi, llama.cpp, SGLang", empty="a value beside calls"),
    ReplyField("chat", "reasoning", "vLLM, OpenRouter, Ollama", empty="a value beside calls"),
    ReplyField("chat", "reasoning_details", "OpenRouter, MiniMax", pieces="by index and type"),
    ReplyField("chat", "thinking_blocks", "LiteLLM", pieces="neighbours, up to the signature"),
    ReplyField("chat", "extra_content, in a call", "Gemini's signature of a thought", pieces="the last"),
    ReplyField("chat", "annotations", "citations", is_counted=False, is_sent=False),
    ReplyField("chat", "audio", "speech", is_counted=False, is_sent=False),
    ReplyField("chat", "function_call", "the older form of a call", is_counted=False, is_sent=False),
    ReplyField("chat", "any other", "", empty="text, list, object: as none"),
)
_RESPONSES = (
    ReplyField("Responses", "message", "the words, or those of a refusal", pieces="the items that are done"),
    ReplyField("Responses", "function_call", "a call", pieces="the items that are done"),
    ReplyField(
        "Responses",
        "reasoning",
        "a summary or the text of thoughts, and encrypted ones",
        pieces="the items that are done",
    ),
    ReplyField("Responses", "any other", "", pieces="the items that are done"),
)
_MESSAGES = (
    ReplyField("Messages", "text", "the words", pieces="not streamed here"),
    ReplyField("Messages", "tool_use", "a call", pieces="not streamed here"),
    ReplyField(
        "Messages", "thinking", "thoughts and their signature", pieces="not streamed here", empty="as any other"
    ),
    ReplyField("Messages", "redacted_thinking", "encrypted thoughts", is_counted=False, pieces="not streamed here"),
    ReplyField("Messages", "any other", "", pieces="not streamed here", empty="as any other"),
)
REPLY_FIELDS: Sequence[ReplyField] = (*_CHAT, *_RESPONSES, *_MESSAGES)
"""The table; what it says of "any other" holds for every field that it does not name."""

NOT_SENT = frozenset(field.name for field in _CHAT if not field.is_sent)
"""The fields of a chat completion's message that requests must not have."""

NOT_COUNTED = frozenset(
    {"id", "call_id", "call_ids", "tool_call_id", "response_id", "index", "encrypted_index"}
    | {"type", "kind", "part_kind", "role", "phase", "format", "status", "cache_control"}
    | {"signature", "thought_signature", "thoughtSignature", "encrypted_content"}
    | {"model", "model_name", "model_provider", "provider_name"}
)
"""The names, at any depth, of texts that nobody reads: ids, types, signatures, encrypted data, names of models."""

ENCRYPTED = {"redacted_thinking": "data", "reasoning.encrypted": "data"}
"""The types of parts with an encrypted field, and the field."""

CALLS = frozenset({"tool_use", "tool-call", "tool_call", "function_call", "invalid_tool_call"})
"""The types of parts that are calls, which count as such."""

BESIDE = frozenset({"reasoning", "chat_thinking", "chat_call_fields", "chat_reasoning"})
"""The types of provider items that go back beside the reply's own text; those of other types hold the whole reply."""


def readable(items: Sequence[Any], own: str) -> Iterator[str]:
    """Yield the texts of provider items that a person could read.

    An item may be the whole reply in the form of its framework: what of it is in `own` too, the reply's text, thoughts
    and calls, is counted there.
    """
    for item in items:
        kind = item.get("type") if isinstance(item, Mapping) else None
        if kind is None and isinstance(item, Mapping):
            item = {name: value for name, value in item.items() if name not in NOT_SENT}
        for text in texts_in(item):
            if kind is not None and kind not in BESIDE and text in own:
                own = own.replace(text, "", 1)
            else:
                yield text


def texts_in(value: Any) -> Iterator[str]:
    """Yield the texts of plain data that a person could read, in their order; a call has none of its own."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from texts_in(item)
    elif isinstance(value, Mapping) and (kind := value.get("type", value.get("part_kind"))) not in CALLS:
        encrypted = ENCRYPTED.get(kind) if isinstance(kind, str) else None
        if value.get("redacted") is True:  # as Inspect marks it
            encrypted = "reasoning"
        for name, inner in value.items():
            if name not in NOT_COUNTED and name != encrypted:
                yield from texts_in(inner)


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
    return end - 1 if is_next and kind in ("text", "thinking", "reasoning.text", "reasoning.summary") else end
