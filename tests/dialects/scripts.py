"""The replies of which the games here are made: seven moves that solve it, and what real models say in between."""

from __future__ import annotations

import json
from collections.abc import Mapping

from tests.adapters.conformance import WAY, move
from tests.dialects.said import CUT, FILTERED, REFUSED, Said

THOUGHTS = " ".join(f"Thought {number} is about the disks." for number in range(12))


def act(at: int, thoughts: str = THOUGHTS) -> Said:
    """A move of the seven."""
    return Said(thoughts=thoughts, calls=(("act", json.dumps({"action": move(WAY[at])})),))


LOOK = ("observe", "{}")
NUMBERS = {name: number for number, name in enumerate(("A->B", "A->C", "B->A", "B->C", "C->A", "C->B"), 1)}
"""The numbers of the moves in the manual."""

HOSTILE: Mapping[str, Said] = {
    "broken JSON": Said(thoughts=THOUGHTS, calls=(("act", '{"action": "Move the'),)),
    "a cut call": Said(calls=(("act", '{"action": "Move the top disk'),), end=CUT),
    "JSON as text": Said(thoughts="Hm.", calls=(("act", json.dumps(json.dumps({"action": "1"}))),)),
    "a list": Said(calls=(("act", '["1"]'),)),
    "NaN": Said(calls=(("act", '{"action": NaN}'),)),
    "another tool": Said(thoughts=THOUGHTS, calls=(("go north!", '{"far": true}'),)),
    "words": Said(words="I would move the smallest disk.", thoughts=THOUGHTS),
    "cut words": Said(words="I would move the", end=CUT),
    "nothing": Said(),
    "only thoughts": Said(thoughts=THOUGHTS),
    "a refusal": Said(words="I'm sorry, I can't help with that.", end=REFUSED),
    "filtered": Said(end=FILTERED),
}
"""Replies that play nothing, by what is wrong with them."""

ODD: Mapping[str, Said] = {
    "empty arguments": Said(calls=(("observe", ""),)),
    "two calls": Said(words="First I look.", calls=(LOOK, LOOK)),
    "one id": Said(thoughts="Again.", calls=(LOOK, ("read_manual", "{}")), same_ids=True),
    "more arguments": Said(calls=(("observe", '{"deep": {"list": [1, "ä", null]}}'),)),
}
"""Replies that play no move and are no mistake."""

SOLVED = [act(at) for at in range(7)]

_BETWEEN = [*HOSTILE.values(), *ODD.values()]
MIXED = [
    *_BETWEEN[:2],
    act(0),
    *_BETWEEN[2:5],
    act(1),
    *_BETWEEN[5:8],
    act(2, thoughts=""),
    Said(calls=(("act", json.dumps({"action": NUMBERS[WAY[3]]})),)),
    *_BETWEEN[8:10],
    act(4),
    *_BETWEEN[10:12],
    act(5),
    *_BETWEEN[12:],
    act(6),
]
"""Everything that may happen in one game: every reply that plays nothing, a number as an action, and the solution."""

SHORT = [HOSTILE["broken JSON"], act(0), HOSTILE["nothing"], ODD["empty arguments"], *(act(at) for at in range(1, 7))]
"""The solution with three replies in between that servers do not take back as they were said."""
