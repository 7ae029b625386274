"""A teacher whose notes a tiny model can learn to write: three digits, one for each hand of the opponent.

`rule-notes` writes a line of JSON with a clock and numbers without bound. `digits` counts every hand up to nine, and
halves all three when one would pass it, so that a note is the one before with one digit changed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

from smartplay_tools.players.prompt_reading import Reading
from smartplay_tools.players.rule import Remembering, RuleNotesPlayer
from smartplay_tools.players.rules import rock_paper_scissors
from smartplay_tools.types.messages import Message, calls_of, text_of

NOTE = re.compile(r"Rock (\d), Paper (\d), Scissor (\d)")


class Digits:
    """Rules for Rock Paper Scissors that remember three digits."""

    def plays(self, reading: Reading) -> bool:
        """Whether the actions are the three hands."""
        return rock_paper_scissors.plays(reading)

    def decide(self, reading: Reading) -> Message:
        """Decide by what is visible alone."""
        return rock_paper_scissors.decide(reading)

    def remember(self, reading: Reading, cap: int | None) -> tuple[Message, str]:
        """Decide by the newest note and the hands since; without a note, by the visible hands."""
        messages = reading.prompt.messages
        at, counts = next(
            ((at, _counts(text)) for at in reversed(range(len(messages))) if NOTE.search(text := _words(messages[at]))),
            (0, dict.fromkeys(rock_paper_scissors.BEATS, 0)),
        )
        since = Reading(replace(reading.prompt, shared=messages[at:]))
        for hand in _hands(since.observations):
            counts = tallied(counts, hand)
        note = ", ".join(f"{hand} {number}" for hand, number in counts.items())
        return rock_paper_scissors.play(reading, counts), note


def tallied(counts: Mapping[str, int], hand: str) -> dict[str, int]:
    """Count one more hand; past nine, all counts are halved, downwards."""
    more = {each: number + (each == hand) for each, number in counts.items()}
    return {each: number // 2 for each, number in more.items()} if more[hand] > 9 else more


def _hands(observations: Iterable[str]) -> list[str]:
    return [match[1] for text in observations if (match := rock_paper_scissors.ROUND.search(text))]


def _words(message: Message) -> str:
    """What a message says outside a result, its calls' arguments included."""
    arguments = [call["function"]["arguments"] for call in calls_of(message)]
    return "" if message["role"] in ("system", "tool") else "\n".join([text_of(message), *arguments])


def _counts(text: str) -> dict[str, int]:
    (note,) = NOTE.findall(text)[-1:]
    return dict(zip(rock_paper_scissors.BEATS, map(int, note), strict=True))


class DigitsPlayer(RuleNotesPlayer):
    """Plays Rock Paper Scissors as `rule-notes` does, with notes of three digits."""

    name = "digits"
    remembering: ClassVar[tuple[Remembering, ...]] = (Digits(),)
    counting: ClassVar[tuple[Remembering, ...]] = ()
