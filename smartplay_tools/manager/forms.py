"""Forms: the three forms in which agents keep messages, and what a message of each form is.

Chat completions, items of OpenAI's Responses and Anthropic's messages say the same things in other fields. A form says
which messages are replies, results or words, which calls they make and answer, what of them counts, and how a copy
looks that shows less. It never changes a message that it is given, and a copy keeps every field that it need not
change, so that signatures, ids and marks for a cache need no list here.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from smartplay_tools.errors import InvalidArgumentError, check_choice
from smartplay_tools.providers.reply_fields import BESIDE_WORDS, NOT_SENT, THOUGHTS
from smartplay_tools.types.arguments import as_text, object_in

__all__ = ["FORMS", "Content", "Given", "MessageForm", "Said", "form_of"]

Given = Mapping[str, Any]
"""A message, or an item of a conversation, as plain data."""

Kind = Literal["reply", "result", "word"]
"""What the model wrote; what answers its calls; anything else."""

Calls = Sequence[tuple[str, str]]
"""Names and arguments of calls, as they are sent."""

PICTURES = {"computer_screenshot", "image", "image_url", "input_image"}
"""Types of parts that hold a picture."""

CLOSED = {"audio", "container_upload", "document", "file", "input_audio", "input_file", "media", "video", "video_url"}
"""Types of parts whose tokens only their provider can count."""


@dataclass(frozen=True, slots=True)
class Content:
    """The content of a message or of a result, by what can be done with its parts."""

    text: str = ""
    """The texts of its parts, joined."""
    pictures: tuple[Given, ...] = ()
    closed: tuple[Given, ...] = ()
    """Parts that cannot be counted here."""
    others: tuple[Given, ...] = ()
    """Parts of any other type, of which the readable text counts."""

    @classmethod
    def of(cls, content: Any) -> Content:
        """Return the content that a field holds: text, a list of parts, one part, or nothing."""
        if content is None or isinstance(content, str):
            return cls(content or "")
        texts: list[str] = []
        pictures: list[Given] = []
        closed: list[Given] = []
        others: list[Given] = []
        for part in content if isinstance(content, list | tuple) else [content]:
            if (text := _text(part)) is not None:
                texts.append(text)
            elif not isinstance(part, Mapping):
                raise InvalidArgumentError(
                    f"has content of the type {type(part).__name__}, which is no text and no part"
                )
            else:
                (pictures if _type(part) in PICTURES else closed if _is_closed(part) else others).append(part)
        return cls("".join(texts), tuple(pictures), tuple(closed), tuple(others))


@dataclass(frozen=True, slots=True)
class Said:
    """A part of a message that counts as one chat message."""

    role: str
    content: Content
    name: str = ""
    calls: Calls = ()
    others: Sequence[Given] = ()
    """Data of which the readable text counts: thoughts, and fields that this library does not know."""
    opens: bool = True
    """Whether a message begins here; False for an item that goes on with the reply before it."""


class MessageForm:
    """Messages of OpenAI's chat completions, which most servers and frameworks have; the other forms differ from it."""

    name: ClassVar[str] = "chat"
    _KINDS: ClassVar[Mapping[Any, Kind]] = {
        "assistant": "reply", "tool": "result", "system": "word", "developer": "word", "user": "word"
    }  # fmt: skip

    def kind(self, message: Given) -> Kind:
        """Return what a message is; one that the form does not have raises an `InvalidArgumentError`."""
        role, calls = message.get("role"), message.get("tool_calls") or []
        kind = self._KINDS.get(role) if isinstance(role, str) else None
        if kind is None:
            raise InvalidArgumentError(f"has the role {role!r}, which is none of {', '.join(self._KINDS)}")
        if not (isinstance(calls, list | tuple) and all(map(_is_call, calls))):
            raise InvalidArgumentError("has tool_calls that are no list of calls")
        return kind

    def continues(self, before: Given, message: Given) -> bool:
        """Whether two messages of a model, one after the other, are parts of one reply."""
        return False

    def calls(self, message: Given) -> Sequence[str]:
        """Return the ids of the calls in a message of the model."""
        return [str(call.get("id") or "") for call in message.get("tool_calls") or ()]

    def answers(self, message: Given) -> Sequence[str]:
        """Return the ids of the calls that a message with results answers."""
        return [str(message.get("tool_call_id") or "")]

    def results(self, message: Given) -> Sequence[Any]:
        """Return the contents of these results, as the message holds them."""
        return [message.get("content") or ""]

    def with_results(self, message: Given, contents: Sequence[Any], *, with_words: bool = True) -> Given | None:
        """Return a copy with other contents, None for a result that goes; None if nothing is left of it.

        `with_words` is False for a copy that has none of the words beside the results.
        """
        return None if contents[0] is None else {**message, "content": contents[0]}

    def cut(self, message: Given, texts: Sequence[str | None]) -> Given:
        """Return a copy with other texts of its results, None for one that stays."""
        pairs = zip(self.results(message), texts, strict=True)
        cut = self.with_results(message, [each if text is None else with_text(each, text) for each, text in pairs])
        assert cut is not None
        return cut

    def made(self, ids: Sequence[str], text: str) -> Sequence[Given]:
        """Return messages that answer calls with a text."""
        return [{"role": "tool", "tool_call_id": i, "content": text} for i in ids]

    def written(self, role: str, text: str, calls: Sequence[tuple[str, str, str]]) -> Sequence[Given]:
        """Return new words of a role, or a new reply with calls: their ids, names and arguments."""
        message: dict[str, Any] = {"role": role, "content": text}
        if calls:
            message["tool_calls"] = [
                {"id": call_id, "type": "function", "function": {"name": name, "arguments": arguments}}
                for call_id, name, arguments in calls
            ]
        return [message]

    def joined(self, messages: Sequence[Given]) -> Sequence[Given]:
        """Return messages with the results of one reply as the provider wants them, in one message or in several."""
        return messages

    def trimmed(self, message: Given) -> Given | None:
        """Return a message of the model with its calls alone; None if it has none."""
        if not message.get("tool_calls"):
            return None
        return {"role": message["role"], "content": None, "tool_calls": message["tool_calls"]}

    def thinks(self, message: Given) -> bool:
        """Return whether a message of the model has thoughts."""
        content = message.get("content")
        is_part = isinstance(content, list | tuple) and any(_type(part) in THOUGHTS for part in content)
        return is_part or any(message.get(name) for name in BESIDE_WORDS)

    def edited(self, message: Given, arguments: Mapping[str, str], *, thoughts: bool) -> Given | None:
        """Return a message of a reply with other arguments, by the ids of calls, and maybe without thoughts.

        None if nothing else is in it.
        """

        def call(given: Given) -> Given:
            kind, field = ("custom", "input") if "custom" in given else ("function", "arguments")
            return {**given, kind: {**given[kind], field: arguments[str(given.get("id") or "")]}}

        made = {name: value for name, value in message.items() if thoughts or name not in BESIDE_WORDS}
        if not thoughts and not isinstance(content := message.get("content"), str):
            made["content"] = _without_thoughts(content or ())
        if calls := message.get("tool_calls"):
            made["tool_calls"] = [*map(call, calls)]
        return made if made.get("content") or calls else None

    def said(self, message: Given, *, opens: bool = True) -> Iterator[Said]:
        """Yield what of a message counts; `opens` is False for one that continues a reply."""
        calls, more = [], []
        for call in message.get("tool_calls") or ():
            function = call.get("function") or call.get("custom") or {}
            text = as_text(function.get("arguments", function.get("input")))
            calls.append((str(function.get("name") or ""), text))
            more.append({name: value for name, value in call.items() if name not in _OF_A_CALL})
        own = {name: value for name, value in message.items() if name not in _OF_A_MESSAGE and name not in NOT_SENT}
        content, name = Content.of(message.get("content")), str(message.get("name") or "")
        yield Said(message["role"], content, name, calls, [own, *more])


class Responses(MessageForm):
    """Items of OpenAI's Responses: a reply is several items, and its calls are items of their own."""

    name: ClassVar[str] = "responses"

    def kind(self, message: Given) -> Kind:
        kind = message.get("type", "message")
        if kind == "message":
            role = message.get("role")
            if role in ("assistant", "system", "developer", "user"):
                return "reply" if role == "assistant" else "word"
            raise InvalidArgumentError(f"has the role {role!r}, which is none of assistant, system, developer, user")
        if kind == "item_reference":
            raise InvalidArgumentError("is a reference to an item that a server keeps; send the item itself")
        return "result" if self._answered(message) else "reply"

    @staticmethod
    def _answered(message: Given) -> Any:
        """The call that an item answers, None if it is no answer."""
        kind = str(message.get("type"))
        if kind == "mcp_approval_response":
            return message.get("approval_request_id")
        return message.get("call_id") if kind.endswith("_output") else None

    def continues(self, before: Given, message: Given) -> bool:
        return True

    def calls(self, message: Given) -> Sequence[str]:
        kind = message.get("type")
        call = message.get("id") if kind == "mcp_approval_request" else message.get("call_id")
        return [str(call)] if call and str(kind).endswith(("_call", "_request")) else []

    def answers(self, message: Given) -> Sequence[str]:
        return [str(self._answered(message))]

    def results(self, message: Given) -> Sequence[Any]:
        return [message.get("output") or ""]

    def with_results(self, message: Given, contents: Sequence[Any], *, with_words: bool = True) -> Given | None:
        if contents[0] is None:
            return None
        return {**message, "output": contents[0]} if "output" in message else message

    def made(self, ids: Sequence[str], text: str) -> Sequence[Given]:
        return [{"type": "function_call_output", "call_id": i, "output": text} for i in ids]

    def written(self, role: str, text: str, calls: Sequence[tuple[str, str, str]]) -> Sequence[Given]:
        items: list[Given] = [{"type": "message", "role": role, "content": text}] if text or not calls else []
        for call_id, name, arguments in calls:
            items.append({"type": "function_call", "call_id": call_id, "name": name, "arguments": arguments})
        return items

    def trimmed(self, message: Given) -> Given | None:
        return self._by_itself(message) if self.calls(message) else None

    @staticmethod
    def _by_itself(message: Given) -> Given:
        """Return an item without its id, with which it would be refused where its thoughts are not."""
        if message.get("type", "message") not in ("message", "function_call", "custom_tool_call"):
            return message  # of the provider's tools the id is required
        return {name: value for name, value in message.items() if name != "id"}

    def thinks(self, message: Given) -> bool:
        return _type(message) in THOUGHTS

    def edited(self, message: Given, arguments: Mapping[str, str], *, thoughts: bool) -> Given | None:
        if not thoughts and self.thinks(message):
            return None
        made = {**(message if thoughts else self._by_itself(message))}
        field = "input" if "input" in message else "arguments"
        for call_id in self.calls(message) if field in message else ():
            made[field] = arguments[call_id]
        return made

    def said(self, message: Given, *, opens: bool = True) -> Iterator[Said]:
        kind = message.get("type", "message")
        if kind == "message":
            yield Said(message["role"], Content.of(message.get("content")))
        elif self._answered(message):
            yield Said("tool", Content.of(message.get("output")))
        elif kind in ("function_call", "custom_tool_call"):
            call = str(message.get("name") or ""), as_text(message.get("arguments", message.get("input")))
            yield Said("assistant", Content(), calls=[call], opens=opens)
        else:
            yield Said("assistant", Content(), others=[message], opens=opens)


class Anthropic(MessageForm):
    """Messages of Anthropic: results are blocks of the user's next message, all of a reply's results in one."""

    name: ClassVar[str] = "anthropic"

    def kind(self, message: Given) -> Kind:
        role = message.get("role")
        if role not in ("assistant", "user", "system"):
            raise InvalidArgumentError(f"has the role {role!r}, which is none of assistant, user")
        return "reply" if role == "assistant" else "result" if self._blocks(message, "tool_result") else "word"

    @staticmethod
    def _blocks(message: Given, *kinds: str) -> list[Given]:
        content = message.get("content")
        if not isinstance(content, list | tuple):
            return []
        return [block for block in content if isinstance(block, Mapping) and block.get("type") in kinds]

    def calls(self, message: Given) -> Sequence[str]:
        return [str(block.get("id") or "") for block in self._blocks(message, "tool_use")]

    def answers(self, message: Given) -> Sequence[str]:
        return [str(block.get("tool_use_id") or "") for block in self._blocks(message, "tool_result")]

    def results(self, message: Given) -> Sequence[Any]:
        return [block.get("content") or "" for block in self._blocks(message, "tool_result")]

    def with_results(self, message: Given, contents: Sequence[Any], *, with_words: bool = True) -> Given | None:
        left, blocks = iter(contents), []
        for block in message["content"]:
            if _type(block) != "tool_result":
                blocks += [block] if with_words else []
            elif (content := next(left)) is not None:
                blocks.append(block if content is block.get("content") else {**block, "content": content})
        return {**message, "content": blocks} if blocks else None

    def made(self, ids: Sequence[str], text: str) -> Sequence[Given]:
        blocks = [{"type": "tool_result", "tool_use_id": i, "content": text} for i in ids]
        return [{"role": "user", "content": blocks}] if blocks else []

    def written(self, role: str, text: str, calls: Sequence[tuple[str, str, str]]) -> Sequence[Given]:
        if not calls:
            return [{"role": "assistant" if role == "assistant" else "user", "content": text}]
        blocks: list[Given] = [{"type": "text", "text": text}] if text else []
        for call_id, name, arguments in calls:
            given = object_in(arguments) or {}
            blocks.append({"type": "tool_use", "id": call_id, "name": name, "input": given})
        return [{"role": "assistant", "content": blocks}]

    def joined(self, messages: Sequence[Given]) -> Sequence[Given]:
        if len(messages) < 2:
            return messages
        blocks = [block for message in messages for block in message["content"]]
        blocks.sort(key=lambda block: _type(block) != "tool_result")  # results come first
        return [{**messages[0], "content": blocks}]

    def trimmed(self, message: Given) -> Given | None:
        if not self.calls(message):
            return None
        words = ("text", "thinking", "redacted_thinking")
        return {**message, "content": [block for block in message["content"] if _type(block) not in words]}

    def edited(self, message: Given, arguments: Mapping[str, str], *, thoughts: bool) -> Given | None:
        if not isinstance(content := message["content"], list | tuple):
            return message
        uses = self._blocks(message, "tool_use")
        given = {id(use): object_in(arguments[str(use.get("id") or "")]) or {} for use in uses}
        made = [{**block, "input": given[id(block)]} if id(block) in given else block for block in content]
        return {**message, "content": left} if (left := made if thoughts else _without_thoughts(made)) else None

    def said(self, message: Given, *, opens: bool = True) -> Iterator[Said]:
        content = message.get("content")
        if not isinstance(content, list | tuple):
            yield Said(message["role"], Content.of(content))
            return
        results = self._blocks(message, "tool_result")
        yield from (Said("tool", Content.of(block.get("content"))) for block in results)
        rest = [block for block in content if _type(block) != "tool_result"]
        uses = self._blocks(message, "tool_use")
        calls = [(str(each.get("name") or ""), json.dumps(each.get("input"), ensure_ascii=False)) for each in uses]
        if rest or not results:
            yield Said(message["role"], Content.of(rest), calls=calls)


FORMS: Mapping[str, MessageForm] = {form.name: form for form in (MessageForm(), Responses(), Anthropic())}
"""The forms by name."""

_OF_A_MESSAGE = {"role", "content", "name", "tool_calls", "tool_call_id"}
_OF_A_CALL = {"id", "type", "index", "function", "custom"}
_BLOCKS = {"tool_use", "tool_result", "thinking", "redacted_thinking", "server_tool_use", "document"}


def form_of(messages: Sequence[Given], name: str | None = None) -> MessageForm:
    """Return the form of a name, or that of messages, by the first that only one form has.

    Words alone are the same in all forms.
    """
    if name is not None:
        check_choice("form", name, FORMS)
        return FORMS[name]
    for message in messages:
        if message.get("role") == "tool" or message.get("tool_calls"):
            return FORMS["chat"]
        if "type" in message:
            return FORMS["responses"]
        content = message.get("content")
        if isinstance(content, list | tuple):
            for part in content:
                kind = _type(part)
                if kind in _BLOCKS or (kind == "image" and "source" in part):
                    return FORMS["anthropic"]
                if kind in ("input_text", "output_text", "input_image", "input_file"):
                    return FORMS["responses"]
    return FORMS["chat"]


def with_text(content: Any, text: str) -> Any:
    """Return the content of a result with another text: its first text part has it, and its other texts go."""
    if content is None or isinstance(content, str):
        return text
    parts: list[Any] = []
    is_told = False
    for part in content if isinstance(content, list | tuple) else [content]:
        if _text(part) is None:
            parts.append(part)
        elif not is_told:
            is_told = True
            parts.append(text if isinstance(part, str) else {**part, "text": text})
    return parts


def without_pictures(content: Any, text: str) -> Any:
    """Return the content of a result in which a text stands for each picture."""
    if not isinstance(content, list | tuple):
        return content
    kind = "input_text" if any(_type(part).startswith("input_") for part in content) else "text"
    return [{"type": kind, "text": text} if _type(part) in PICTURES else part for part in content]


def _text(part: Any) -> str | None:
    """The text of a part; None if it is something else."""
    if isinstance(part, str):
        return part
    if isinstance(part, Mapping) and part.get("type", "text") in ("text", "input_text", "output_text", "refusal"):
        return next((part[name] for name in ("text", "refusal") if isinstance(part.get(name), str)), None)
    return None


def _without_thoughts(content: Sequence[Any]) -> list[Any]:
    return [part for part in content if _type(part) not in THOUGHTS]


def _is_call(call: Any) -> bool:
    """Whether a call of chat completions has the parts that are read."""
    if not isinstance(call, Mapping):
        return False
    return isinstance(call.get("function") or call.get("custom") or {}, Mapping)


def _type(part: Any) -> str:
    return str(part.get("type")) if isinstance(part, Mapping) else ""


def _is_closed(part: Given) -> bool:
    """Whether only its provider can count a part; a document of plain text is readable."""
    source = part.get("source")
    return _type(part) in CLOSED and not (isinstance(source, Mapping) and source.get("type") in ("text", "content"))
