"""Rules for Rock Paper Scissors: the best response to the opponent's visible hands, with the manual's scores."""

from __future__ import annotations

import re
from collections.abc import Mapping

from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules.memory import line, recall
from smartplay_tools.types.messages import Message

ROUND = re.compile(r"the opponent chose (\w+)\.")
SCORE = re.compile(r"\((\w+?)s? wins?, score (\d+)\)")
BEATS = {"Rock": "Scissor", "Paper": "Rock", "Scissor": "Paper"}


def plays(reading: Reading) -> bool:
    """Whether the actions are the three hands."""
    return set(reading.actions) == set(BEATS)


def decide(reading: Reading) -> Message:
    """Read the manual first; then play the hand with the best mean score against what was seen."""
    return play(reading, count(reading, {}))


def remember(reading: Reading, cap: int | None) -> tuple[Message, str]:
    """Decide by all rounds that are remembered or visible, and return the memory that covers them."""
    memory = recall(reading)
    counts = count(memory.since, (memory.facts or {}).get("hands", {}))
    return play(reading, counts), line({"clock": sum(counts.values()), "hands": counts})


def count(reading: Reading, earlier: Mapping[str, int]) -> dict[str, int]:
    """Return how often the opponent chose each hand, as far as it is known or visible."""
    hands = [match[1] for observation in reading.observations if (match := ROUND.search(observation))]
    return {hand: earlier.get(hand, 0) + hands.count(hand) for hand in BEATS}


def play(reading: Reading, counts: Mapping[str, int]) -> Message:
    """Play the best response to these hands of the opponent, once the manual was read."""
    scores = {hand: int(score) for hand, score in SCORE.findall(reading.system)}
    if not scores and reading.is_start:
        return call("read_manual")
    # One imagined round of each hand: unseen hands stay possible, and the first choice has a reason.
    frequency = {hand: counts[hand] + 1 for hand in BEATS}
    beaten_by = {loser: winner for winner, loser in BEATS.items()}

    def mean_score(hand: str) -> int:
        win, loss = BEATS[hand], beaten_by[hand]
        return frequency[win] * scores.get(hand, 1) - frequency[loss] * scores.get(loss, 1)

    return call("act", action=max(reading.actions, key=mean_score))
