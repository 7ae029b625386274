"""Context editing at the endpoint: Anthropic's `clear_thinking_20251015` and `clear_tool_uses_20250919`, applied here.

The edits that a request to Messages asks for are applied to its messages before these are fitted, and the answer says
what was cleared, as the provider's would, whole or streamed. docs/provider-edits.md has the definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools import InvalidArgumentError
from smartplay_tools.context.strategies import provider_edits
from smartplay_tools.context.strategies.provider_edits import ClearThinking, Compact, clearing_edits

__all__ = ["BETA", "applied"]

FIELD = "context_management"
BETA = "context-management-2025-06-27"
"""The beta that a request has to ask for."""

Json = dict[str, Any]


def applied(body: Json, betas: str, count: provider_edits.Count) -> tuple[Json, list[Json] | None]:
    """Return a request without the edits that were applied to it, and what they cleared; None if it asks for none.

    `betas` is the header `anthropic-beta`. Edits that the provider would refuse are an `InvalidArgumentError`.
    """
    if (wanted := body.get(FIELD)) is None:
        return body, None
    given = wanted.get("edits", []) if isinstance(wanted, Mapping) else None
    edits = clearing_edits(given, Compact.name)
    if not edits:
        return body, None
    if BETA not in [name.strip() for name in betas.split(",")]:
        raise InvalidArgumentError(f"{FIELD}: Extra inputs are not permitted without the beta {BETA}.")
    thinking = body.get("thinking")
    is_thinking = isinstance(thinking, Mapping) and thinking.get("type") in ("enabled", "adaptive")
    if isinstance(edits[0], ClearThinking) and not is_thinking:
        raise InvalidArgumentError(f"`{ClearThinking.name}` strategy requires `thinking` to be enabled.")
    if not all(isinstance(message, Mapping) for message in body["messages"]):
        return body, None  # the upstream says what is wrong with it
    messages, reports = provider_edits.applied(edits, body["messages"], count)
    edited = {name: value for name, value in body.items() if name != FIELD} | {"messages": messages}
    rest = [edit for edit in given or () if edit["type"] == Compact.name]
    return edited | ({FIELD: {**wanted, "edits": rest}} if rest else {}), reports
