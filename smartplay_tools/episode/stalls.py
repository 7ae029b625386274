"""Stalls: how many turns in a row have brought nothing, computed from an episode's events one by one.

A turn brings nothing if it plays no step and shows nothing new: it has no call, or each of its calls is a mistake, was
refused, or repeats what the model has seen. A model in such a state rarely leaves it, but would go on until its calls
are spent; `Budget.stalled_turns` ends the episode. `docs/budgets.md` is the exact definition.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smartplay_tools.types import TOOL_NAMES
from smartplay_tools.types.arguments import read


class Stalls:
    """Counts the turns in a row that brought nothing; the latest turn counts as if it were complete."""

    def __init__(self) -> None:
        self._before = 0
        """The turns in a row before the latest."""
        self._turn = -1
        self._is_new = self._is_foreign = True
        """Whether the latest turn has brought something new, and whether it has the result of a foreign tool."""
        self._observation = -1
        self._manual_was_read = False
        self._sent: dict[str, str] = {}
        """The latest arguments that each of the strategies' tools has accepted."""

    @property
    def in_a_row(self) -> int:
        """How many turns in a row have brought nothing."""
        if self._is_new:
            return 0
        return self._before + (not self._is_foreign)

    def apply(self, event: Mapping[str, Any]) -> None:
        """Take note of an event."""
        match event["event"]:
            case "message" if event["by"] == "player":
                self._open(event["turn"])
            case "message" if "position" in event:
                self._is_foreign = True
            case "call":
                self._open(event["turn"])
                if not event["is_error"] and self._shows_something_new(event):
                    self._is_new = True

    def _open(self, turn: int) -> None:
        """Begin a turn, unless it is the latest."""
        if turn != self._turn:
            self._before, self._turn = self.in_a_row, turn
            self._is_new = self._is_foreign = False

    def _shows_something_new(self, call: Mapping[str, Any]) -> bool:
        """Whether an answer is a step, the first reading of the manual, or anything else that was not shown before."""
        name, data = call["name"], call["data"]
        if "observation_step" in data:
            is_new = data["observation_step"] > self._observation
            self._observation = max(self._observation, data["observation_step"])
            return is_new or "reward" in data
        if data.get("manual"):
            was_read, self._manual_was_read = self._manual_was_read, True
            return not was_read
        if name in TOOL_NAMES:
            return False
        sent, self._sent[name] = self._sent.get(name), read(call["arguments"]).canonical
        return sent != self._sent[name]
