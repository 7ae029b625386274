"""Excerpts: some turns of an episode, for a page that plays only those.

Earlier turns stay, because prompts show them; later ones are left out, with the drawings, pictures and departures of
later turns.
"""

from __future__ import annotations

from typing import Any

from smartplay_tools.errors import InvalidArgumentError


def excerpt(data: dict[str, Any], first: int, last: int) -> dict[str, Any]:
    """Return the data of an episode for a page that plays the turns from `first` to `last`."""
    count = len(data["turns"])
    if not first <= last < count:
        raise InvalidArgumentError(f"The episode has turns 0 to {count - 1}; there is no range {first}-{last} of them.")
    turns = data["turns"][: last + 1]
    calls = [item["call"] for turn in turns for item in turn["items"] if "call" in item]
    steps = max((call["step"] for call in calls if call.get("legal")), default=0)
    drawing = dict(data["drawing"])
    for name, length in (("changes", steps + 1), ("walk", steps + 1), ("actions", steps), ("rewards", steps)):
        if name in drawing:
            drawing[name] = drawing[name][:length]
    pictures = data["pictures"]
    if pictures is not None:
        named = {call["picture"]["sha256"] for call in calls if "picture" in call}
        pictures = {**pictures, "files": {name: file for name, file in pictures["files"].items() if name in named}}
    departures = data["departures"]
    if departures is not None:
        departures = [gone for gone in departures if gone["prompt"] <= last]
    shown = {"first": first, "last": last, "count": count}
    kept = {"turns": turns, "drawing": drawing, "pictures": pictures, "departures": departures}
    return {**data, **kept, "excerpt": shown}
