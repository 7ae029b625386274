"""Strategies that break their contract, each in one way: `check_strategy` has to find every one of them."""

import random
import time

from smartplay_tools.context.strategies.choices import Choice


class TooMuch:
    """Takes no notice of the room."""

    def choose(self, past, room):
        return Choice(range(len(past.turns)))


class NoSuchTurn:
    def choose(self, past, room):
        return Choice([len(past.turns)])


class Twice:
    def choose(self, past, room):
        return Choice([0, 0])


class HidesTheNewest:
    def choose(self, past, room):
        return Choice(masked=[past.turns[-1].number])


class NotText:
    def choose(self, past, room):
        return Choice(texts={past.turns[-1].number: 5})


class Raises:
    def choose(self, past, room):
        return Choice([1 // (len(past.turns) - 3)] if len(past.turns) > 2 else [])


class ReturnsNothing:
    def choose(self, past, room):
        return [turn.number for turn in past.turns]


class Draws:
    """Draws at random, so that a replay differs."""

    def choose(self, past, room):
        return Choice(texts={past.turns[-1].number: str(random.random())} if room is None or room > 40 else {})


class Clock:
    def choose(self, past, room):
        return Choice(texts={past.turns[-1].number: str(time.perf_counter_ns())} if room is None or room > 40 else {})


class Shared:
    """Remembers in its class, which all episodes share."""

    seen = 0

    def choose(self, past, room):
        Shared.seen += 1
        return Choice(texts={past.turns[-1].number: f"{Shared.seen}"} if room is None or room > 40 else {})


class SetOrder:
    """Depends on the order of a set of texts, which differs between processes."""

    def choose(self, past, room):
        words = ", ".join({f"word {number}" for number in range(9)})
        return Choice(texts={past.turns[-1].number: words} if room is None or room > 90 else {})


class ReadsEverything:
    """Looks at every turn, every time."""

    def choose(self, past, room):
        return Choice() if all(turn.tokens for turn in past.turns) else Choice([0])


class Blocks:
    def choose(self, past, room):
        while len(past.turns) > 2:
            time.sleep(0.1)
        return Choice()


class Good:
    """Keeps the newest turns that fit, says how many there were, and masks those before the last three."""

    def __init__(self, most=5):
        self._most = most

    def choose(self, past, room):
        shown, masked, texts, count = [], [], {}, len(past.turns)
        text = f"{count} turns so far."
        if room is None or past.text_tokens(text) <= room:
            texts[count - 1] = text
            room = None if room is None else room - past.text_tokens(text)
        for number in range(count - 1, max(-1, count - 1 - self._most), -1):
            turn = past.turns[number]
            if turn.is_pinned:
                continue
            is_old = number < count - 3
            tokens = turn.masked_tokens if is_old else turn.tokens
            if room is not None and tokens > room:
                break
            room = None if room is None else room - tokens
            shown.append(number)
            masked += [number] if is_old else []
        return Choice(shown, masked, texts)


class Batches:
    """Keeps the contract: lets turns go in batches, so that its window swings between a share of the room and all."""

    def __init__(self, share):
        self._share, self._first = share, 0

    def choose(self, past, room):
        kept = [turn for turn in past.turns[self._first :] if not turn.is_pinned]
        used = sum(turn.tokens for turn in kept)
        if room is not None and used > room:
            while kept and used > room * (1 - self._share):
                used -= kept[0].tokens
                self._first = kept.pop(0).number + 1
        return Choice([turn.number for turn in kept])
