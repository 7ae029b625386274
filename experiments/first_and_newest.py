"""First and newest: a strategy that keeps the first turns, and the newest ones that fit beside them."""

import smartplay_tools as sp


class FirstAndNewest:
    """Shows the first turns and the newest ones; what lies between them leaves."""

    def __init__(self, turns: int = 1) -> None:
        """`turns` is how many of the first turns are kept."""
        self._first = turns

    def choose(self, past: sp.Past, room: int | None) -> sp.Choice:
        """Take the first turns, then the newest, until one does not fit."""
        chosen: list[int] = []
        newest_first = range(len(past.turns) - 1, self._first - 1, -1)
        for number in (*range(self._first), *newest_first):
            turn = past.turns[number] if number < len(past.turns) else None
            if turn is None or turn.is_pinned:
                continue
            if room is not None:
                if turn.tokens > room:
                    break
                room -= turn.tokens
            chosen.append(number)
        return sp.Choice(chosen)
