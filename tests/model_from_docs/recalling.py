"""What `recall` answers, as docs/strategies.md defines it ("Recall")."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping

from .cutting import cut

NOTHING = "Nothing that has left your view matches."
STEPS = re.compile(r"\s*([0-9]{1,6})\s*(?:-\s*([0-9]{1,6})\s*)?")


def words_of(text: str) -> list[str]:
    """Return the words of a text: runs of letters and digits, then in lower case."""
    return [word.lower() for word in re.findall(r"[^\W_]+", text)]


def ranking(query: str, documents: Mapping[int, str]) -> list[int]:
    """Return the steps whose documents match, best first."""
    words = {step: Counter(words_of(document)) for step, document in documents.items()}
    mean = sum(map(Counter.total, words.values())) / max(1, len(words))
    scores: dict[int, float] = {}
    for step, frequencies in words.items():
        score = 0.0
        for word in dict.fromkeys(words_of(query)):
            n = sum(word in others for others in words.values())
            weight = math.log(1 + (len(words) - n + 0.5) / (n + 0.5))
            f = frequencies[word]
            score += weight * f * 2.2 / (f + 1.2 * (0.25 + 0.75 * frequencies.total() / mean))
        if any(word in frequencies for word in words_of(query)):
            scores[step] = round(score, 9)
    return sorted(scores, key=lambda step: (-scores[step], -step))


def matching(query: str, documents: Mapping[int, str]) -> list[int]:
    """Return the steps whose documents a query asks for, in the order of the answer."""
    if asked := STEPS.fullmatch(query):
        first, last = int(asked[1]), int(asked[2] or asked[1])
        return [step for step in sorted(documents) if first <= step <= last]
    return ranking(query, documents)


def answer(query: str, documents: Mapping[int, str], cap: int, n: Callable[[str], int]) -> tuple[str, bool]:
    """Return the answer to a query over the documents of what has left, by their steps, and whether it was cut."""
    matches = [documents[step] for step in matching(query, documents)]
    if not matches:
        return cut(NOTHING, cap, n), n(NOTHING) > cap
    for count in range(len(matches), 0, -1):
        if n("\n\n".join(matches[:count])) <= cap:
            return "\n\n".join(matches[:count]), False
    return cut(matches[0], cap, n), True
