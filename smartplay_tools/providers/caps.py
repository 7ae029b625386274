"""The names of the cap on a reply in chat completions, of which servers know one each."""

from __future__ import annotations

from collections.abc import Mapping

from smartplay_tools.providers.tables import ANY, each, provider_at

__all__ = ["CAPS", "cap_at"]

_BY_PROVIDER: Mapping[str, str] = {ANY: "", "OpenAI": "", **dict(each("cap"))}

CAPS = tuple(dict.fromkeys(_BY_PROVIDER.values()))
"""Every name, those that most servers know first."""


def cap_at(base_url: str) -> str:
    """Return the name that the server at an address knows."""
    return _BY_PROVIDER.get(provider_at(base_url), CAPS[0])


def other_cap(name: str, words: str) -> str:
    """Return the name to try where one is refused: one that the refusal names, or the next that most servers know."""
    others = [cap for cap in CAPS if cap != name]
    return next((cap for cap in others if cap in words), others[0])
