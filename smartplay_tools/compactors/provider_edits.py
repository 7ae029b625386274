"""Provider edits: what providers do to a long conversation on their servers, here with the names of their parameters.

Each is a compactor that follows the provider's public definition, on tokens of the window; docs/provider-edits.md has
the sources, and what we chose where a definition is open. A prompt is as long as it is sent: system message, tool
schemas and messages. As at the provider, an edit is applied to the whole conversation at each prompt; a summary takes
the place of what it was made of.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol

from smartplay_tools.context.compaction import ContextOverflowError, GivenHistory, Questions, Room
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.providers.reply_fields import THOUGHTS
from smartplay_tools.types.messages import THOUGHT_PLACES, Message, reasoning_of, text_of

__all__ = [
    "INSTRUCTIONS",
    "SUMMARY",
    "ClearThinking",
    "ClearToolUses",
    "Compact",
    "ContextManagement",
    "OpenAICompaction",
    "applied",
    "clearing_edits",
    "summary_in",
]

Given = Mapping[str, Any]
"""A chat message, or one of Anthropic's."""

Count = Callable[[Sequence[Any]], int]
"""Returns the tokens of messages."""

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

INPUT_TOKENS, TOOL_USES, THINKING_TURNS = "input_tokens", "tool_uses", "thinking_turns"


class Clearing(Protocol):
    """An edit that clears something of a conversation, of which it is always given the whole."""

    persistent: ClassVar[bool] = False
    reads_everything: ClassVar[bool] = True
    reads_thoughts: ClassVar[bool] = True
    name: ClassVar[str]
    counts: ClassVar[str]
    """The provider's name for how much was cleared."""

    @property
    def edits(self) -> Sequence[Clearing]:
        """The edits that are applied, one after the other."""
        return [self]

    def cleared(self, messages: Sequence[Given], tokens: int) -> tuple[list[Given], int]:
        """Return the messages of a prompt with so many tokens after the edit, and how much of them is cleared."""

    def compact(self, history: GivenHistory, room: Room) -> Sequence[Message]:
        """Clear what is to be cleared."""
        made, reports = applied(self.edits, list(history), room.count, head=room.head)
        return made if reports else history


def applied(
    edits: Sequence[Clearing], messages: Sequence[Any], count: Count, *, head: int = 0
) -> tuple[list[Any], list[dict[str, Any]]]:
    """Return messages after edits, and of each edit that was applied what the provider reports of it.

    An edit that would not make the prompt shorter, or not by as much as it has to, is not applied. `head` are the
    tokens of the prompt beside the messages.
    """
    made, reports, tokens = list(messages), list[dict[str, Any]](), count(messages)
    for edit in edits:
        shorter, number = edit.cleared(made, head + tokens)
        saved = tokens - count(shorter) if number else 0
        if saved >= max(1, getattr(edit, "clear_at_least", 0)):
            made, tokens = shorter, tokens - saved
            reports.append({"type": edit.name, edit.counts: number, "cleared_input_tokens": saved})
    return made, reports


class ClearThinking(Clearing):
    """Anthropic's `clear_thinking_20251015`: the thoughts of all turns but the newest that have any are cleared.

    A turn is what the assistant says until the user says more than results.

    Arguments:
        keep: of how many turns the thoughts stay; `all` for those of all.
    """

    name: ClassVar[str] = "clear_thinking_20251015"
    counts: ClassVar[str] = "cleared_thinking_turns"

    def __init__(self, keep: Any = 1) -> None:
        self.keep: int | None = None
        if keep not in ("all", {"type": "all"}):
            self.keep = _amount(self.name, "keep", keep, THINKING_TURNS, least=1)[1]

    def cleared(self, messages: Sequence[Given], tokens: int) -> tuple[list[Given], int]:
        """Return the messages without the thoughts of old turns; one that is nothing but thoughts stays."""
        turn, turns = 0, dict[int, int]()
        for at, message in enumerate(messages):
            if _is_said_by_user(message):
                turn += 1
            elif _thinks(message):
                turns[at] = turn
        old = sorted(set(turns.values()))[: -self.keep] if self.keep else []
        return [_without_thoughts(m) if turns.get(at) in old else m for at, m in enumerate(messages)], len(old)


def _is_said_by_user(message: Given) -> bool:
    """Whether a message is more than results; a result beside which a user's words stand has the user's name."""
    if message.get("role") != "user":
        return message.get("role") == "tool" and message.get("name") == "user"
    is_list = isinstance(message.get("content"), list)
    return not is_list or any(block.get("type") != "tool_result" for block in _blocks(message))


def _thinks(message: Given) -> bool:
    """Whether a message has thoughts, also where nobody can read them."""
    if message.get("role") != "assistant":
        return False
    parts = [*_blocks(message), *(message.get("provider_items") or ())]
    is_marked = any(isinstance(part, Mapping) and part.get("type") in THOUGHTS for part in parts)
    return is_marked or (not THOUGHT_PLACES.isdisjoint(message) and bool(reasoning_of(message)))


def _without_thoughts(message: Given) -> Given:
    made = {name: value for name, value in message.items() if name not in THOUGHT_PLACES}
    if _blocks(message):
        made["content"] = [b for b in message["content"] if not isinstance(b, Mapping) or b.get("type") not in THOUGHTS]
    return made if made.get("content") or made.get("tool_calls") else message


class ClearToolUses(Clearing):
    """Anthropic's `clear_tool_uses_20250919`: above the trigger, results of old tool uses are cleared.

    Arguments:
        trigger: a prompt with more input tokens than this is edited; `tool_uses=N` counts tool uses instead.
        keep: how many of the newest tool uses stay.
        clear_at_least: nothing is cleared unless the prompt gets shorter by as many tokens.
        exclude_tools: the name of a tool whose uses stay, or a list of names.
        clear_tool_inputs: whether the arguments of calls are cleared as well; or a list of tools whose arguments are.
    """

    name: ClassVar[str] = "clear_tool_uses_20250919"
    counts: ClassVar[str] = "cleared_tool_uses"

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

    def clears_input(self, tool: str) -> bool:
        """Whether the arguments of a cleared call are cleared, too."""
        return self.clear_tool_inputs is None or tool in self.clear_tool_inputs

    def cleared(self, messages: Sequence[Given], tokens: int) -> tuple[list[Given], int]:
        """Return the messages with old tool uses cleared."""
        uses = [use for message in messages for use in _uses(message)]
        names, results = dict(use for use in uses if use[1] is not None), [use for use, name in uses if name is None]
        kind, most = self.trigger
        if (tokens if kind == INPUT_TOKENS else len(results)) <= most:
            return [*messages], 0
        before = results[: max(0, len(results) - self.keep)]
        ids = {use for use in before if names.get(use, "") not in self.exclude_tools}
        return [_without_uses(message, self, ids) for message in messages] if ids else [*messages], len(ids)


class ContextManagement(Clearing):
    """Anthropic's `context_management`: its edits that clear, one after the other.

    Arguments:
        edits: the provider's list, as in `[{"type": "clear_thinking_20251015", "keep": "all"}]`.
    """

    name: ClassVar[str] = "context_management"

    def __init__(self, edits: Any) -> None:
        self._edits = clearing_edits(edits)

    @property
    def edits(self) -> Sequence[Clearing]:
        """The edits that are applied, one after the other."""
        return self._edits


EDITS = {edit.name: edit for edit in (ClearToolUses, ClearThinking)}
AMOUNTS = ("trigger", "keep", "clear_at_least")
"""Options that are objects in the provider's list, and may be numbers and texts in ours."""


def clearing_edits(given: Any, *others: str) -> list[Clearing]:
    """Return the edits of a request's list that clear; `others` are the types of edits that it may have beside them.

    What the provider would refuse is an `InvalidArgumentError` as it says it.
    """
    field = ContextManagement.name
    if not isinstance(given, list) or not all(isinstance(edit, Mapping) for edit in given):
        raise InvalidArgumentError(f"{field}: Input should be an object with a list of edits.")
    kinds = [edit.get("type") for edit in given]
    for at, kind in enumerate(kinds):
        if kind not in (*EDITS, *others):
            known = ", ".join(map(repr, (*EDITS, *others)))
            raise InvalidArgumentError(f"{field}.edits.{at}: Input tag {kind!r} does not match any of {known}.")
    if ClearThinking.name in kinds[1:]:
        raise InvalidArgumentError(f"`{ClearThinking.name}` strategy must be first in `{field}.edits`.")
    return [_clearing_edit(EDITS[kind], at, given[at]) for at, kind in enumerate(kinds) if kind in EDITS]


def _clearing_edit(make: type[ClearToolUses] | type[ClearThinking], at: int, given: Given) -> Clearing:
    place, options = f"{ContextManagement.name}.edits.{at}", {name: given[name] for name in given if name != "type"}
    for name in options:
        if name not in inspect.signature(make).parameters:
            raise InvalidArgumentError(f"{place}.{name}: Extra inputs are not permitted.")
        if name in AMOUNTS and not isinstance(given[name], Mapping) and given[name] not in (None, "all"):
            raise InvalidArgumentError(f"{place}.{name}: Input should be an object with a type and a value.")
        if name == "exclude_tools" and isinstance(given[name], str):
            raise InvalidArgumentError(f"{place}.{name}: Input should be a list.")
    try:
        return make(**options)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{place}: {error}") from None


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


def _without_uses(message: Given, edit: ClearToolUses, ids: Collection[str]) -> Given:
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
    made = {**message, **changed}
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
