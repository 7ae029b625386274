"""Context editing at the endpoint: Anthropic's `clear_thinking_20251015` and `clear_tool_uses_20250919`, applied here.

The edits that a request to Messages asks for are applied to its messages before these are fitted, and the answer says
what was cleared, as the provider's would, whole or streamed. docs/provider-edits.md has the definitions. What is not an
edit of these two, `compact_20260112` above all, goes upstream as it came.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from smartplay_tools import InvalidArgumentError
from smartplay_tools.context.strategies.provider_edits import ClearToolUses, clear_tool_uses

__all__ = ["BETA", "applied"]

FIELD = "context_management"
BETA = "context-management-2025-06-27"
"""The beta that a request has to ask for."""

THINKING, TOOL_USES, COMPACT = "clear_thinking_20251015", "clear_tool_uses_20250919", "compact_20260112"
THOUGHTS = ("thinking", "redacted_thinking")
"""The types of blocks that are thoughts."""

Json = dict[str, Any]
Count = Callable[[Sequence[Any]], int]
"""Returns the tokens of a prompt with these messages."""


def applied(body: Json, betas: str, count: Count) -> tuple[Json, list[Json] | None]:
    """Return a request without the edits that were applied to it, and what they cleared; None if it asks for none.

    `betas` is the header `anthropic-beta`. Edits that the provider would refuse are an `InvalidArgumentError`.
    """
    if body.get(FIELD) is None:
        return body, None
    wanted = body[FIELD]
    edits = wanted.get("edits", []) if isinstance(wanted, Mapping) else None
    if not isinstance(edits, list) or not all(isinstance(edit, Mapping) for edit in edits):
        raise InvalidArgumentError(f"{FIELD}: Input should be an object with a list of edits.")
    kinds = [edit.get("type") for edit in edits]
    for at, kind in enumerate(kinds):
        if kind not in (THINKING, TOOL_USES, COMPACT):
            known = ", ".join(map(repr, (TOOL_USES, THINKING, COMPACT)))
            raise InvalidArgumentError(f"{FIELD}.edits.{at}: Input tag {kind!r} does not match any of {known}.")
    ours = [edit for edit in edits if edit["type"] != COMPACT]
    if not ours:
        return body, None
    if BETA not in [name.strip() for name in betas.split(",")]:
        raise InvalidArgumentError(f"{FIELD}: Extra inputs are not permitted without the beta {BETA}.")
    if THINKING in kinds[1:]:
        raise InvalidArgumentError(f"`{THINKING}` strategy must be first in `{FIELD}.edits`.")
    messages: list[Any] = body["messages"]
    reports: list[Json] = []
    if not all(isinstance(message, Mapping) for message in messages):
        return body, None  # the upstream says what is wrong with it
    tokens = count(messages)
    for edit in ours:
        try:
            change = _thinking if edit["type"] == THINKING else _uses
            messages, told, saved = change(edit, body, messages, count, tokens)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"{FIELD}.edits.{edits.index(edit)}: {error}") from None
        tokens -= saved
        if saved:
            reports.append({"type": edit["type"], **told, "cleared_input_tokens": saved})
    rest = [edit for edit in edits if edit["type"] == COMPACT]
    edited = {**body, "messages": messages, FIELD: {**wanted, "edits": rest}}
    if not rest:
        del edited[FIELD]
    return edited, reports


def _thinking(
    edit: Mapping[str, Any], body: Json, messages: list[Any], count: Count, before: int
) -> tuple[list[Any], Json, int]:
    """Clear the thoughts of all turns but the newest that have any."""
    thinking = body.get("thinking")
    if not isinstance(thinking, Mapping) or thinking.get("type") not in ("enabled", "adaptive"):
        raise InvalidArgumentError(f"`{THINKING}` strategy requires `thinking` to be enabled.")
    keep = edit.get("keep", {"type": "thinking_turns", "value": 1})
    _only(edit, "keep")
    if keep in ("all", {"type": "all"}):
        return messages, {}, 0
    value = keep.get("value") if isinstance(keep, Mapping) and keep.get("type") == "thinking_turns" else None
    if type(value) is not int or value < 1:
        raise InvalidArgumentError('keep has to be "all" or {"type": "thinking_turns", "value": N}, with N at least 1.')
    turn, turns = 0, {}
    for at, message in enumerate(messages):
        blocks = _blocks(message)
        if message.get("role") == "user" and any(block.get("type") != "tool_result" for block in blocks):
            turn += 1
        if message.get("role") == "assistant" and any(block.get("type") in THOUGHTS for block in blocks):
            turns[at] = turn
    old = set(sorted(set(turns.values()))[:-value])
    made = list(messages)
    for at in (at for at, turn in turns.items() if turn in old):
        rest = [block for block in messages[at]["content"] if block.get("type") not in THOUGHTS]
        made[at] = {**messages[at], "content": rest} if rest else messages[at]
    return made, {"cleared_thinking_turns": len(old)}, before - count(made) if old else 0


def _uses(
    edit: Mapping[str, Any], body: Json, messages: list[Any], count: Count, before: int
) -> tuple[list[Any], Json, int]:
    """Clear old tool uses."""
    options = {name: value for name, value in edit.items() if name != "type"}
    _only(edit, "trigger", "keep", "clear_at_least", "exclude_tools", "clear_tool_inputs")
    made, uses, saved = clear_tool_uses(messages, ClearToolUses(**options), count, before)
    return made, {"cleared_tool_uses": uses}, saved


def _only(edit: Mapping[str, Any], *known: str) -> None:
    for name in edit:
        if name not in ("type", *known):
            raise InvalidArgumentError(f"{name}: Extra inputs are not permitted.")


def _blocks(message: Any) -> list[Mapping[str, Any]]:
    """The blocks of a message; a text alone counts as one."""
    content = message.get("content") if isinstance(message, Mapping) else None
    if isinstance(content, str):
        return [] if message.get("role") == "assistant" else [{"type": "text"}]
    return [block for block in content if isinstance(block, Mapping)] if isinstance(content, list) else []
