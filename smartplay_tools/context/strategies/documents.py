"""Documents: the observations of an episode as texts that can be searched, each as the first result showed it.

Their words are indexed as turns are added, so that the first search of a long episode takes no longer than the next
one. Scores are BM25 over the documents that a prompt does not show.
"""

from __future__ import annotations

import math
import re
from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Sequence

from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import View, ranges_of
from smartplay_tools.types.arguments import number_as_text
from smartplay_tools.types.messages import text_of

K1, B = 1.2, 0.75
"""How soon repetitions of a word stop counting, and how much the length of a document counts."""
DECIMALS = 9
"""The decimals to which scores are rounded, so that they order documents alike on every machine."""
WORD = re.compile(r"[^\W_]+")


class Documents:
    """The documents of an episode, in the order of their steps.

    Arguments:
        before: what every document says before its step.
        after: what a document that is read says after it, with `{call}` and `{observation}`.
    """

    def __init__(self, before: str, after: str = "") -> None:
        self._before, self._after = before, after
        self.steps: list[int] = []
        """The observation that each document shows."""
        self._turns = 0
        """How many turns have been read."""
        self._texts: list[str] = []
        """What each document says after its step."""
        self._lengths = array("d")
        """The number of words in each document."""
        self._places: dict[str, array[int]] = defaultdict(lambda: array("i"))
        """For each word, the documents that have it, as often as they have it."""

    def read(self, turns: Sequence[Turn]) -> None:
        """Add what the turns show that have not been read."""
        for turn in turns[self._turns :]:
            for item in turn.items:
                step = item.observation_step
                if step is not None and (not self.steps or step > self.steps[-1]):
                    assert item.position is not None
                    call, observation = _call(turn, item.position), without_budget_line(text_of(item.message))
                    self.add(step, self._after.format(call=call, observation=observation))
        self._turns = len(turns)

    def add(self, step: int, text: str) -> None:
        """Add a document: its step, which is higher than those before, and the text that follows the step."""
        self.steps.append(step)
        self._texts.append(text)
        number = len(self._texts) - 1
        words = WORD.findall(self[number])
        self._lengths.append(len(words))
        for word in words:
            self._places[word.lower()].append(number)

    def __getitem__(self, number: int) -> str:
        return f"{self._before}{self.steps[number]}{self._texts[number]}"

    def shown_by(self, view: View) -> list[range]:
        """Return the documents whose observations a view shows, as ascending ranges."""
        steps = sorted({form.step for form in view.forms if form.step is not None})
        return [range(first, last + 1) for first, last in ranges_of(bisect_left(self.steps, step) for step in steps)]

    def between(self, first: int, last: int, shown: Sequence[range]) -> Iterator[int]:
        """Yield the documents of the steps from `first` to `last` that are not among those shown."""
        for number in range(bisect_left(self.steps, first), bisect_left(self.steps, last + 1)):
            if not any(number in each for each in shown):
                yield number

    def best(self, query: str, shown: Sequence[range]) -> Iterator[int]:
        """Yield the documents with a word of a query that are not among those shown, by their scores, best first.

        Of equal scores, newer documents come first.
        """
        import numpy as np  # the games have it loaded

        count = len(self.steps)
        is_left = np.ones(count, bool)
        for each in shown:
            is_left[each.start : each.stop] = False
        left, lengths = np.count_nonzero(is_left), np.array(self._lengths)
        if not left:
            return
        norm = K1 * (1 - B + B * lengths / (lengths[is_left].sum() / left))
        scores = np.zeros(count)
        for word in dict.fromkeys(word.lower() for word in WORD.findall(query)):
            if (places := self._places.get(word)) is not None:
                times = np.bincount(np.array(places), minlength=count)
                having = np.count_nonzero(times[is_left])
                idf = math.log(1 + (left - having + 0.5) / (having + 0.5))
                scores += idf * (times * (K1 + 1) / (times + norm))
        scores = np.round(scores, DECIMALS) * is_left
        matching = np.flatnonzero(scores)
        yield from matching[np.lexsort((-matching, -scores[matching]))].tolist()


def _call(turn: Turn, position: int) -> str:
    """The call that showed an observation, as it was played."""
    call = turn.calls[position]
    if call.name != "act" or call.arguments.values is None:
        return f"{call.name}()"
    return f'act("{number_as_text(call.arguments.values["action"]).strip()}")'
