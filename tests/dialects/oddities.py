"""How servers say things in their own way: functions that change an answer, and functions of a stream's chunks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from tests.dialects.said import Json, Said, is_object, parsed
from tests.dialects.speech import CACHED

# --- Answers -------------------------------------------------------------------------------------------------------


def _message(answer: Json) -> Json:
    message: Json = answer["choices"][0]["message"]
    return message


def thoughts_as(answer: Json, said: Said, number: int, *, name: str, empty: bool = False) -> None:
    """Thoughts as text under a name; with `empty`, it is there if there are none, too."""
    if said.thoughts or empty:
        _message(answer)[name] = said.thoughts


def thoughts_in(answer: Json, said: Said, number: int, *, name: str, text: str, part: Json) -> None:
    """Thoughts as a list of one part, which has its text under a name, and a signature where `part` has one."""
    if said.thoughts:
        signed = {"signature": f"sig{number}" * 20} if "signature" in part else {}
        _message(answer)[name] = [{**part, text: said.thoughts, **signed}]


def thoughts_in_content(answer: Json, said: Said, number: int) -> None:
    if said.thoughts:
        words = [{"type": "text", "text": said.words}] if said.words else []
        thinking = {"type": "thinking", "thinking": [{"type": "text", "text": said.thoughts}]}
        _message(answer)["content"] = [thinking, *words]


def signature(answer: Json, said: Said, number: int) -> None:
    """The signature of the thoughts is in the first call."""
    for call in _message(answer).get("tool_calls", ())[:1]:
        call["extra_content"] = {"google": {"thought_signature": f"sig{number}" * 20}}


def cached_as(answer: Json, said: Said, number: int, *, name: str) -> None:
    del answer["usage"]["prompt_tokens_details"]
    answer["usage"][name] = CACHED


def objects(answer: Json, said: Said, number: int) -> None:
    """Arguments that are an object are one, broken ones are text."""
    for call in _message(answer).get("tool_calls", ()):
        if is_object(call["function"]["arguments"]):
            call["function"]["arguments"] = parsed(call["function"]["arguments"], constants=False)


def finish_reasons(answer: Json, said: Said, number: int, *, names: Json) -> None:
    (choice,) = answer["choices"]
    choice["finish_reason"] = names.get(choice["finish_reason"], choice["finish_reason"])


# --- Streams. The last three chunks are the one that finishes, the usage and [DONE]. ----------------------------------


def _calls(chunks: Iterable[Any]) -> list[Json]:
    """The pieces of calls in a stream."""
    of_choices = [choice["delta"] for chunk in chunks if isinstance(chunk, dict) for choice in chunk["choices"]]
    return [call for delta in of_choices for call in delta.get("tool_calls") or ()]


def names_repeated(chunks: Sequence[Any]) -> Sequence[Any]:
    name = ""
    for call in _calls(chunks):
        name = call["function"].setdefault("name", name)
    return chunks


def index_from(chunks: Sequence[Any], *, first: int | None = None) -> Sequence[Any]:
    """Indices of calls from another number on, or none."""
    for call in _calls(chunks):
        index = call.pop("index")
        if first is not None:
            call["index"] = index + first
    return chunks


def whole_calls(chunks: Sequence[Any]) -> Sequence[Any]:
    """Each call in one piece."""
    kept, function = [], dict[str, Any]()
    for chunk in chunks:
        calls = _calls([chunk])
        if calls and "id" not in calls[0]:
            more = calls[0]["function"]["arguments"]
            function["arguments"] = function["arguments"] + more if isinstance(more, str) else more
            continue
        function = calls[0]["function"] if calls else function
        kept.append(chunk)
    return kept


def nulls(chunks: Sequence[Any]) -> Sequence[Any]:
    """What a piece does not have is null in it."""
    for chunk in chunks[:-2]:
        delta = chunk["choices"][0]["delta"]
        for name in ("role", "content", "reasoning_content", "tool_calls"):
            delta.setdefault(name, None)
    for call in _calls(chunks):
        call["function"].setdefault("name", None)
        call.setdefault("id", None)
    return chunks


def finished_as(chunks: Sequence[Any], *, names: Json) -> Sequence[Any]:
    """Another finish reason in streams."""
    (choice,) = chunks[-3]["choices"]
    choice["finish_reason"] = names.get(choice["finish_reason"], choice["finish_reason"])
    return chunks


def unfinished(chunks: Sequence[Any]) -> Sequence[Any]:
    """No finish reason after calls that are whole."""
    (choice,) = chunks[-3]["choices"]
    texts = [call["function"].get("arguments", "") for call in _calls(chunks)]
    if choice["finish_reason"] == "tool_calls" and is_object("".join(texts)):
        choice["finish_reason"] = None
    return chunks


def finished_twice(chunks: Sequence[Any]) -> Sequence[Any]:
    return [*chunks[:-2], chunks[-3], *chunks[-2:]]


def usage_in_choice(chunks: Sequence[Any]) -> Sequence[Any]:
    """The choice that finishes has the usage, and no chunk follows."""
    chunks[-3]["choices"][0]["usage"] = chunks[-2]["usage"]
    return [*chunks[:-2], chunks[-1]]


def usage_in_last(chunks: Sequence[Any]) -> Sequence[Any]:
    """The chunk that finishes has the usage, and no other follows."""
    return [*chunks[:-3], {**chunks[-3], "usage": chunks[-2]["usage"]}, chunks[-1]]


def with_comments(chunks: Sequence[Any], *, comment: str) -> Sequence[Any]:
    return [comment, *chunks[:2], comment, *chunks[2:]]


def filters(chunks: Sequence[Any]) -> Sequence[Any]:
    """A chunk without choices first, and one whose choice has no delta before the last."""
    empty = {"id": "", "object": "", "created": 0, "model": ""}
    choice = {"index": 0, "finish_reason": None, "content_filter_results": {"hate": {"filtered": False}}}
    first = {**empty, "choices": [], "prompt_filter_results": [{"prompt_index": 0}]}
    return [first, *chunks[:-3], {**empty, "choices": [choice]}, *chunks[-3:]]


def signature_alone(chunks: Sequence[Any]) -> Sequence[Any]:
    """The signature of a call in a piece that has nothing else."""
    apart = list[Any]()
    for chunk in chunks:
        apart.append(chunk)
        for call in _calls([chunk]):
            if "extra_content" in call:
                own = {"index": call["index"], "id": call["id"], "function": {}}
                delta = {"tool_calls": [{**own, "extra_content": call.pop("extra_content")}]}
                apart.append({**chunk, "choices": [{**chunk["choices"][0], "delta": delta}]})
    return apart


def empty_last(events: Sequence[Any]) -> Sequence[Any]:
    """The last event has no output."""
    return [*events[:-1], {**events[-1], "response": {**events[-1]["response"], "output": []}}]
