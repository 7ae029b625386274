"""Chat messages: one canonical form for what a model is sent and what it answers.

A message is a dictionary in the form of OpenAI's chat completions, because most people know it and most servers accept
it. Every adapter converts to this form first, so the same conversation has the same token count and the same record
in every framework.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NotRequired, Required

from typing_extensions import TypedDict  # Pydantic, which checks recorded messages, needs it on Python 3.11

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.request_limits import most
from smartplay_tools.types.arguments import DEEPEST, Arguments, Problem, as_text, read, well_formed
from smartplay_tools.types.pictures import is_picture

__all__ = [
    "Call",
    "FunctionCall",
    "Message",
    "MessageToolCall",
    "assistant_message",
    "calls_of",
    "pictures_of",
    "reasoning_of",
    "text_of",
    "words_of",
]


class FunctionCall(TypedDict):
    """Name and arguments of a tool call; the arguments are JSON text, as the model wrote it."""

    name: str
    arguments: str


class MessageToolCall(TypedDict, total=False):
    """A tool call in an assistant message."""

    id: str
    type: Literal["function"]
    function: Required[FunctionCall]


class Message(TypedDict, total=False):
    """One chat message.

    `content` is text or a list of text parts; in a result it may also name pictures, which are in `Prompt.pictures`:
    `{"type": "image", "sha256": ..., "width": ..., "height": ...}`. `provider_items` holds what a provider wants back
    unchanged, such as reasoning items: it is recorded and counted (what is readable), and stays out of the prompt's
    hash.
    """

    role: Required[Literal["system", "developer", "user", "assistant", "tool"]]
    content: Required[str | list[dict[str, Any]] | None]
    name: NotRequired[str]
    tool_calls: NotRequired[list[MessageToolCall]]
    tool_call_id: NotRequired[str]
    reasoning_content: NotRequired[str]
    provider_items: NotRequired[list[Any]]


def text_of(message: Mapping[str, Any]) -> str:
    """Return the text of a message, its parts joined, without its pictures of the game.

    Any other part is an `InvalidArgumentError`.
    """
    return text_and_pictures(message)[0]


def words_of(content: Any) -> tuple[str, Counter[str]]:
    """Return the text of what a host sent, which names its parts without text, and the number of these by type."""
    if isinstance(content, str) or content is None:
        return content or "", Counter()
    texts: list[str] = []
    kinds: Counter[str] = Counter()
    for part in content if isinstance(content, list | tuple) else [content]:
        text = part.get("text") if isinstance(part, Mapping) else part
        if isinstance(text, str):
            texts.append(text)
        else:
            kind = str(part.get("type")) if isinstance(part, Mapping) else type(part).__name__
            kinds[kind] += 1
            texts.append(f"[{kind} that is not shown]")
    return "".join(texts), kinds


def pictures_of(message: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the parts of a message that stand for pictures of the game, in their order."""
    content = message.get("content")
    if not isinstance(content, list):
        return ()
    return [part for part in content if is_picture(part)]


def text_and_pictures(message: Mapping[str, Any]) -> tuple[str, Sequence[Mapping[str, Any]]]:
    """Return what `text_of` and `pictures_of` return."""
    content = message.get("content")
    if content is None or isinstance(content, str):
        return content or "", ()
    pictures = [part for part in content if is_picture(part)]
    return "".join([_text_of_part(part) for part in content if part not in pictures]), pictures


def calls_of(message: Mapping[str, Any]) -> Sequence[MessageToolCall]:
    """Return the tool calls of a message, in the order in which it lists them."""
    return message.get("tool_calls") or ()


def reasoning_of(message: Mapping[str, Any]) -> str:
    """Return the readable text of a message's reasoning, in whichever fields its provider keeps it."""
    text: str = message.get("reasoning_content") or ""
    items, content = message.get("provider_items", ()), message.get("content")
    if not items and not isinstance(content, list):
        return text
    from smartplay_tools.providers.reply_fields import readable, texts_in  # reads a table that most replies do not need

    if message.get("role") == "assistant" and isinstance(content, list):
        parts = [part for part in content if isinstance(part, Mapping)]
        text += "".join(texts_in([{**part, str(_field_with_text(part)): None} for part in parts]))
    if not items:
        return text
    functions = [call["function"] for call in calls_of(message)]
    own = [text_of(message), text, *(str(value) for function in functions for value in function.values())]
    return text + "".join(readable(items, "\n".join(own)))


def assistant_message(message: Mapping[str, Any]) -> Message:
    """Return a reply in canonical form, as a deep copy. A message that is not a reply raises `InvalidArgumentError`.

    Fields that chat completions do not define become a provider item, so that nothing of a reply is lost. Null and
    empty fields, which client libraries add, are dropped, but for empty thoughts beside calls: servers that say them
    want them back. Arguments become text, and the two halves of a character that a stream delivered separately are
    joined.
    """
    if not isinstance(message, Mapping):
        raise InvalidArgumentError(f"A reply is a message, a mapping, not {type(message).__name__}.")
    if message.get("role") != "assistant":
        raise InvalidArgumentError(f"A reply is a message with the role 'assistant', not {message.get('role')!r}.")
    canonical: Message = {"role": "assistant", "content": _content(message.get("content"))}
    if calls := message.get("tool_calls"):
        canonical["tool_calls"] = [_tool_call(call) for call in _listed(calls)]
    if message.get("name"):
        canonical["name"] = _name(message["name"])
    unknown = {key: value for key, value in message.items() if key not in _FIELDS and value not in _EMPTY}
    reasoning = message.get("reasoning_content")
    if reasoning or (reasoning == "" and calls):
        if isinstance(reasoning, str):
            canonical["reasoning_content"] = whole(reasoning)
        else:
            unknown["reasoning_content"] = reasoning
    if items := [*_listed(message.get("provider_items") or ()), *([unknown] if unknown else ())]:
        canonical["provider_items"] = _json_copy(items)
    return canonical


def host_message(message: Mapping[str, Any]) -> Message:
    """Return a message of a host (system, developer, user or tool) in canonical form, as a deep copy.

    Raises `InvalidArgumentError` for any other role, for a message without text and for fields that such a message
    does not have.
    """
    if not isinstance(message, Mapping):
        raise InvalidArgumentError(f"A message is a mapping, not {type(message).__name__}.")
    role, content = message.get("role"), message.get("content")
    if role not in ("system", "developer", "user", "tool"):
        raise InvalidArgumentError(f"A host's message has the role system, developer, user or tool, not {role!r}.")
    if content is None:
        raise InvalidArgumentError(f"A {role} message needs `content`, text or a list of text parts.")
    if unknown := sorted(key for key in message if key not in _HOST_FIELDS and message[key]):
        raise InvalidArgumentError(f"A {role} message has no field {', '.join(unknown)}.")
    canonical: Message = {"role": role, "content": _content(content)}
    if message.get("name"):
        canonical["name"] = _name(message["name"])
    if role == "tool":
        canonical["tool_call_id"] = str(message.get("tool_call_id") or "")
    return canonical


def head_messages(messages: Iterable[Mapping[str, Any]]) -> list[Message]:
    """Return the messages before the first reply in canonical form; they may contain examples of calls.

    Providers demand that every call has a unique id and its result right after it; `InvalidArgumentError` is raised
    where that does not hold.
    """
    canonical: list[Message] = []
    waiting: list[str] = []
    seen: set[str] = set()
    for message in messages:
        is_reply = isinstance(message, Mapping) and message.get("role") == "assistant"
        clean = assistant_message(message) if is_reply else host_message(message)
        if clean["role"] == "tool":
            if clean["tool_call_id"] not in waiting:
                raise InvalidArgumentError(f"No call with the id {clean['tool_call_id']!r} waits for this result.")
            waiting.remove(clean["tool_call_id"])
        elif waiting:
            break
        else:
            waiting = [call["id"] for call in calls_of(clean)]
            if "" in waiting or len({*waiting}) < len(waiting) or seen & {*waiting}:
                raise InvalidArgumentError("Every call in the head needs an id of its own.")
            seen.update(waiting)
        canonical.append(clean)
    if waiting:
        raise InvalidArgumentError(f"The calls {', '.join(waiting)} in the head need results right after them.")
    return canonical


@dataclass(slots=True)
class Call:
    """A tool call of a reply, parsed once."""

    id: str
    """The id in the conversation: the model's where it is usable, otherwise one that the conversation gave."""
    sent_id: str
    """The id that the model sent, empty where it sent none."""
    name: str
    arguments: Arguments


def read_calls(message: Message, ids: Sequence[str]) -> tuple[Call, ...]:
    """Return the calls of a canonical reply, with the ids that they have in the conversation.

    Those after as many as a provider takes back are malformed: a model that never sees them again must not play them.
    """
    pairs = zip(calls_of(message), ids, strict=True)
    calls = tuple([Call(i, c["id"], c["function"]["name"], read(c["function"]["arguments"])) for c, i in pairs])
    for call in calls[most("calls") :]:
        problem = Problem("too_many", {"most": str(most("calls"))})
        call.arguments = replace(call.arguments, values=None, problem=problem)
    return calls


def with_arguments(message: Message, arguments: Sequence[str]) -> Message:
    """Return a reply whose calls have these arguments; the message itself if they have them already."""
    calls = calls_of(message)
    if [call["function"]["arguments"] for call in calls] == [*arguments]:
        return message
    changed = message.copy()
    changed["tool_calls"] = [
        {**call, "function": {"name": call["function"]["name"], "arguments": text}}
        for call, text in zip(calls, arguments, strict=True)
    ]
    return changed


def whole(text: str) -> str:
    """Return the text with surrogate pairs joined: a stream may deliver one character in two halves."""
    return text if text.isascii() else well_formed(text, lone="surrogatepass")


def copy_of(message: Message) -> Message:
    """Return a copy that shares no mutable part with the message."""
    copy = message.copy()
    if copy["role"] == "tool" and isinstance(copy["content"], str):
        return copy  # as most messages of a prompt are
    if "tool_calls" in copy:
        copy["tool_calls"] = [{**call, "function": call["function"].copy()} for call in copy["tool_calls"]]
    if isinstance(copy["content"], list):
        # A result with a picture is flat.
        is_flat = copy["role"] == "tool" and any(map(is_picture, copy["content"]))
        copy["content"] = [part.copy() for part in copy["content"]] if is_flat else _json_copy(copy["content"])
    if "provider_items" in copy:
        copy["provider_items"] = _json_copy(copy["provider_items"])
    return copy


THOUGHT_PLACES = frozenset({"reasoning_content", "provider_items"})
"""The fields of a reply that can hold its thoughts."""

_FIELDS = frozenset(Message.__annotations__)
_EMPTY: tuple[Any, ...] = (None, "", [], {})
_HOST_FIELDS = frozenset({"role", "content", "name", "tool_call_id"})


def _tool_call(call: Any) -> MessageToolCall:
    function = call.get("function") or {} if isinstance(call, Mapping) else None
    if not isinstance(function, Mapping):
        raise InvalidArgumentError("Every entry of `tool_calls` is a mapping with a mapping `function`.")
    name, arguments = function.get("name") or "", as_text(function.get("arguments"))
    return {
        "id": whole(as_text(call.get("id") or "")),
        "type": "function",
        "function": {"name": whole(as_text(name)), "arguments": whole(arguments)},
    }


def _name(name: Any) -> str:
    if not isinstance(name, str):
        raise InvalidArgumentError(f"The `name` of a message is text, not {type(name).__name__}.")
    return whole(name)


def _content(content: Any) -> str | list[dict[str, Any]] | None:
    if content is None or isinstance(content, str):
        return content if content is None else whole(content)
    for part in _listed(content):
        _text_of_part(part)
    parts: list[dict[str, Any]] = _json_copy(list(content))
    return parts


def _listed(value: Any) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise InvalidArgumentError(f"Expected text or a list in a message, not {type(value).__name__}.")
    return value


def _json_copy(value: Any, depth: int = 0) -> Any:
    """Return a copy of JSON data that shares nothing with it."""
    if isinstance(value, str):
        return whole(value)
    if value is None or isinstance(value, bool | int | float):
        return value
    if depth > DEEPEST:
        raise InvalidArgumentError(f"A message nested deeper than {DEEPEST} cannot be recorded.")
    if isinstance(value, list | tuple):
        return [_json_copy(item, depth + 1) for item in value]
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise InvalidArgumentError(f"A message must be JSON to be recorded; the key {key!r} is not text.")
        return {whole(key): _json_copy(item, depth + 1) for key, item in value.items()}
    raise InvalidArgumentError(f"A message must be JSON to be recorded; {type(value).__name__} is not.")


def _field_with_text(part: Mapping[str, Any]) -> str | None:
    return next((field for field in ("text", "refusal") if isinstance(part.get(field), str)), None)


def _text_of_part(part: Any) -> str:
    if isinstance(part, str):
        return part
    if isinstance(part, Mapping) and (field := _field_with_text(part)) is not None:
        return str(part[field])
    kind = part.get("type") if isinstance(part, Mapping) else type(part).__name__
    raise InvalidArgumentError(f"Messages are text only here; a part of type {kind!r} cannot be counted.")
