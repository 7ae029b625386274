"""HostHistory: what a host's own summaries cost, beside a window that decides what the model sees.

A host that shortens its messages changes no prompt, but its summary may be a model call that no budget counts, so it is
logged once.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Generic, TypeVar

from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.visible import logger

log = logger("smartplay_tools.conversation")

T = TypeVar("T")

COST = "Each summary is a model call with at least these tokens, which you pay for and the budget does not count."
IN_VAIN = f"{COST} Leave it out."


class HostHistory(Generic[T]):
    """The messages of a host, watched for what leaves them; a turn costs the same at any length.

    Arguments:
        counter: counts the tokens of what has left.
        read: returns what tells a message from others, and its text.
        cost: says what the summaries cost.
    """

    def __init__(
        self, counter: TokenCounter, read: Callable[[T], tuple[Hashable, str]], *, cost: str = IN_VAIN
    ) -> None:
        self._counter, self._read, self._cost = counter, read, cost
        self._latest: Sequence[T] = ()
        self._is_told = False

    def begin_again(self) -> None:
        """Forget the messages: the next ones are those of another run."""
        self._latest = ()

    def see(self, messages: Sequence[T]) -> None:
        """Look at the host's messages; the first time that some are gone, log how many, and their tokens."""
        before, self._latest = self._latest, messages
        if self._is_told or not before:
            return
        last = len(before) - 1  # where a list that only grows has what it had
        if last < len(messages) and self._read(messages[last])[0] == self._read(before[last])[0]:
            return
        there = {self._read(message)[0] for message in messages}
        gone = [text for key, text in map(self._read, before) if key not in there]
        if not gone:
            return
        self._is_told, self._latest = True, ()
        log.warning(
            "%d messages with %d tokens of text have left the agent's own list: it summarises or trims them. The model "
            "still sees the window. %s",
            len(gone),
            sum(self._counter.text(text) for text in gone),
            self._cost,
        )
