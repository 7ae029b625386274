"""What a server says that it has counted, and why its reply ended, under whatever names it says so.

Compatible servers deviate from their interface in many ways, so everything is read from plain data, without assumptions
about its contents. The names are in the files of providers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from typing import Any, Literal

from smartplay_tools.providers.tables import merged, names, rows
from smartplay_tools.types import Usage

PARTS = ("cached", "written", "written_1h", "reasoning")
"""Counts of a usage that are parts of others."""


def read_usage(usage: Any, interface: Literal["chat", "responses", "messages"]) -> Usage | None:
    """Return the usage of an answer; what is a part of its tokens may stand beside them or in one of its details."""
    if not isinstance(usage, Mapping):
        return None
    own, places = merged("usage", interface), [usage, *usage.values()]
    parts = {kind: reported_in(places, *names("usage", kind)) for kind in PARTS}
    counts = {kind: count or 0 for kind, count in parts.items()}
    read = Usage(
        prompt=(reported_in([usage], own["prompt"]) or 0) + sum(counts[kind] for kind in own.get("beside", ())),
        reply=reported_in([usage], own["reply"]) or 0,
        cached=parts["cached"],
        written=counts["written"],
        written_1h=min(counts["written"], counts["written_1h"]),
        reasoning=counts["reasoning"],
    )
    read = read.checked(reported_in([usage], "total_tokens"))
    listed = usage.get("iterations")
    for each in listed if isinstance(listed, list) else ():
        if isinstance(each, Mapping) and each.get("type") == "compaction":  # Anthropic's other counts are without it
            read += (read_usage(each, interface) or Usage()).model_copy(update={"requests": 0})
    return read


@cache
def _ends() -> Mapping[str, str]:
    """The count of `Usage` for each reason for which a reply ended, in small letters."""
    return {name: row["count"] for _, row in rows("end") for name in row["reasons"]}


def with_end(usage: Usage | None, *reasons: Any) -> Usage | None:
    """Return a usage that counts for which reasons its reply ended, wherever its provider says so.

    Gemini's endpoint joins two in one text: "function_call_filter: MALFORMED_FUNCTION_CALL".
    """
    said = [part for reason in reasons if isinstance(reason, str) for part in reason.lower().split(": ")]
    counts = dict.fromkeys((_ends()[part] for part in said if part in _ends()), 1)
    return (usage or Usage()).model_copy(update=counts) if counts else usage


MANAGEMENT = ("context_management", "compaction")
"""Fields of a request that ask a provider to manage the context; some frameworks put its name in front."""


def asks_management(*options: Any) -> bool:
    """Whether any of these options of a model, or the extra body in them, asks its provider to manage the context.

    Not every key is a name: those of a bias of tokens are numbers.
    """
    places = [each for each in options if isinstance(each, Mapping)]
    places += [inner for each in places for inner in each.values() if isinstance(inner, Mapping)]
    named = ((name, value) for place in places for name, value in place.items() if isinstance(name, str))
    return any(name.endswith(MANAGEMENT) and bool(value) for name, value in named)


def left_to_provider(usage: Usage | None, *options: Any) -> Usage | None:
    """Return the usage of a reply, marked if its prompt was left to the provider by the options of its model."""
    return (usage or Usage()).model_copy(update={"managed": 1}) if asks_management(*options) else usage


def with_management(usage: Usage | None, answer: Mapping[str, Any], parts: Any) -> Usage | None:
    """Return a usage that counts what the provider says it did to the context; `parts` are those of the answer."""
    said = answer.get("context_management")
    applied = said.get("applied_edits") if isinstance(said, Mapping) else None
    edits = [each for each in applied if isinstance(each, Mapping)] if isinstance(applied, list) else []
    listed = [each for each in parts if isinstance(each, Mapping)] if isinstance(parts, list) else []
    count = len(edits) + sum(each.get("type") == "compaction" for each in listed)
    if not count:
        return usage
    cleared = max(0, sum(reported_in([each], "cleared_input_tokens") or 0 for each in edits))
    return (usage or Usage()).model_copy(update={"managed": 1, "edits": count, "cleared": cleared})


def reported_in(places: Iterable[Any], *called: str) -> int | None:
    """Return the largest number that the mappings among these have under these names; None if they have none.

    Some servers write a number as text.
    """
    reported: list[int] = []
    for counts in places:
        for name in called if isinstance(counts, Mapping) else ():
            with suppress(TypeError, ValueError, OverflowError):  # anything else, NaN, infinity
                reported.append(int(float(counts.get(name))))
    return max(reported, default=None)


def written_usage(usage: Usage, interface: Literal["chat", "responses"]) -> dict[str, Any]:
    """Return a usage as an answer has it; a completion without a count of cached tokens has none of these."""
    own, cached = merged("usage", interface), {"cached_tokens": usage.cached or 0}
    if usage.cached is None and interface == "chat":
        cached = {}
    return {
        own["prompt"]: usage.prompt,
        own["reply"]: usage.reply,
        "total_tokens": usage.prompt + usage.reply,
        f"{own['prompt']}_details": {**cached, "cache_write_tokens": usage.written},
        f"{own['reply']}_details": {"reasoning_tokens": usage.reasoning},
    }
