"""The rule players, which play all games and recognise the game from the messages.

`rule` writes nothing into its replies, so it knows only what the window shows. `rule-notes` keeps a memory in games
where it helps: in its own words, in notes, in summaries. The difference between their scores is what a memory is worth.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.rules import (
    bandit,
    crafter,
    hanoi,
    messenger,
    minecraft,
    rock_paper_scissors,
)
from smartplay_tools.players.rules.crafter import notes as crafter_notes
from smartplay_tools.players.rules.memory import (
    file_cap,
    filed,
    fits,
    looked_up,
    newest_quoted,
    noted,
    notes_cap,
    offers,
    recall,
    searched,
    summary_cap,
    with_recalled,
)
from smartplay_tools.types import PAGES_TOOL, RECALL_TOOL, Prompt, Reply
from smartplay_tools.types.messages import Message, calls_of

NOTHING_TO_PLAY: Message = {"role": "assistant", "content": "I play by tool calls, and there is no tool `act` here."}
"""The reply to a request other than to play, such as a request for a title of the conversation."""


class GameRules(Protocol):
    """The interface of a module of rules."""

    def plays(self, reading: Reading) -> bool:
        """Whether the module plays this game, recognised by its legal actions."""
        ...

    def decide(self, reading: Reading) -> Message:
        """The next assistant message."""
        ...


class Remembering(GameRules, Protocol):
    """The interface of a module of rules that can keep a memory (`players.rules.memory`)."""

    def remember(self, reading: Reading, cap: int | None) -> tuple[Message, str]:
        """The next assistant message, and the memory with it: everything that is known, in at most `cap` tokens."""
        ...


class RulePlayer:
    """Plays by rules written for each game, using only the messages of the prompt."""

    name = "rule"
    observations = ("text", "both")
    rules: ClassVar[tuple[GameRules, ...]] = (bandit, crafter, hanoi, messenger, minecraft, rock_paper_scissors)

    def __init__(self, *, seed: int = 0) -> None:
        """Every player takes a seed; this one draws nothing."""

    def reply(self, prompt: Prompt) -> Reply:
        """Decide by the rules of the game whose actions the prompt offers; without any, reply in text."""
        reading = Reading(prompt)
        if prompt.purpose == "compaction":
            return Reply({"role": "assistant", "content": newest_quoted(reading) or self._summary(reading)})
        if prompt.purpose != "play":
            return Reply({"role": "assistant", "content": self._summary(reading)})
        if reading.is_over:
            return Reply({"role": "assistant", "content": "The game is over."})
        if all(tool.name != "act" for tool in prompt.tools) and (message := self._beside_the_play(reading)) is not None:
            return Reply(message)
        for rules in self.rules:
            if reading.actions and rules.plays(reading):
                return Reply(_offered(self._decide(rules, reading), reading))
        if not reading.prompt.tools:  # a question with a numbered list in it
            return Reply({"role": "assistant", "content": newest_quoted(reading) or self._summary(reading)})
        actions = ", ".join(reading.actions) or "none"
        raise InvalidArgumentError(f"The rule player has no rules for a game with the actions {actions}.")

    def _beside_the_play(self, reading: Reading) -> Message | None:
        """The reply to a request other than to play; None where actions are listed, as in the paper's prompts."""
        return None if reading.actions else NOTHING_TO_PLAY.copy()

    def _decide(self, rules: GameRules, reading: Reading) -> Message:
        return rules.decide(reading)

    def _summary(self, reading: Reading) -> str:
        """A line about what is visible; these rules read observations only, so they make no use of it."""
        seen = reading.observations
        newest = f" The newest: {seen[-1].partition(chr(10))[0]}" if seen else ""
        return f"{len(seen)} observations are visible, and I keep no memory of what leaves.{newest}"


class RuleNotesPlayer(RulePlayer):
    """The rule player with a memory, in games whose rules can keep one.

    The memory is written where the budget offers a place for it: as notes where there is `take_notes`, else into a
    file where there is `memory`, and as the summary where one is asked for. In games where the order of observations
    does not matter, the player uses `recall`, where there is one, to search those that have left, and writes nothing.
    Where there is `read_result`, it reads long results to their end. `words` says whether the memory is written into
    the player's own replies where it has no other place.
    """

    name = "rule-notes"
    remembering: ClassVar[tuple[Remembering, ...]] = (bandit, crafter_notes, messenger, rock_paper_scissors)
    counting: ClassVar[tuple[Remembering, ...]] = (bandit, rock_paper_scissors)

    def __init__(self, *, seed: int = 0, words: bool = True) -> None:
        """Every player takes a seed; this one draws nothing."""
        super().__init__(seed=seed)
        self._words = words

    def _decide(self, rules: GameRules, reading: Reading) -> Message:
        if reading.next_page is not None and offers(reading, PAGES_TOOL):
            return call(PAGES_TOOL, page=reading.next_page)
        memory = self._memory(reading)
        if memory is None:
            return super()._decide(rules, reading)
        cap = notes_cap(reading)
        if cap is None and (of_files := file_cap(reading)) is not None:
            message, text = memory.remember(reading, of_files)
            if reading.is_start:
                return looked_up(message)
            return filed(message, text, reading) if text and fits(text, of_files) else message
        if cap is None and memory in self.counting and offers(reading, RECALL_TOOL) and recall(reading).facts is None:
            whole, query = with_recalled(reading)
            return searched(memory.decide(whole), query)
        message, text = memory.remember(reading, cap)
        if not text or (cap is None and not self._words):
            return message
        return {**message, "content": text} if cap is None else noted(message, text)

    def _beside_the_play(self, reading: Reading) -> Message | None:
        """The newest memory that the request quotes: a host may ask for a summary in other words and lists."""
        quoted = newest_quoted(reading)
        if quoted is None or any(rules.plays(reading) for rules in self.rules if reading.actions):
            return super()._beside_the_play(reading)
        return {"role": "assistant", "content": quoted}

    def _summary(self, reading: Reading) -> str:
        memory = self._memory(reading)
        if memory is None:
            return super()._summary(reading)
        return memory.remember(reading, summary_cap(reading))[1] or super()._summary(reading)

    def _memory(self, reading: Reading) -> Remembering | None:
        return next((rules for rules in self.remembering if reading.actions and rules.plays(reading)), None)


def _offered(message: Message, reading: Reading) -> Message:
    """The message, or a call to an offered tool if a host offers fewer tools than the game has."""
    offered = {tool.name for tool in reading.prompt.tools}
    if not offered or all(wanted["function"]["name"] in offered for wanted in calls_of(message)):
        return message
    if "act" in offered:
        return call("act", action=reading.actions[0])
    return next((call(name) for name in ("observe", "read_manual") if name in offered), NOTHING_TO_PLAY.copy())
