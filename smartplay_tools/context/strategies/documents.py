"""Documents: the observations of an episode as texts that can be searched, each as the first result showed it.

They are read into an index of words as turns are added, so that the first search of a long episode takes no longer than
the next one. Observations repeat, so texts are indexed once: documents that differ only in their steps share one.
Scores are BM25 over the documents that a prompt does not show; the others count as empty.
"""

from __future__ import annotations

import math
import re
from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.context.turns import Turn
from smartplay_tools.context.view import View, ranges_of
from smartplay_tools.types.arguments import number_as_text
from smartplay_tools.types.messages import text_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

K1, B = 1.2, 0.75
"""How soon repetitions of a word stop counting, and how much the length of a document counts."""
DECIMALS = 9
"""The decimals to which scores are rounded, so that they order documents alike on every machine."""
BATCH = 32
"""How many of the best documents are sorted at first."""
WORD = re.compile(r"[^\W_]+")
STEP = re.compile(r"0|[1-9][0-9]{0,17}")
"""A step as a word."""


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
        self._text_of = array("i")
        """The index of each document's text in `_texts`."""
        self._words_before = [0]
        """The number of words in the documents before each."""
        self._texts: list[str] = []
        """The texts, each what follows the step in its documents."""
        self._numbers: dict[str, int] = {}
        """The index of each text."""
        self._counts, self._lengths = array("d"), array("d")
        """For each text, the number of its documents, and the number of words in each of these."""
        self._places: dict[str, array[int]] = defaultdict(lambda: array("i"))
        """For each word, the texts that have it, as often as they have it; a step is not in a text."""

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
        number = self._numbers.get(text)
        if number is None:
            number = self._numbers[text] = len(self._texts)
            self._texts.append(text)
            words = WORD.findall(f"{self._before}{text}")
            for word in words:
                self._places[word.lower()].append(number)
            self._counts.append(0)
            self._lengths.append(len(words) + 1)  # and the step
        self._counts[number] += 1
        self.steps.append(step)
        self._text_of.append(number)
        self._words_before.append(self._words_before[-1] + int(self._lengths[number]))

    def __getitem__(self, number: int) -> str:
        return f"{self._before}{self.steps[number]}{self._texts[self._text_of[number]]}"

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

        left = len(self.steps) - sum(map(len, shown))
        if not left:
            return
        scores = self._scores(query, shown, left)
        for each in shown:
            scores[each.start : each.stop] = 0
        matching = np.flatnonzero(scores)
        values = scores[matching]
        given, size = 0, BATCH
        while given < len(matching):
            numbers, keys = matching, values
            if size < len(matching):
                edge = np.partition(values, -size)[-size]
                above = np.flatnonzero(values > edge)
                ties = np.flatnonzero(values == edge)[len(above) - size :]
                chosen = np.concatenate([above, ties])
                numbers, keys = matching[chosen], values[chosen]
            ranked = sorted(zip((-keys).tolist(), (-numbers).tolist(), strict=True))
            yield from (-number for _, number in ranked[given:])
            given, size = len(ranked), 4 * size

    def _scores(self, query: str, shown: Sequence[range], left: int) -> NDArray[np.float64]:
        """The score of every document, rounded, where `left` of them are not shown; those shown have any."""
        import numpy as np

        words = self._words_before[-1] - sum(self._words_before[r.stop] - self._words_before[r.start] for r in shown)
        norm = K1 * (1 - B + B * np.frombuffer(self._lengths) / (words / left))
        text_of, texts = np.frombuffer(self._text_of, np.intc), len(self._texts)
        counts = np.array(self._counts)
        for each in shown:
            counts -= np.bincount(text_of[each.start : each.stop], minlength=texts)
        scores = np.zeros(texts)
        weights: list[tuple[int | None, float, NDArray[np.intp]]] = []
        for word in dict.fromkeys(word.lower() for word in WORD.findall(query)):
            places = self._places.get(word)
            named = self._named(word, shown)
            if places is None and named is None:
                continue
            times = np.bincount(np.frombuffer(places or array("i"), np.intc), minlength=texts)
            having = counts[times > 0].sum() + (named is not None and times[text_of[named]] == 0)
            idf = math.log(1 + (left - having + 0.5) / (having + 0.5))
            scores += idf * (times * (K1 + 1) / (times + norm))
            weights.append((named, idf, times))
        result: NDArray[np.float64] = np.round(scores, DECIMALS)[text_of]
        for document in {named for named, _, _ in weights if named is not None}:
            score, text = 0.0, text_of[document]
            for named, idf, by_text in weights:
                times_here = by_text[text] + (named == document)
                score += idf * (times_here * (K1 + 1) / (times_here + norm[text]))
            result[document] = np.round(score, DECIMALS)
        return result

    def _named(self, word: str, shown: Sequence[range]) -> int | None:
        """The document, not among those shown, whose step a word of a query is."""
        if not STEP.fullmatch(word):
            return None
        number = bisect_left(self.steps, int(word))
        if number == len(self.steps) or self.steps[number] != int(word) or any(number in each for each in shown):
            return None
        return number


def _call(turn: Turn, position: int) -> str:
    """The call that showed an observation, as it was played."""
    call = turn.calls[position]
    if call.name != "act" or call.arguments.values is None:
        return f"{call.name}()"
    return f'act("{number_as_text(call.arguments.values["action"]).strip()}")'
