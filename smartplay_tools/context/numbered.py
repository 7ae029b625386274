"""Messages by number: every message of a conversation as a prompt would show it now, with running sums of tokens.

A turn changes only the messages that become too old by it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate, pairwise

from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.context.view import Piece, Selection
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.messages import Message, pictures_of, text_of


class NumberedMessages:
    """The messages of a conversation, each at its level."""

    def __init__(
        self, budget: ResolvedBudget, counter: TokenCounter, strategies: Strategies, lead: Sequence[Message]
    ) -> None:
        """`lead` are messages before the first turn."""
        self.budget, self.counter, self.strategies = budget, counter, strategies
        self.turns: list[Turn] = []
        """Every turn that was appended."""
        self.now: list[Form] = list(map(Form, lead))
        """Every message by its number, as a prompt shows it now."""
        self.starts = [len(lead)]
        """The number of the first message of each turn, and the number that comes next."""
        self.oldest = self.trimmed_before = self.elided = 0
        """What decides the levels of all messages, as in a `Selection`."""
        self._sums, self._places, self._aged = [0], [0], 0
        """The tokens of the messages, and of the turns, before each, as far as they are counted; how many turns age no
        more."""
        self._results: dict[str, int] = {}
        self._read = 0
        """The numbers of results by the ids of their calls, and how many messages were looked at for them."""

    def add(self, turn: Turn) -> None:
        """Add a complete turn."""
        if turn.reply_tokens is not None:
            turn.whole[0].is_counted(self.counter, turn.reply_tokens)
        self.turns.append(turn)
        self.now += turn.seen(self.oldest, trimmed_before=self.trimmed_before, elided=self.elided)
        self.starts.append(len(self.now))

    def back_to(self, turn: int) -> None:
        """Forget the turns from one on."""
        start = self.starts[turn]
        del self.turns[turn:], self.now[start:], self._sums[start + 1 :]
        del self.starts[turn + 1 :], self._places[turn + 1 :]
        self._aged, self._read = min(self._aged, turn), min(self._read, start)

    def age(self, oldest: int, trimmed_before: int = 0, elided: int = 0) -> None:
        """Give every message the level that these ages mean."""
        ages = oldest, trimmed_before, elided
        if ages == (before := (self.oldest, self.trimmed_before, self.elided)):
            return
        if any(age < was for age, was in zip(ages, before, strict=True)):  # only where a record is read
            self._aged = 0
        self.oldest, self.trimmed_before, self.elided = ages
        latest, most = max(oldest, trimmed_before, *before[:2]), max(elided, before[2])
        for index in range(self._aged, len(self.turns)):
            turn, start, stop = self.turns[index], self.starts[index], self.starts[index + 1]
            seen = list(turn.seen(oldest, trimmed_before=trimmed_before, elided=elided))
            if seen != self.now[start:stop]:
                self.now[start:stop] = seen
                del self._sums[start + 1 :]
            pictures = turn.pictures_so_far
            if index == self._aged and self._is_settled(turn, pictures):
                self._aged += 1
            if turn.step >= latest and pictures >= most:
                break  # no later turn was shown in part, or is

    def _is_settled(self, turn: Turn, pictures: int) -> bool:
        """Whether no message of a turn changes its level any more; `pictures` are those up to its end."""
        if self.budget.history is not None and turn.step >= self.oldest:
            return False
        if self.strategies.trimming is not None and turn.step >= self.trimmed_before:
            return False
        return self.strategies.eliding is None or pictures <= self.elided

    def tokens(self, row: range) -> int:
        """Return the tokens of messages in a row as a prompt shows them now."""
        sums, stop = self._sums, row.stop
        if len(sums) <= stop:
            sizes = [form.tokens(self.counter) for form in self.now[len(sums) - 1 : stop]]
            sums[-1:] = accumulate(sizes, initial=sums[-1])
        return sums[stop] - sums[row.start]

    @property
    def places(self) -> Sequence[int]:
        """The tokens of all turns before each, whole, and those of all: their places on the grid."""
        for turn in self.turns[len(self._places) - 1 :]:
            self._places.append(self._places[-1] + self._sum(turn.whole))
        return self._places

    def turn_tokens(self, turn: int) -> int:
        """Return the tokens of a turn as a prompt shows it now."""
        return self.tokens(self.row(turn, turn + 1))

    def row(self, first: int, stop: int) -> range:
        """Return the numbers of the messages of the turns from one to before another."""
        return range(self.starts[first], self.starts[stop])

    def turns_of(self, row: range) -> range:
        """Return the turns that messages in a row belong to."""
        return range(max(self.turn_of(row.start), 0), self.turn_of(row.stop - 1) + 1)

    def turn_of(self, number: int) -> int:
        """Return the turn of a message; -1 for messages before the first turn."""
        return bisect_right(self.starts, number) - 1

    def item(self, number: int) -> Item | None:
        """Return the item that a message is; None for replies, and for messages before the first one."""
        turn = self.turn_of(number)
        place = number - self.starts[turn]
        return self.turns[turn].items[place - 1] if turn >= 0 and place else None

    def result_of(self, call_id: str) -> int | None:
        """Return the number of the result of a call of the conversation; None for another id."""
        for number in range(self._read, len(self.now)):
            message = self.now[number].message
            if message["role"] == "tool":
                self._results[message["tool_call_id"]] = number
        self._read = len(self.now)
        return self._results.get(call_id)

    def pieces(self, turns: Iterable[range], texts: Mapping[int, Form]) -> list[Piece]:
        """Return the messages of rows of turns, with texts before some turns."""
        pieces: list[Piece] = []
        for row in turns:
            edges = [*sorted({row.start, *(turn for turn in texts if turn in row)}), row.stop]
            for first, stop in pairwise(edges):
                if first in texts:
                    pieces.append(texts[first])
                pieces.append(self.row(first, stop))
        return pieces

    def forms(self, chosen: Selection) -> list[Form]:
        """Return the messages that a selection shows, as they are now."""
        forms: list[Form] = []
        hidden = {*chosen.masked} if chosen.pinned is None else {*chosen.masked, chosen.pinned}
        for piece in chosen.pieces:
            if isinstance(piece, Form):
                forms.append(self.text(piece))
            elif hidden and not hidden.isdisjoint(turns := self.turns_of(piece)):
                for turn in turns:
                    now = self.now[self.starts[turn] : self.starts[turn + 1]]
                    forms += chosen.seen(self.turns[turn]) if turn in hidden else now
            else:
                forms += self.now[piece.start : piece.stop]
        return forms

    def text(self, form: Form) -> Form:
        """Return a strategy's own message as it is shown: a result has the date of its call, whatever it says."""
        message = form.message
        number = self.result_of(message["tool_call_id"]) if message["role"] == "tool" else None
        if number is None or (item := self.item(number)) is None:
            return form
        now = self.now[number].message
        if now is item.message or not ((is_masked := now is item.masked) or pictures_of(message)):
            return form
        text = "" if is_masked else text_of(message)
        return Form({**message, "content": text or item.masked["content"]})

    def masked_tokens(self, turn: int) -> int:
        """Return the tokens of a turn with every observation masked."""
        return self._sum(self.turns[turn].seen(self.turns[turn].step + 1, trimmed_before=self.trimmed_before))

    def _sum(self, forms: Iterable[Form]) -> int:
        return sum([form.tokens(self.counter) for form in forms])
