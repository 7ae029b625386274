"""Pairs: which episodes of several runs a page shows side by side.

Episodes of the same game, seed and trial met the same world. Where a run has several of them, that of the same player
under the same rules is the counterpart, else that of the same player, else that under the same rules, else the first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from smartplay_tools.evaluation.pages.report.summary_tables import rules
from smartplay_tools.types.groups import grouped

Episode = Mapping[str, Any]


def pairs_of(episodes: Sequence[Episode]) -> Iterator[tuple[Episode, Episode]]:
    """Yield every finished episode of the later runs with its counterpart in the first run."""
    first = episodes[0]["run"] if episodes else ""
    finished = [episode for episode in episodes if episode["status"] == "finished"]
    of_first = grouped((episode for episode in finished if episode["run"] == first), _world)
    for episode in finished:
        if episode["run"] != first and (candidates := of_first.get(_world(episode))):
            yield max(candidates, key=lambda other: _likeness(other, episode)), episode


def _world(episode: Episode) -> tuple[Any, ...]:
    return episode["game"], episode["seed"], episode["trial"]


def _likeness(one: Episode, other: Episode) -> tuple[bool, bool]:
    return one["player"] == other["player"], rules(one) == rules(other)
