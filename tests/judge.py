"""An independent judge of views under every strategy: slow, obvious, each view decided from scratch.

It imports nothing of the package but is given plain data: the turns of `tests/checker.py`, the budget as a dictionary,
`n`, which counts the tokens of a text, and the summaries that were shown. The definition that it is written from is
`docs/budgets.md` and `docs/strategies.md`. What follows from the first k turns is computed once.
"""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Callable, Sequence
from fractions import Fraction
from importlib import resources
from itertools import accumulate
from typing import Any

from tests.counting import message_tokens, picture_tokens, plain_text, tools_tokens

MARKER = "[observation left the history window]"
PICTURE = "The picture shows the current observation."
PRIMING = 3
Json = dict[str, Any]
Count = Callable[[str], int]
TEXTS = tomllib.loads((resources.files("smartplay_tools.context.prompts") / "v1.toml").read_text(encoding="utf-8"))
FRAME, ASKED = f"{TEXTS['summary']}\n", TEXTS["summary_request"]


def without_words(reply: Json) -> Json:
    """A reply with its calls alone, if it has calls, and anything that is said or reasoned beside them."""
    is_said = plain_text(reply.get("content")) or reply.get("reasoning_content") or reply.get("provider_items")
    if not reply.get("tool_calls") or not is_said:
        return reply
    name = {"name": reply["name"]} if reply.get("name") else {}
    return {"role": "assistant", "content": None, **name, "tool_calls": reply["tool_calls"]}


def has_picture(message: Json) -> bool:
    return picture_tokens(message["content"]) > 0


class Judge:
    """Views of the first `k` turns, for any k, and the requests for summaries before them."""

    def __init__(
        self,
        head: list[Json],
        tools: list[Json],
        turns: list[Json],
        budget: Json,
        n: Count,
        summaries: Sequence[tuple[int, str]] = (),
        choices: dict[int, Any] | None = None,
    ) -> None:
        self.n = functools.cache(n)
        self.original_head, self.tools, self.turns = head, tools, turns
        self.history, self.cap = budget["history"], budget["prompt_tokens"]
        self.slack = Fraction(str(budget["slack"]))
        self.masks = budget.get("beyond_history", "drop") == "mask"
        self.ages_by_turn = budget.get("stalled_turns") is not None and self.history is not None and not self.masks
        self.first_turns = budget.get("first_turns") or 0
        self.words_kept, self.pictures_kept = budget.get("own_words"), budget.get("newest_pictures")
        self.notes_cap, self.summary_cap = budget.get("notes_tokens"), budget.get("summary_tokens")
        self.summaries = list(summaries)
        """(turns at the time, text shown from then on) of every summary."""
        self.choices = choices
        """With a custom strategy: (turns, masked turns, texts by turn) that it chose after k turns."""
        self.newest = functools.cache(self._newest)
        """t: the index of the newest observation that k turns have shown."""
        self.step = functools.cache(self._step)
        """The step of a turn: of its newest item, or the step at which it was made if it has none."""
        self.boundary = functools.cache(self._boundary)
        """b: after k turns, an observation below it is masked."""
        self.words_from = functools.cache(self._words_from)
        """w: after k turns, a reply of a turn that is older than it has its calls alone."""
        self.pictures_from = functools.cache(self._pictures_from)
        """p: of all the pictures that k turns have shown, the first p are left out."""
        self.current = functools.cache(self._current)
        """o: the latest turn that shows t."""
        self.noted = functools.cache(self._noted)
        """q: the newest turn with accepted notes, unless they were cleared since."""
        self.anchors = functools.cache(self._anchors)
        """a: how many of the first turns are pinned: the longest beginning that fits beside the other pins."""
        self.notes_fit = functools.cache(self._notes_fit)
        """Whether the notes are pinned after k turns."""
        self.first = functools.cache(self._first)
        """f: the first turn of the run after k turns."""
        self.whole = functools.cache(lambda i: self.tokens(self.turns[i]["messages"]))
        """What a turn takes as it was first shown."""
        self._costs: dict[Any, int] = {}

    # What is old.

    def _newest(self, k: int) -> int:
        return max((o for turn in self.turns[:k] for o in turn["shows"] if o is not None), default=0)

    def _step(self, i: int) -> int:
        made = self.turns[i]["made"]
        return max(made[1:], default=made[0])

    def _boundary(self, k: int) -> int:
        return 0 if self.history is None else self.moved(self.newest(k), self.history)

    def _words_from(self, k: int) -> int:
        if self.words_kept == "never":
            return self.newest(k) + 1
        return 0 if self.words_kept is None else self.moved(self.newest(k), self.words_kept)

    def _pictures_from(self, k: int) -> int:
        shown = sum(has_picture(one) for turn in self.turns[:k] for one in turn["messages"])
        return self.moved(shown - 1, self.pictures_kept - 1) if self.pictures_kept is not None and shown else 0

    def moved(self, n: int, most: int) -> int:
        """The smallest multiple of a block that is at most `most` behind n."""
        block, boundary = 1 + math.floor(self.slack * most), 0
        while n - boundary > most:
            boundary += block
        return boundary

    def plays_no_step(self, i: int) -> bool:
        return self.step(i) == (self.step(i - 1) if i else 0)

    def outlived(self, i: int, k: int) -> bool:
        """Whether a turn without a step is followed directly by too many of its like."""
        if not self.ages_by_turn or not self.plays_no_step(i):
            return False
        begin, stop = i, i + 1
        while begin > 0 and self.plays_no_step(begin - 1):
            begin -= 1
        while stop < k and self.plays_no_step(stop):
            stop += 1
        return i - begin < self.moved(stop - begin - 1, self.history)

    # What is pinned.

    def _current(self, k: int) -> int | None:
        t = self.newest(k)
        return max((i for i in range(k) if t in self.turns[i]["shows"]), default=None)

    def _noted(self, k: int) -> int | None:
        latest = None
        for i in range(k):
            for notes in self.turns[i].get("notes", ()):
                latest = i if notes.strip() else None
        return latest

    # What it costs.

    def seen(self, i: int, k: int, hidden: bool = False) -> list[Json]:
        """A turn's messages as they are shown; `hidden`, with every observation masked."""
        turn, b = self.turns[i], self.boundary(k)
        messages = [
            {**one, "content": MARKER} if date is not None and (hidden or date < b) else one
            for one, date in zip(turn["messages"], turn["dates"], strict=True)
        ]
        p = self.pictures_from(k)
        number = sum(has_picture(one) for turn in self.turns[:i] for one in turn["messages"]) if p else 0
        for m, one in enumerate(turn["messages"]):
            if p and has_picture(one):
                number += 1
                if number <= p and messages[m]["content"] != MARKER:
                    words = plain_text(one["content"])
                    messages[m] = {**one, "content": words if words and not words.startswith(PICTURE) else MARKER}
        if self.step(i) < self.words_from(k):
            messages[0] = without_words(messages[0])
        return messages

    def tokens(self, messages: Sequence[Json]) -> int:
        return sum(message_tokens(message, self.n) for message in messages)

    def cost(self, i: int, k: int, hidden: bool = False) -> int:
        key = (i, self.boundary(k), self.words_from(k), self.pictures_from(k), hidden)
        if key not in self._costs:
            self._costs[key] = self.tokens(self.seen(i, k, hidden))
        return self._costs[key]

    def head(self, k: int) -> list[Json]:
        read = [turn["manual"] for turn in self.turns[:k] if turn["manual"] is not None]
        if not read:
            return self.original_head
        system, *others = self.original_head
        return [{**system, "content": system["content"] + "\n\n" + read[0]}, *others]

    def frame(self, k: int) -> int:
        """Head, schemas and priming."""
        key = ("head", len(self.head(k)[0]["content"]))
        if key not in self._costs:
            self._costs[key] = self.tokens(self.head(k)) + tools_tokens(self.tools, self.n) + PRIMING
        return self._costs[key]

    def _anchors(self, k: int) -> int:
        a, notes = 0, k > 0 and self.notes_fit(k)
        while a < min(self.first_turns, k - 1):
            size = self.size(k - 1, k, notes=notes, anchors=a + 1)
            if self.cap is not None and size + self.reserve > self.cap:
                break
            a += 1
        return a

    def layout(self, first: int, k: int, *, notes: bool, anchors: int | None = None) -> list[tuple[int, bool]]:
        """The turns of a view that begins at `first`, and whether each is hidden."""
        o, q = self.current(k), self.noted(k) if notes else None
        before = {o, q, *(range(self.anchors(k)) if anchors is None else range(anchors))} - {None}
        pins = [(i, i == q and i != o) for i in sorted(i for i in before if i is not None and i < first)]
        return [*pins, *((i, False) for i in range(first, k))]

    def size(self, first: int, k: int, *, notes: bool, anchors: int | None = None) -> int:
        """V: head, pins and run, without a summary."""
        layout = self.layout(first, k, notes=notes, anchors=anchors)
        return self.frame(k) + sum(self.cost(i, k, hidden) for i, hidden in layout)

    # Summaries.

    @functools.cached_property
    def question(self) -> Json:
        return {"role": "user", "content": ASKED.replace("{tokens}", str(self.summary_cap))}

    @property
    def asking(self) -> int:
        """A."""
        return 0 if self.summary_cap is None else self.tokens([self.question])

    @property
    def reserve(self) -> int:
        """R = A + S."""
        if self.summary_cap is None:
            return 0
        return self.asking + 3 + self.n("user") + self.n(FRAME) + self.summary_cap

    def summary(self, k: int) -> list[Json]:
        """The summary's message in a view of k turns: the latest that was asked for until then."""
        texts = [text for turn, text in self.summaries if turn <= k]
        return [{"role": "user", "content": FRAME + texts[-1]}] if texts and texts[-1] else []

    # The first turn.

    def _notes_fit(self, k: int) -> bool:
        return self.cap is None or self.size(k - 1, k, notes=True, anchors=0) + self.reserve <= self.cap

    def overflows(self, k: int) -> bool:
        """Whether there is no Fill."""
        size = self.size(k - 1, k, notes=self.notes_fit(k), anchors=0)
        return self.cap is not None and size + self.reserve > self.cap

    def fill(self, k: int) -> int:
        """f: where Fill stops, and with slack the first turn of a block from there on."""
        notes, i = self.notes_fit(k), k - 1
        while i > 0 and not self.too_old(i - 1, k):
            if self.cap is not None and self.size(i - 1, k, notes=notes) + self.reserve > self.cap:
                return self.begin_of_block(i, k)
            i -= 1
        return i

    def too_old(self, i: int, k: int) -> bool:
        old = not self.masks and self.history is not None and self.step(i) < self.boundary(k)
        return old or self.outlived(i, k)

    def begin_of_block(self, i: int, k: int) -> int:
        block = max(1, math.floor(self.slack * (self.cap - self.reserve - self.frame(k))))
        blocks = [place // block for place in accumulate((self.whole(j) for j in range(k)), initial=0)]
        while i < k - 1 and blocks[i] == blocks[i - 1]:
            i += 1
        return i

    def pins_fit(self, k: int) -> bool:
        return k == 0 or not self.overflows(k)

    def _first(self, k: int) -> int:
        if k == 0:
            return 0
        return k - 1 if self.overflows(k) else self.fill(k)

    def asks(self, k: int) -> bool:
        """Whether a summary is asked for before the prompt of turn k."""
        return (
            self.summary_cap is not None
            and k > 0
            and self.pins_fit(k)
            and self.first(k) > max(*map(self.first, range(k)), self.anchors(k))
        )

    # Views.

    def shown(self, k: int, stop: int | None = None) -> list[tuple[int, bool]]:
        """The turns of the view of k turns, or of that part of it that lies before turn `stop`."""
        if self.choices is not None:
            return self.chosen(k)
        turns = self.layout(self.first(k), k, notes=k > 0 and self.notes_fit(k))
        return [(i, hidden) for i, hidden in turns if stop is None or i < stop]

    def chosen(self, k: int) -> list[tuple[int, bool]]:
        """The turns that a custom strategy shows after k turns, with the pinned ones, and whether each is hidden."""
        if k == 0:
            return []
        turns, masked, _ = self.choices.get(k, ((), (), {}))
        o, q = self.current(k), self.noted(k) if self.notes_fit(k) else None
        shown = {k - 1, *turns} | ({o, q} - {None})
        return [(i, i in masked or (i == q and i not in (o, k - 1))) for i in sorted(shown)]

    def texts(self, k: int) -> dict[int, str]:
        """The texts of a custom strategy, by the turn before which each stands."""
        return {} if self.choices is None or k not in self.choices else self.choices[k][2]

    def traced(self, k: int, stop: int | None = None) -> list[tuple[int, int, Json]]:
        """The messages of a view, each with its turn and its place in it; the head is turn -2, the summary turn -1."""
        body = []
        for i, hidden in self.shown(k, stop):
            if i in self.texts(k):
                body.append((i, -1, {"role": "user", "content": self.texts(k)[i]}))
            body += [(i, m, one) for m, one in enumerate(self.seen(i, k, hidden))]
        summary = [(-1, 0, one) for one in self.summary(k)]
        front = min(self.anchors(k), self.first(k)) if self.choices is None else 0
        ahead, after = [one for one in body if one[0] < front], [one for one in body if one[0] >= front]
        return [*((-2, m, one) for m, one in enumerate(self.head(k))), *ahead, *summary, *after]

    def size_of_view(self, k: int) -> int:
        """The tokens of a prompt to play, whether or not it fits."""
        messages = [one for _, _, one in self.traced(k)]
        return self.tokens(messages) + tools_tokens(self.tools, self.n) + PRIMING

    def view(self, k: int) -> Json | None:
        """Everything that the prompt to play says after k turns; None where the pinned parts do not fit."""
        if not self.pins_fit(k):
            return None
        return self._prompt_of(self.traced(k), self.shown(k), k, k) | {"prefix_tokens": self.prefix(k)}

    def request(self, k: int) -> Json:
        """The prompt for a summary after k turns: the last one without the turns that stay, and the question."""
        stop = self.first(k)
        traced = self.traced(k - 1, stop)
        prompt = self._prompt_of([*traced, (-3, 0, self.question)], self.shown(k - 1, stop), k - 1, k - 1)
        return prompt | {"prefix_tokens": prompt["tokens"] - self.asking - PRIMING, "covers": stop}

    def is_marked(self, i: int, m: int, one: Json) -> bool:
        """Whether a message reads as the marker in place of what it said."""
        return one is not self.turns[i]["messages"][m] and one["content"] == MARKER

    def _prompt_of(
        self, traced: list[tuple[int, int, Json]], shown: list[tuple[int, bool]], k: int, turns: int
    ) -> Json:
        body = [(i, m, one) for i, m, one in traced if i >= 0 and m >= 0]
        marked = [[i, m - 1] for i, m, one in body if m and self.is_marked(i, m, one)]
        seen = {self.turns[i]["shows"][m] for i, m, one in body if [i, m - 1] not in marked} - {None}
        if self.first_turns and self.choices is None:
            # Anchors before the run are left out, unless one is the latest turn that shows t.
            aside = {*range(min(self.anchors(k), self.first(k)))} - {self.current(k)}
            seen = {self.turns[i]["shows"][m] for i, m, one in body if [i, m - 1] not in marked and i not in aside}
            seen -= {None}
        messages = [one for _, _, one in traced]
        return {
            "messages": messages,
            "tokens": self.tokens(messages) + tools_tokens(self.tools, self.n) + PRIMING,
            "shown_steps": len(seen),
            "dropped_turns": turns - len(shown),
            "masked_results": marked,
        }

    def prefix(self, k: int) -> int:
        """What stands unchanged at the beginning, in whole messages, the schemas before the first.

        A message is unchanged if it is the same one, in the same place: another turn's that happens to read alike
        carries other call ids.
        """
        if k == 0:
            return 0
        total = tools_tokens(self.tools, self.n)
        for was, now in zip(self.traced(k - 1), self.traced(k), strict=False):
            if was != now:
                break
            total += self.tokens([now[-1]])
        return total
