"""Which fields for the cache a request to OpenAI's interface may have.

Players ask it for every request, so the rules of caches are read only where the server is OpenAI's.
"""

from __future__ import annotations

from typing import NamedTuple

from smartplay_tools.providers.tables import provider_at

__all__ = ["CacheFields", "openai_cache_fields"]


class CacheFields(NamedTuple):
    """Which fields for the cache a request to OpenAI's interface may have."""

    key: bool = False
    """A key, the same for all requests of an episode."""
    marks: bool = False
    """Marks in the messages."""


def openai_cache_fields(model: str, base_url: str) -> CacheFields:
    """Return which fields for the cache a model behind OpenAI's interface takes; other providers' servers take none."""
    if provider_at(base_url) != "OpenAI":
        return CacheFields()
    from smartplay_tools.providers.caches import cache_rules, rule_of

    rule = rule_of(f"openai:{model}", {}, cache_rules())
    return CacheFields(key=True, marks=rule is not None and rule.marks != "auto")
