"""An index of tokens: what every turn costs, whole and masked.

Turns are only appended, so running sums suffice: the tokens of consecutive turns are the difference of two sums. Steps
never decrease from turn to turn. So the first turn that is not older than a given step is found by bisection. This turn
is the boundary: every earlier turn is masked whole, every later turn is shown whole, and only the boundary can be
masked in part.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence

from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Form, Turn


class TokenIndex:
    """The turns of a conversation with their tokens; every query takes at most a bisection."""

    def __init__(self, counter: TokenCounter, *, with_words: bool = False, with_pictures: bool = False) -> None:
        """`with_words` says whether replies become bare, `with_pictures` whether old pictures are left out.

        The tokens saved are counted only in these cases.
        """
        self._with_words, self._with_pictures = with_words, with_pictures
        self._unpictured, self._pictures = [0], list[int]()
        """The tokens of the pictures before each turn, and the number of pictures up to the end of each turn."""
        self._spoken = [0]
        """The tokens of the words in the replies before each turn."""
        self.turns: list[Turn] = []
        self._steps: list[int] = []
        self._counter = counter
        self.whole, self._masked = [0], [0]
        """Running sums: tokens of the turns before each, with no observation masked, and with all of them masked."""
        self._forms: list[Form] = []
        self._starts = [0]
        """Every message, unmasked, and how many are before each turn."""

    def append(self, turn: Turn) -> None:
        """Add a turn."""
        self.whole.append(self.whole[-1] + turn.tokens(self._counter))
        if self._with_words:
            self._spoken.append(self._spoken[-1] + turn.spoken(self._counter))
        if self._with_pictures:
            count = turn.first_picture + len(turn.pictured)
            self._unpictured.append(self._unpictured[-1] + self.saved(turn, 0, count))
            self._pictures.append(count)
        self._forms += turn.whole
        self._starts.append(len(self._forms))
        self.turns.append(turn)
        self._steps.append(turn.step)

    @property
    def masked(self) -> Sequence[int]:
        """Running sums as `whole`, with all observations masked; summed up when asked for, since few windows mask."""
        for turn in self.turns[len(self._masked) - 1 :]:
            self._masked.append(self._masked[-1] + turn.tokens(self._counter) - self.saved(turn, turn.step + 1))
        return self._masked

    def forms(self, first: int, stop: int) -> list[Form]:
        """Return the messages of the turns from `first` to before `stop`, with no observation masked."""
        return self._forms[self._starts[first] : self._starts[stop]]

    def spoken(self, first: int, stop: int) -> int:
        """Tokens of the words in replies from `first` to before `stop`, which bare replies save."""
        return self._spoken[stop] - self._spoken[first] if first < stop else 0

    def unpictured(self, first: int, stop: int) -> int:
        """Tokens of the pictures in turns from `first` to before `stop`, of which no observation is masked."""
        return self._unpictured[stop] - self._unpictured[first] if first < stop else 0

    def first_pictured(self, pictures: int) -> int:
        """The first turn with a picture after the first `pictures`; the number of turns if there is none."""
        return bisect_right(self._pictures, pictures)

    def saved(self, turn: Turn, oldest: int, pictures: int = 0) -> int:
        """Tokens saved by masking a turn's observations before `oldest`, and leaving out pictures of the others.

        The number is negative if the marker is longer than what it replaces.
        """
        tokens, old = 0, turn.masked(oldest)
        for at in old:
            item = turn.items[at]
            tokens += self._counter.content(item.message) - self._counter.text(item.words("observation_left"))
        if pictures:
            for item in [turn.items[at] for at in turn.left_out(pictures) if at not in old]:
                tokens += self._counter.content(item.message) - self._counter.content(item.unpictured)
        return tokens

    def first_from(self, step: int) -> int:
        """The first turn that is not older than a step; the number of turns if there is none."""
        return bisect_left(self._steps, step)
