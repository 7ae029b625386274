"""A strategy for tests that chooses anything at random, and keeps what it chose, as plain data, for the judge."""

import random

from smartplay_tools.context.strategies.choices import Choice


class Odd:
    """Shows and masks turns at random, with texts before some; `wild` takes no notice of the room sometimes."""

    def __init__(self, seed=0, wild=False):
        self._seed, self._wild = seed, wild
        self.chosen = {}

    def choose(self, past, room):
        count = len(past.turns)
        chance = random.Random(f"{self._seed} {count}")
        shown, masked, texts = [], [], {}
        left = 10**9 if room is None or (self._wild and chance.random() < 0.1) else room
        numbers = [n for n in range(max(0, count - 12), count) if chance.random() < 0.6]
        chance.shuffle(numbers)
        for number in numbers:
            turn, is_hidden = past.turns[number], chance.random() < 0.3
            if turn.is_pinned:
                shown += [number] if chance.random() < 0.3 else []
                continue
            tokens = turn.masked_tokens if is_hidden else turn.tokens
            if tokens <= left:
                left -= tokens
                shown.append(number)
                masked += [number] if is_hidden else []
        for number in {*shown, *past.pinned}:
            text = chance.choice(["A note.", "word " * chance.randrange(1, 9), "é\ud83d\ude00"])
            if chance.random() < 0.2 and past.text_tokens(text) <= left:
                left -= past.text_tokens(text)
                texts[number] = text
        self.chosen[count] = (tuple(shown), tuple(masked), texts)
        return Choice(iter(shown), masked, texts)
