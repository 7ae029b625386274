"""The reader: a player that plays rightly from what its prompt shows, and guesses otherwise.

It has no memory and no skill beyond reading, so what a window, a summary, notes or files keep decides its score. It
plays games that say which actions follow from what was seen (`ReadableGame`). Asked for a summary, it answers
with the observations that the question shows, one a line, as `Step 3: TEXT`, the newest last, and as many of the newest
as the cap holds. Where there are notes or files, it keeps the same lines there. Told to keep less, it loses lines at
random whenever it writes a summary, as a model would.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from smartplay_tools.conversation.base import BaseConversation
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.base import ReadableGame
from smartplay_tools.players.prompt_reading import STEP, Reading, call, is_carried, is_error
from smartplay_tools.players.rules.memory import NUMBERED, file_cap, filed, looked_up, noted, notes_cap, summary_cap
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.arguments import read
from smartplay_tools.types.messages import Message, calls_of, text_of


class ReaderPlayer:
    """Plays by `right_actions` of the observations and lines that are visible."""

    name = "reader"
    observations = ("text", "both")

    def __init__(self, *, seed: int = 0, keeps: float = 1.0) -> None:
        """`keeps` is the probability with which a line stays whenever a summary is written.

        The draws are those of the seed, the step and how often its line was summarized, so all that ask lose alike.
        """
        if not 0 <= keeps <= 1:
            raise InvalidArgumentError(f"keeps is a probability, from 0 to 1, not {keeps!r}.")
        self._seed, self._keeps = seed, keeps
        self._summarized: Counter[int] = Counter()
        self._steps: dict[str, int] = {}
        """The step of every observation that has been the newest one: a question need not show the newest turns."""
        self._conversation: BaseConversation | None = None

    def attach(self, conversation: BaseConversation) -> None:
        """Take the rules of the game, its number of steps and the count of tokens; nothing is asked of its state."""
        game = conversation.episode.game
        if not isinstance(game, ReadableGame):
            raise InvalidArgumentError(
                f"The reader cannot play {conversation.episode.spec.id}, which does not say which actions follow from "
                "what was seen (right_actions). Play random."
            )
        self._game, self._conversation = game, conversation

    def reply(self, prompt: Prompt) -> Reply:
        """Play one of the right actions, or a legal one where what is visible does not tell them."""
        if self._conversation is None:
            raise InvalidArgumentError(
                "The reader needs its game, so it must be attached to a conversation: use `play`, `aplay` or eval."
            )
        episode, reading = self._conversation.episode, Reading(prompt)
        steps = episode.stats.steps
        if reading.observations and prompt.purpose == "play":
            self._steps[reading.observations[-1]] = steps
        seen = visible(reading, steps, self._steps)
        if prompt.purpose != "play":
            kept = {step: text for step, text in seen.items() if self._stays(step)}
            return Reply({"role": "assistant", "content": self._lines(kept, summary_cap(reading), prompt.max_tokens)})
        if not seen:
            return Reply(call("observe"))
        actions = self._game.right_actions(seen, reading.actions) or reading.actions
        action = random.Random(f"reader {self._seed} {steps}").choice(actions)
        if not prompt.tools:
            return Reply({"role": "assistant", "content": action})
        return Reply(self._with_notes(call("act", action=action), reading, seen))

    def _stays(self, step: int) -> bool:
        self._summarized[step] += 1
        return random.Random(f"keeps {self._seed} {step} {self._summarized[step]}").random() < self._keeps

    def _with_notes(self, message: Message, reading: Reading, seen: dict[int, str]) -> Message:
        if (cap := notes_cap(reading)) is not None:
            return noted(message, self._lines(seen, cap))
        if (cap := file_cap(reading)) is not None:
            return looked_up(message) if reading.is_start else filed(message, self._lines(seen, cap), reading)
        return message

    def _lines(self, seen: dict[int, str], *caps: int | None) -> str:
        """The newest observations as lines, as many as fit into these numbers of tokens."""
        assert self._conversation is not None
        counter = self._conversation.episode.counter
        cap = min((cap for cap in caps if cap is not None), default=None)
        lines = [f"Step {step}: {text}" for step, text in sorted(seen.items())]
        return fitting(lines, cap, lambda text: counter.content({"content": text}))


def visible(reading: Reading, steps: int, known: Mapping[str, int]) -> dict[int, str]:
    """Return the observations in a prompt by their steps, in one line each: as results, and as lines `Step 3: TEXT`.

    Those whose step is `known` may be quoted anywhere, as compactors do; other results are counted back from the
    number of steps played.
    """
    text = "\n".join(text for each in reading.prompt.shared if not is_carried(each) for text in _texts(each))
    seen = {int(step): line for step, line in STEP.findall(NUMBERED.sub("", text))}
    seen |= {step: " ".join(observation.split()) for observation, step in known.items() if observation in text}
    for each in reversed(reading.seen):
        if each.tool in ("act", "observe") and each.text not in known and each.text in reading.observations:
            seen[steps] = " ".join(each.text.split())
        steps -= each.tool == "act" and not is_error(each.text)
    return {step: seen[step] for step in sorted(seen)}


def fitting(lines: Iterable[str], cap: int | None, count: Callable[[str], int]) -> str:
    """Return the last of these lines, as many as have at most `cap` tokens together; all of them without a cap."""
    kept = list(lines)
    while kept and cap is not None and count("\n".join(kept)) > cap:
        del kept[0]
    return "\n".join(kept)


def _texts(message: Message) -> list[str]:
    """The texts of a message in which lines may stand: its own, and those that its calls write."""
    written = (read(each["function"]["arguments"]).values or {} for each in calls_of(message))
    kept = (str(values[name]) for values in written for name in ("text", "file_text") if name in values)
    return [text_of(message), *kept]
