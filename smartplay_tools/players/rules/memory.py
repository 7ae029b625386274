"""Memory: what a rule player keeps beyond its window, as one line of text that it finds again in its prompt.

The line is part of the player's own words, in the notes that it takes with a tool, or in the summary that it was asked
for; which of these a budget offers decides where it is written, and reading is the same for all of them. A memory is
complete up to the message that holds it, so what was seen after that message is all that is new.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from typing import Any

from smartplay_tools.players.prompt_reading import Reading, call, is_carried, is_error
from smartplay_tools.types import MEMORY_TOOL, NOTES_TOOL, RECALL_TOOL
from smartplay_tools.types.arguments import object_in, read
from smartplay_tools.types.messages import Message, calls_of, text_of

LINE = re.compile(r"^Notes: (\{.*\})$", re.MULTILINE)
CAP = re.compile(r"at most (\d+) tokens", re.IGNORECASE)
RECALLED = re.compile(r"^Step (\d+), after (?:act|observe)\(.*\):$", re.MULTILINE)
FILE = "/memories/notes.txt"
"""The file of the memory, where the player keeps files."""
PATH_TOKENS = 10
"""At least as many tokens as the path has."""
CONTENT = f"Here's the content of {FILE} "
NUMBERED = re.compile(r"^ *\d+\t", re.MULTILINE)
IDS = {NOTES_TOOL: "notes"}
"""How the ids of calls begin, where that is not the name of the tool."""
CHARACTERS_A_TOKEN = 2
"""A safe guess, fewer than in any line here: the player does not know the tokenizer, and long notes are refused."""


@dataclass(frozen=True)
class Memory:
    """The newest memory in a prompt."""

    facts: dict[str, Any] | None
    """What was kept; None if no memory is visible. `clock` says how much of the play it covers."""
    since: Reading
    """What was seen after it was written; everything, if there is none."""


def recall(reading: Reading) -> Memory:
    """Return the memory in a prompt that covers most, and what was seen since."""
    messages = reading.prompt.shared
    newest: tuple[int, int, dict[str, Any]] | None = None
    for at, message in enumerate(messages):
        for text in _texts(message):
            if (facts := _facts(text)) is not None and (newest is None or facts["clock"] >= newest[0]):
                newest = facts["clock"], at, facts
    if newest is None:
        return Memory(None, reading)
    _, at, facts = newest
    return Memory(facts, Reading(replace(reading.prompt, shared=messages[at:])))


@dataclass(frozen=True)
class Earlier:
    """What a prompt says of the game that was played before this one, in another world."""

    facts: dict[str, Any]
    """What was kept there."""
    text: str
    """The whole message, which has the last result."""


def earlier(reading: Reading) -> Earlier | None:
    """Return what was carried over from the game before; None if nothing was, or nothing was kept there."""
    text = next((text_of(message) for message in reading.prompt.shared if is_carried(message)), None)
    facts = None if text is None else _facts(text)
    return None if text is None or facts is None else Earlier(facts, text)


def line(facts: dict[str, Any]) -> str:
    """Return facts as the line that `recall` finds; `clock` is one of them."""
    return f"Notes: {json.dumps(facts, separators=(',', ':'))}"


def newest_quoted(reading: Reading) -> str | None:
    """Return the memory that covers most among those quoted in the messages, in whatever form; None without any."""
    memories: list[dict[str, Any]] = []
    for message in reading.prompt.shared:
        for place in re.finditer("Notes: ", text_of(message)):
            try:
                facts, _ = json.JSONDecoder().raw_decode(text_of(message), place.end())
            except ValueError:
                continue
            if isinstance(facts, dict) and isinstance(facts.get("clock"), int):
                memories.append(facts)
    return line(max(memories, key=lambda facts: facts["clock"])) if memories else None


def notes_cap(reading: Reading) -> int | None:
    """Return how many tokens notes may have, None where there is no tool to take them."""
    return _cap_in(next((str(tool.parameters) for tool in reading.prompt.tools if tool.name == NOTES_TOOL), ""))


def summary_cap(reading: Reading) -> int | None:
    """Return how many tokens the summary may have that the prompt asks for, None where it asks for none."""
    prompt = reading.prompt
    return _cap_in(text_of(prompt.shared[-1])) if prompt.purpose != "play" and prompt.shared else None


def _cap_in(text: str) -> int | None:
    match = CAP.search(text)
    return int(match[1]) if match else None


def fits(text: str, cap: int) -> bool:
    """Whether a text certainly has no more tokens than a cap."""
    return len(text) <= CHARACTERS_A_TOKEN * cap


def noted(message: Message, text: str) -> Message:
    """Return a reply that also takes notes, before anything else that it does."""
    return _with_call(message, NOTES_TOOL, text=text)


def file_cap(reading: Reading) -> int | None:
    """Return how many tokens the memory's file may have, its path not counted; None without a tool for files."""
    cap = _cap_in(next((tool.description for tool in reading.prompt.tools if tool.name == MEMORY_TOOL), ""))
    return None if cap is None else cap - PATH_TOKENS


def looked_up(message: Message) -> Message:
    """Return a reply that looks at the memory's file first; an action in it is dropped, to be decided again."""
    if any(each["function"]["name"] == "act" for each in calls_of(message)):
        message = {"role": "assistant", "content": None, "tool_calls": []}
    return _with_call(message, MEMORY_TOOL, command="view", path=FILE)


def filed(message: Message, text: str, reading: Reading) -> Message:
    """Return a reply that also writes the file of the memory anew, before anything else that it does."""
    message = _with_call(message, MEMORY_TOOL, command="create", path=FILE, file_text=text)
    if any(FILE in text_of(m) or FILE in str(m.get("tool_calls")) for m in reading.prompt.shared if _has_file(m)):
        message = _with_call(message, MEMORY_TOOL, command="delete", path=FILE)
    return message


def _has_file(message: Message) -> bool:
    """Whether a message writes the file, or shows what it holds."""
    return "file_text" in str(message.get("tool_calls")) or text_of(message).startswith(CONTENT)


def offers(reading: Reading, tool: str) -> bool:
    """Whether a tool is among those of a prompt."""
    return any(each.name == tool for each in reading.prompt.tools)


def with_recalled(reading: Reading) -> tuple[Reading, str]:
    """Return a prompt with what `recall` has found of earlier steps, and the query for what is missing.

    The query ends with the number of steps played, which the player reads in its next prompt to count on.
    """
    steps, visible = _steps_played(reading), _steps_in(reading)
    earlier = {step: text for step, text in _recalled(reading).items() if step <= steps - visible}
    missing = next(step for step in range(1, steps + 2) if step not in earlier)
    at = next((at for at, message in enumerate(reading.prompt.shared) if message["role"] == "assistant"), None)
    messages = list(reading.prompt.shared)
    for step in sorted(earlier, reverse=True):
        result: Message = {"role": "tool", "content": earlier[step], "tool_call_id": "call_0"}
        messages[at:at] = [call("act"), result]
    return Reading(replace(reading.prompt, shared=messages)), f"{missing}-{steps}"


def searched(message: Message, query: str) -> Message:
    """Return a reply that also searches what has left, before anything else that it does."""
    return _with_call(message, RECALL_TOOL, query=query)


def _with_call(message: Message, tool: str, **arguments: str) -> Message:
    (first,) = calls_of(call(tool, **arguments))
    others = calls_of(message)
    number = sum(other["function"]["name"] == tool for other in others)
    return {**message, "tool_calls": [{**first, "id": f"{IDS.get(tool, tool)}_{number}"}, *others]}


def _recalled(reading: Reading) -> dict[int, str]:
    """The observations in the visible answers of `recall`, by their steps."""
    recalled: dict[int, str] = {}
    for seen in reading.seen:
        if seen.tool == RECALL_TOOL:
            _, *parts = RECALLED.split(seen.text)
            recalled.update(zip(map(int, parts[::2]), map(str.strip, parts[1::2]), strict=True))
    return recalled


def _steps_played(reading: Reading) -> int:
    """How many steps have been played, counted on from the newest query of the player."""
    messages = reading.prompt.shared
    for at in reversed(range(len(messages))):
        for searching in calls_of(messages[at]):
            query = (read(searching["function"]["arguments"]).values or {}).get("query", "")
            if match := re.fullmatch(r"\d+-(\d+)", str(query)):
                return int(match[1]) + _steps_in(Reading(replace(reading.prompt, shared=messages[at:])))
    return _steps_in(reading)


def _steps_in(reading: Reading) -> int:
    return sum(seen.tool == "act" and not is_error(seen.text) for seen in reading.seen)


def _texts(message: Message) -> list[str]:
    """The texts of a message in which a memory of this world may stand."""
    if message["role"] in ("user", "system"):
        return [] if is_carried(message) else [text_of(message)]
    if message["role"] == "tool" and text_of(message).startswith(CONTENT):
        return [NUMBERED.sub("", text_of(message))]
    if message["role"] != "assistant":
        return []
    taken = (read(tool_call["function"]["arguments"]).values or {} for tool_call in calls_of(message))
    written = (str(values[name]) for values in taken for name in ("text", "file_text") if name in values)
    return [text_of(message), *written]


def _facts(text: str) -> dict[str, Any] | None:
    match = LINE.search(text)
    facts = object_in(match[1]) if match else None
    return facts if facts and isinstance(facts.get("clock"), int) else None
