"""Where a request that a server has received is marked for the provider's cache."""

from __future__ import annotations

from typing import Any


def anthropic_marks(body: dict[str, Any]) -> list[int]:
    """How many blocks of the messages end with each mark."""
    contents = [message["content"] for message in body["messages"]]
    blocks = [block for content in contents for block in ([{}] if isinstance(content, str) else content)]
    return [at + 1 for at, block in enumerate(blocks) if "cache_control" in block]


def openai_marks(body: dict[str, Any]) -> list[int]:
    """How many messages or items, the system message apart, end with each mark."""
    items = body.get("messages") or body["input"]
    items = [item for item in items if item.get("role") not in ("system", "developer")]
    return [at + 1 for at, item in enumerate(items) if "prompt_cache_breakpoint" in str(item)]
