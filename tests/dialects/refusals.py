"""What servers refuse or overlook in a request: functions of its turns, its body, and what was said with each call.

Each returns the status and the words of the refusal, or None. A row of `rules.toml` gives the words and the rest.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from tests.dialects.said import Json, Turn, parsed

Refusal = tuple[int, Any] | None
Turns = Sequence[Turn]
Given = Mapping[str, Any]
"""The message, the output items or the blocks that were said with a call, by the call's id."""


def said_with(turn: Turn, given: Given) -> Any:
    """What was said with the first call of a turn, if that still has its id."""
    return given.get(turn.calls[0][0]) if turn.calls else None


# --- Calls and results ---------------------------------------------------------------------------------------------


def arguments(
    turns: Turns, body: Json, given: Given, *, status: int, words: str, constants: bool = True, list_too: bool = False
) -> Refusal:
    """Arguments that are not JSON, or, with `list_too`, no object. Some parsers let NaN pass (`constants`)."""
    for call_id, _, said in (call for turn in turns for call in turn.calls):
        value = parsed(said, constants=constants)
        if value is ValueError or (list_too and not isinstance(value, dict)):
            return status, words.format(id=call_id)
    return None


def results(turns: Turns, body: Json, given: Given, *, status: int, missing: str, orphaned: str) -> Refusal:
    """Calls without results right after them, and results without a call right before them."""
    waiting: list[str] = []
    for turn in [*turns, Turn("end")]:
        for call_id in turn.results:
            if call_id not in waiting:
                return status, orphaned.format(id=call_id)
            waiting.remove(call_id)
        if waiting and not turn.results:
            return status, missing.format(id=", ".join(waiting))
        if turn.calls:
            waiting = [call_id for call_id, _, _ in turn.calls]
    return None


def results_together(turns: Turns, body: Json, given: Given, *, missing: str, orphaned: str) -> Refusal:
    """The same where all results of a turn are in the next message, before its words."""
    for before, turn in zip([Turn("begin"), *turns], [*turns, Turn("end")], strict=True):
        called = [call_id for call_id, _, _ in before.calls]
        if unknown := [call_id for call_id in turn.results if call_id not in called]:
            return 400, orphaned.format(id=unknown[0])
        kinds = [block["type"] == "tool_result" for block in turn.raw or ()]
        if set(turn.results) != set(called) or (any(kinds) and kinds != sorted(kinds, reverse=True)):
            return 400, missing.format(id=", ".join(called))
    return None


def name_or_id(turns: Turns, body: Json, given: Given, *, place: int, shape: str, words: str) -> Refusal:
    """Ids (place 0) or names (place 1) of calls of another shape."""
    said = [call[place] or "" for turn in turns for call in turn.calls]
    wrong = [text for text in said if not re.fullmatch(shape, text)]
    return (400, words.replace("{it}", wrong[0])) if wrong else None


def repeated_ids(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    ids = [call_id for turn in turns for call_id, _, _ in turn.calls]
    return (400, words) if len(ids) > len(set(ids)) else None


# --- Content, roles and fields -------------------------------------------------------------------------------------


def empty(turns: Turns, body: Json, given: Given, *, status: int, words: str) -> Refusal:
    """A reply in the history without words and calls; an empty text is none."""
    silent = [turn for turn in turns if turn.role == "assistant" and not turn.words and not turn.calls]
    return (status, words) if silent else None


def null(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    """A message without calls whose content is null; an empty text is one."""
    missing = [turn for turn in turns if turn.raw.get("content") is None and not turn.calls]
    return (400, words) if missing else None


def no_user(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    return None if any(turn.role == "user" for turn in turns) else (400, words)


def blank_text(turns: Turns, body: Json, given: Given) -> Refusal:
    texts = [block["text"] for turn in turns for block in turn.raw if block["type"] == "text"]
    if "" in texts or any(not turn.raw for turn in turns):
        return 400, "messages: text content blocks must be non-empty"
    blank = [text for text in texts if not text.strip()]
    return (400, "messages: text content blocks must contain non-whitespace text") if blank else None


def instructions(turns: Turns, body: Json, given: Given, *, most: int, status: int, words: str) -> Refusal:
    """System messages that are not at the beginning, or more of them than a template has a place for."""
    places = [at for at, turn in enumerate(turns) if turn.role in ("system", "developer")]
    return (status, words) if places != [*range(len(places))] or len(places) > most else None


def parameter(turns: Turns, body: Json, given: Given, *, name: str, status: int, words: str) -> Refusal:
    return (status, words) if body.get(name) else None


def unknown_parameter(turns: Turns, body: Json, given: Given, *, known: str, words: str) -> Refusal:
    unknown = sorted(set(body) - set(known.split()))
    return (400, words.format(name=unknown[0])) if unknown else None


def unsupported(turns: Turns, body: Json, given: Given, *, names: Sequence[str], words: str) -> Refusal:
    """Fields of messages that a schema does not have."""
    for at, turn in enumerate(turns):
        if found := [name for name in names if name in turn.raw]:
            return 400, words.format(at=at, name=found[0])
    return None


def at_least(turns: Turns, body: Json, given: Given, *, name: str, least: int, words: str) -> Refusal:
    return (400, words) if body.get(name, least) < least else None


def forbidden_fields(turns: Turns, body: Json, given: Given, *, known: str, messages: Json) -> Refusal:
    """Whatever a schema does not name, in the body, in `stream_options` and in the messages of each role."""
    places = [["body", name] for name in sorted(set(body) - set(known.split()))]
    places += [["body", "stream_options", name] for name in body.get("stream_options") or ()]
    for at, turn in enumerate(turns):
        unknown = sorted(set(turn.raw) - set(messages[turn.role].split()))
        places += [["body", "messages", at, turn.role, name] for name in unknown]
    detail = [{"type": "extra_forbidden", "loc": place, "msg": "Extra inputs are not permitted"} for place in places]
    return (422, {"detail": detail}) if detail else None


# --- Thoughts ------------------------------------------------------------------------------------------------------


def thoughts_back(turns: Turns, body: Json, given: Given, *, name: str, status: int, words: str) -> Refusal:
    """Thoughts that do not come back with their calls as they were said: missing, renamed, cut or changed."""
    for at, turn in enumerate(turns):
        said = said_with(turn, given) or {}
        if said.get(name) and turn.raw.get(name) != said[name]:
            return status, words.format(at=at, id=turn.calls[0][0])
    return None


def thoughts_there(turns: Turns, body: Json, given: Given, *, name: str, status: int, words: str) -> Refusal:
    """The same, and an empty thought has to come back, too."""
    for at, turn in enumerate(turns):
        if name in (said_with(turn, given) or {}) and name not in turn.raw:
            return status, words.format(at=at)
    return thoughts_back(turns, body, given, name=name, status=status, words=words)


def signatures_back(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    """Signatures that do not come back with their calls."""
    for at, turn in enumerate(turns):
        said = (said_with(turn, given) or {}).get("tool_calls", ())
        if [call.get("extra_content") for call in said] != [
            call.get("extra_content") for call in turn.raw.get("tool_calls", ())[: len(said)]
        ]:
            return 400, words.format(name=turn.calls[0][1], at=at)
    return None


def parts_back(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    """Thoughts that were parts of the content and are not any more."""
    for turn in turns:
        said = (said_with(turn, given) or {}).get("content")
        if isinstance(said, list) and _thinking(said) != _thinking(turn.raw.get("content")):
            return 200, words.format(id=turn.calls[0][0])
    return None


def _thinking(content: Any) -> list[Any]:
    return [part for part in content if part["type"] == "thinking"] if isinstance(content, list) else []


def blocks_back(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    """Thinking that is not at the beginning of its message, or changed."""
    for at, turn in enumerate(turns):
        thoughts = _thinking(said_with(turn, given))
        if thoughts and turn.raw[: len(thoughts)] != thoughts:
            return 400, words.format(at=at)
    return None


def ends_with_thinking(turns: Turns, body: Json, given: Given, *, words: str) -> Refusal:
    last = [at for at, turn in enumerate(turns) if turn.role == "assistant" and turn.raw[-1]["type"] == "thinking"]
    return (400, words.format(at=last[0])) if last else None


def reasoning_items(turns: Turns, body: Json, given: Given, *, missing: str, last: str) -> Refusal:
    """A reasoning item needs what followed it, and what followed it needs the item."""
    for turn in turns:
        if turn.raw[-1].get("type") == "reasoning":
            return 400, last.format(id=turn.raw[-1]["id"])
        said = [item for item in said_with(turn, given) or () if item["type"] == "reasoning"]
        if said and said != [item for item in turn.raw if item.get("type") == "reasoning"]:
            return 400, missing.format(id=turn.calls[0][0], reasoning=said[0]["id"])
    return None
