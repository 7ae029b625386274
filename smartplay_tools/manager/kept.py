"""The rule of a compactor over an agent's messages: what every prompt shows stays, whatever comes back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from smartplay_tools.context.compacting import Compacting
from smartplay_tools.context.rewriting import Place, flat, joined, on_record
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Piece, Selection, ranges_of
from smartplay_tools.manager.window import AgentWindow, grouped
from smartplay_tools.types.messages import calls_of


class KeptCompacting(Compacting):
    """The rule of a compactor whose prompts show what every prompt shows.

    What is missing of it is put back where it stood. While the prompt is over its cap, units leave it, oldest first,
    and then the messages before the first reply. A unit that stays and was made too long is shown as it was given.
    """

    def __init__(self, window: AgentWindow, compactor: Any) -> None:
        super().__init__(window, compactor, ids=window.ids)
        self._agent = window

    def untouched(self) -> Selection:
        """Return what a prompt shows where the compactor is not called."""
        return self._to_play(self._history.pieces)

    def _to_play(self, pieces: list[Piece]) -> Selection:
        window, cap = self._agent, self._window.budget.prompt_tokens
        groups = grouped(self._with_kept(flat(pieces)), lambda place: self._form(place).is_result)
        sizes = [self._group_tokens(group) for group in groups]
        total, shown = window.head_tokens + sum(sizes), [True] * len(groups)
        firsts = (at for at, group in enumerate(groups) if self._form(group[0]).message["role"] == "assistant")
        first = next(firsts, len(groups))
        for at in (*range(first, len(groups)), *range(first)):
            if cap is None or total <= cap:
                break
            if not self._is_kept(groups[at]):
                shown[at], total = False, total - sizes[at]
        for at, group in enumerate(groups):
            if cap is None or total <= cap:
                break
            if any(isinstance(place, Form) for place in group) and self._is_kept(group):  # it has made it longer
                turn = next(window.turn_of(n) for place in group if (n := self._number(place)) is not None)
                groups[at] = [*window.row(turn, turn + 1)]
                total += self._group_tokens(groups[at]) - sizes[at]
        numbers, start = list[int](), 0
        for group, stays in zip(groups, shown, strict=True):
            numbers += range(start, start + len(group)) if stays else ()
            start += len(group)
        back = joined(place for group in groups for place in group)
        self._history.take({"messages": on_record(back), "shown": ranges_of(numbers), "task": False})
        self._played = total
        return self._history.selection()

    def _with_kept(self, places: Sequence[Place]) -> list[Place]:
        """Return messages with those that every prompt shows; the head comes first."""
        window = self._agent
        found = [place for place in places if isinstance(place, Form) or place >= window.starts[0]]
        there = {window.turn_of(number) for place in found if (number := self._number(place)) is not None}
        for turn in sorted(window.always - there):
            row = window.row(turn, turn + 1)
            later = (at for at, place in enumerate(found) if (n := self._number(place)) is not None and n >= row.stop)
            at = next(later, len(found))
            found[at:at] = row
        return [*range(window.starts[0]), *found]

    def _form(self, place: Place) -> Form:
        return place if isinstance(place, Form) else self._window.now[place]

    def _number(self, place: Place) -> int | None:
        """The number of a message, or of the one in whose place it stands."""
        if not isinstance(place, Form):
            return place
        message = place.message
        if (turn := self._agent.edited(place)) is not None:
            return self._window.starts[turn]
        if message["role"] == "tool":
            return self._window.result_of(message["tool_call_id"])
        ids = (self._window.result_of(call["id"]) for call in calls_of(message))
        return next((number for number in ids if number is not None), None)

    def _is_kept(self, group: Sequence[Place]) -> bool:
        numbers = [number for place in group if (number := self._number(place)) is not None]
        return any(
            number < self._window.starts[0] or self._window.turn_of(number) in self._agent.always for number in numbers
        )

    def _group_tokens(self, group: Sequence[Place]) -> int:
        forms = [*self._history.walk(joined(group))]
        if not any(isinstance(place, Form) for place in group):
            return self._tokens(forms)
        return sum(shown.tokens for shown in self._agent.group(forms))
