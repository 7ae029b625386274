"""Call ids: a unique id for each call of a conversation, even where the model repeats ids or leaves them empty.

Providers, agent frameworks and hosts need unique ids to match a result with its call. Ids are assigned only here. A
model's id is kept if it is unique, not empty and of ASCII characters, because some chat templates print ids; otherwise
the call gets an id of nine letters and digits, the only form that Mistral accepts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence


class CallIds:
    """The ids that are taken in a conversation."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def reserve(self, ids: Iterable[str]) -> None:
        """Take the ids of the example calls in a head, which keep their ids."""
        self._taken.update(ids)

    def take(self, sent: Sequence[str], turn: int) -> list[str]:
        """Return an id for every call of a turn: the one that the model sent, if it can be used and is not taken."""
        return [self._take(call_id, turn, position) for position, call_id in enumerate(sent)]

    def _take(self, sent: str, turn: int, position: int) -> str:
        call_id, attempt = sent if sent.isascii() else "", 0
        while not call_id or call_id in self._taken:
            call_id = f"{_LETTERS[attempt % len(_LETTERS)]}{(turn * 1_000 + position) % 10**8:08d}"
            attempt += 1
            position += 1_000_000 * (attempt // len(_LETTERS))
        self._taken.add(call_id)
        return call_id


_LETTERS = "cabdefghijklmnopqrstuvwxyz"
