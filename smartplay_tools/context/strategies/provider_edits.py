"""Provider edits: what providers do to a long conversation on their servers, here with the names of their parameters.

Each is a compactor that follows the provider's public definition, on tokens of the window; docs/provider-edits.md has
the sources, and what we chose where a definition is open. A prompt is as long as it is sent: system message, tool
schemas and messages. As at the provider, an edit is applied to the whole conversation at each prompt; a summary takes
the place of what it was made of.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

from smartplay_tools.context.compaction import ContextOverflowError, GivenHistory, Questions, Room
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types.messages import Message, text_of

__all__ = ["INSTRUCTIONS", "SUMMARY", "ClearToolUses", "Compact", "OpenAICompaction", "clear_tool_uses", "summary_in"]

M = TypeVar("M", bound=Mapping[str, Any])

CLEARED = "[cleared]"
"""What stands in place of a result."""

NO_INPUT = "{}"
"""The arguments of a call whose input is cleared."""

SUMMARY = "A summary stands in place of the conversation before this message:\n"
"""How the message with a summary begins."""

INSTRUCTIONS = (
    "The conversation above is about to be replaced by a summary that you write now. Write down everything that helps "
    "to go on with the task without it: the state, what was learned, the next steps. Put the summary between <summary> "
    "and </summary>, and call no tool."
)
"""The question for a summary, in our words."""

INPUT_TOKENS, TOOL_USES = "input_tokens", "tool_uses"


class ClearToolUses:
    """Anthropic's `clear_tool_uses_20250919`: above the trigger, results of old tool uses are cleared.

    Arguments:
        trigger: a prompt with more input tokens than this is edited; `tool_uses=N` counts tool uses instead.
        keep: how many of the newest tool uses stay.
        clear_at_least: nothing is cleared unless the prompt gets shorter by as many tokens.
        exclude_tools: the name of a tool whose uses stay, or a list of names.
        clear_tool_inputs: whether the arguments of calls are cleared as well; or a list of tools whose arguments are.
    """

    persistent: ClassVar[bool] = False
    reads_everything: ClassVar[bool] = True
    name: ClassVar[str] = "clear_tool_uses_20250919"

    def __init__(
        self,
        trigger: Any = 100_000,
        keep: Any = 3,
        clear_at_least: Any = None,
        exclude_tools: Any = (),
        clear_tool_inputs: Any = False,
    ) -> None:
        self.trigger = _amount(self.name, "trigger", trigger, INPUT_TOKENS, TOOL_USES, least=1)
        self.keep = _amount(self.name, "keep", keep, TOOL_USES, least=0)[1]
        least = 0 if clear_at_least is None else clear_at_least
        self.clear_at_least = _amount(self.name, "clear_at_least", least, INPUT_TOKENS, least=0)[1]
        self.exclude_tools = _tools(self.name, "exclude_tools", () if exclude_tools is None else exclude_tools)
        self.clear_tool_inputs: Collection[str] | None = None
        """The tools whose arguments are cleared; None for all."""
        if clear_tool_inputs is not True:
            listed = () if clear_tool_inputs in (None, False) else clear_tool_inputs
            self.clear_tool_inputs = _tools(self.name, "clear_tool_inputs", listed)

    def old(self, results: Sequence[str], names: Mapping[str, str], tokens: int) -> frozenset[str]:
        """Return which uses to clear, by the ids of results in their order and the names of tools by these ids."""
        kind, most = self.trigger
        if (tokens if kind == INPUT_TOKENS else len(results)) <= most:
            return frozenset()
        before = results[: max(0, len(results) - self.keep)]
        return frozenset(each for each in before if names.get(each, "") not in self.exclude_tools)

    def clears_input(self, tool: str) -> bool:
        """Whether the arguments of a cleared call are cleared, too."""
        return self.clear_tool_inputs is None or tool in self.clear_tool_inputs

    def compact(self, history: GivenHistory, room: Room) -> Sequence[Message]:
        """Clear what is to be cleared."""
        given = list(history)
        cleared, uses, _ = clear_tool_uses(given, self, room.count, room.count(given), head=room.head)
        return cleared if uses else history


def clear_tool_uses(
    messages: Sequence[M], edit: ClearToolUses, count: Callable[[Sequence[M]], int], before: int, *, head: int = 0
) -> tuple[list[M], int, int]:
    """Return messages with old tool uses cleared, how many are, and how many tokens fewer they have.

    They are chat messages, or Anthropic's. `before` are their tokens, and `head` those of the prompt beside them.
    """
    uses = [use for message in messages for use in _uses(message)]
    names, results = {use: name for use, name in uses if name is not None}, [use for use, name in uses if name is None]
    ids = edit.old(results, names, head + before)
    made = [_without_uses(message, edit, ids) for message in messages] if ids else []
    saved = before - count(made) if ids else 0
    return (made, len(ids), saved) if saved >= max(1, edit.clear_at_least) else ([*messages], 0, 0)


def _uses(message: Mapping[str, Any]) -> Iterator[tuple[str, str | None]]:
    """The ids of calls with their names, and those that results answer, without one."""
    if message["role"] == "tool":
        yield message["tool_call_id"], None
    for call in message.get("tool_calls") or ():
        yield str(call.get("id")), str(_function(call).get("name"))
    for block in _blocks(message):
        if block.get("type") in ("tool_use", "tool_result"):
            name = str(block.get("name")) if block["type"] == "tool_use" else None
            yield str(block.get("tool_use_id" if name is None else "id")), name


def _without_uses(message: M, edit: ClearToolUses, ids: Collection[str]) -> M:
    """A message without the results of some uses, and without the arguments that the edit clears."""

    def block(part: Any) -> Any:
        kind = part.get("type") if isinstance(part, Mapping) else None
        if kind == "tool_result" and str(part.get("tool_use_id")) in ids:
            return {**part, "content": CLEARED}
        is_old = kind == "tool_use" and str(part.get("id")) in ids and edit.clears_input(str(part.get("name")))
        return {**part, "input": {}} if is_old else part

    def call(part: Any) -> Any:
        is_old = str(part.get("id")) in ids and edit.clears_input(str(_function(part).get("name")))
        return {**part, "function": {**_function(part), "arguments": NO_INPUT}} if is_old else part

    changed: dict[str, Any] = {}
    if message["role"] == "tool" and message["tool_call_id"] in ids:
        changed["content"] = CLEARED
    if calls := message.get("tool_calls"):
        changed["tool_calls"] = [*map(call, calls)]
    if _blocks(message):
        changed["content"] = [*map(block, message["content"])]
    made: Any = {**message, **changed}
    return message if made == message else made


def _function(call: Mapping[str, Any]) -> Mapping[str, Any]:
    return call.get("function") or {}


def _blocks(message: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    content = message.get("content")
    return [block for block in content if isinstance(block, Mapping)] if isinstance(content, list) else []


class Compact:
    """Anthropic's `compact_20260112`: above the trigger the model summarises the conversation, and goes on with that.

    Arguments:
        trigger: a prompt with more input tokens than this is compacted.
        instructions: the question for the summary, in place of ours.
        pause_after_compaction: refused if true, because a game has nobody to whom a pause could be returned.
    """

    reads_everything: ClassVar[bool] = True
    name: ClassVar[str] = "compact_20260112"
    keeps_words_of_users: ClassVar[bool] = False

    def __init__(
        self, trigger: Any = 150_000, instructions: str | None = None, pause_after_compaction: bool = False
    ) -> None:
        if pause_after_compaction is not False:
            raise InvalidArgumentError(f"{self.name} cannot pause here; leave out pause_after_compaction.")
        if instructions is not None and (not isinstance(instructions, str) or not instructions.strip()):
            raise InvalidArgumentError(f"The instructions of {self.name} are a text; leave them out for the default.")
        self.trigger = _amount(self.name, "trigger", trigger, INPUT_TOKENS, least=1)[1]
        self.instructions = instructions or INSTRUCTIONS

    def compact(self, history: GivenHistory, room: Room) -> Questions[Sequence[Message]]:
        """Ask for a summary if the prompt is over the trigger; without one, nothing is changed."""
        given = list(history)
        if room.head + room.count(given) <= self.trigger:
            return history
        try:
            reply = yield [*given, {"role": "user", "content": self.instructions}]
        except ContextOverflowError:
            return history
        summary = summary_in(text_of(reply))
        if not summary:
            return history
        kept = [message for message in given if message["role"] == "user" and not text_of(message).startswith(SUMMARY)]
        return [*(kept if self.keeps_words_of_users else ()), {"role": "user", "content": SUMMARY + summary}]


class OpenAICompaction(Compact):
    """OpenAI's and xAI's `context_management` of the type `compaction`: users' words stay, a summary stands after them.

    Arguments:
        compact_threshold: a prompt with more tokens than this is compacted.
    """

    name: ClassVar[str] = "compaction"
    keeps_words_of_users: ClassVar[bool] = True

    def __init__(self, compact_threshold: Any = None) -> None:
        if compact_threshold is None:
            raise InvalidArgumentError("compaction needs compact_threshold=N, the tokens above which it acts.")
        super().__init__(_amount(self.name, "compact_threshold", compact_threshold, INPUT_TOKENS, least=1)[1])


def summary_in(text: str) -> str:
    """Return what stands between the tags of a summary; the whole text if there are none."""
    found = re.search(r"<summary>(.*?)(?:</summary>|\Z)", text, re.DOTALL)
    return (text if found is None else found[1]).strip()


def _amount(edit: str, option: str, given: Any, *kinds: str, least: int) -> tuple[str, int]:
    """Read an amount: a number of the first kind, the text `KIND=N`, or the provider's `{"type": KIND, "value": N}`."""
    kind, value = kinds[0], given
    if isinstance(given, Mapping) and set(given) == {"type", "value"}:
        kind, value = given["type"], given["value"]
    elif isinstance(given, str) and "=" in given:
        kind, _, text = given.partition("=")
        value = int(text) if re.fullmatch("[0-9]{1,18}", text) else None
    if kind not in kinds or type(value) is not int or value < least:
        forms = " or ".join(f"{each}=N" for each in kinds)
        raise InvalidArgumentError(f"{option}={given!r} of {edit} has to be {forms}, with N at least {least}.")
    return kind, value


def _tools(edit: str, option: str, given: Any) -> frozenset[str]:
    names = [given] if isinstance(given, str) else given
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) and name for name in names):
        raise InvalidArgumentError(f"{option}={given!r} of {edit} has to be the name of a tool, or a list of names.")
    return frozenset(names)
