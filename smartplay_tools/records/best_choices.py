"""The best choice of whole turns: what a world could have been worth under a cap on prompts.

It is for games that say what an answer needs (`TextGame.needs`) and which actions are right (`ReadableGame`), and
whose observations do not depend on what is played. An answer is right if the turns that show what it needs are all in
the prompt, and otherwise worth what a guess is on average. A turn is as long as a bare call makes it, and the newest
one is always shown, as by every strategy that chooses turns (`context.choosing`).

What may be *brought back* is decided prompt by prompt, so that best is exact. Without bringing back, a turn that a
prompt leaves out has gone for good. The best is then found by dropping the turn that is needed last (Belady 1966),
which is a choice that can be made, and so at least reached. No choice is worth more than `at_most`: the same, if turns
had a length in common and each answer needed its oldest turn alone. Where the two are equal, the best is exact.
"""

from __future__ import annotations

import functools
import heapq
import json
import math
from collections.abc import Sequence, Set
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from smartplay_tools.conversation.agent_session import Conversation
from smartplay_tools.episode.config import EpisodeConfig
from smartplay_tools.episode.episode import Episode
from smartplay_tools.errors import InvalidArgumentError, MissingExtraError
from smartplay_tools.games.base import ReadableGame
from smartplay_tools.players.prompt_reading import call
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import Event
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.result import GAME_ENDS


@dataclass(frozen=True)
class Asked:
    """An answer that needs something."""

    newest: int
    """The newest turn in its prompt."""
    needs: frozenset[int]
    """The earlier turns that show what it needs."""
    right: float
    """What it is worth if it is right."""
    guessed: float
    """What a guess is worth on average."""


@dataclass(frozen=True)
class World:
    """The turns of an episode, and what is asked after them: at most one answer after each turn."""

    sizes: Sequence[int]
    """The tokens of each turn."""
    room: int
    """The tokens that prompts have for turns: at least as many as each takes."""
    asked: Sequence[Asked]
    rest: float = 0
    """What the answers that need nothing are worth."""

    def score(self, answered: Set[Asked]) -> float:
        """Return the score if these answers are right, and the others guessed."""
        return self.rest + math.fsum(each.right if each in answered else each.guessed for each in self.asked)

    def has_room(self, turns: Set[int], newest: int) -> bool:
        """Return whether turns fit into the prompt after a turn."""
        return sum(self.sizes[turn] for turn in turns) + self.sizes[newest] <= self.room

    def dropped(self) -> set[Asked]:
        """Return the answers that dropping the oldest turns leaves right."""
        before = [0, *accumulate(self.sizes)]
        return {
            each
            for each in self.asked
            if before[each.newest + 1] - before[min(each.needs, default=each.newest)] <= self.room
        }

    def brought_back(self) -> set[Asked]:
        """Return the answers that are right if every prompt shows what it needs."""
        return {each for each in self.asked if self.has_room(each.needs, each.newest)}

    def possible(self) -> set[Asked]:
        """Return the answers of which each, by itself, can be right if nothing is brought back."""
        return {
            each
            for each in self.brought_back()
            if all(self.has_room({turn for turn in each.needs if turn < at}, at) for at in range(each.newest))
        }

    def kept(self) -> set[Asked]:
        """Return the answers that are right if the turn that is needed last is dropped, and nothing is brought back."""
        kept: set[int] = set()
        waiting = sorted(self.possible(), key=lambda each: -each.newest)
        right: set[Asked] = set()
        for newest in range(len(self.sizes)):
            uses = {turn: each.newest for each in waiting for turn in each.needs}
            kept.intersection_update(uses)
            while kept and not self.has_room(kept, newest):
                gone = max(kept, key=lambda turn: (uses[turn], self.sizes[turn]))
                waiting = [each for each in waiting if gone not in each.needs]
                uses = {turn: each.newest for each in waiting for turn in each.needs}
                kept.intersection_update(uses)
            while waiting and waiting[-1].newest == newest:
                right.add(waiting.pop())
            kept.add(newest)
        return right

    def most(self) -> float:
        """Return a score that no choice exceeds, if nothing is brought back."""
        possible = self.possible()
        free = {each for each in possible if not each.needs}
        begun: dict[int, list[int]] = {}
        latest: dict[int, int] = {}
        for each in sorted(possible - free, key=lambda each: each.newest):
            turn = min(each.needs)  # from its latest use on, it could be kept for the next one
            begun.setdefault(latest.get(turn, turn), []).append(each.newest)
            latest[turn] = each.newest
        needed = frozenset[int]().union(*(each.needs for each in possible))
        sizes: list[int] = []
        held: list[int] = []
        count = 0
        for newest, size in enumerate(self.sizes):
            room = sum(total <= self.room - size for total in accumulate(sorted(sizes)))
            for _ in range(len(held) - room):
                heapq.heappop(held)
            count += sum(-use == newest for use in held)
            held = [use for use in held if -use != newest] + [-use for use in begun.get(newest, ())]
            heapq.heapify(held)
            sizes += [size] if newest in needed else []
        gains = sorted((each.right - each.guessed for each in possible - free), reverse=True)
        return self.score(free) + math.fsum(gains[:count])


@dataclass(frozen=True)
class BestChoice:
    """Scores of a world under a cap."""

    dropping: float
    """Of dropping the oldest turns."""
    without_return: float
    """Of the best choice that is known of those that bring no turn back."""
    at_most: float
    """What no choice of these exceeds."""
    with_return: float
    """Of the best choice of all."""

    @classmethod
    def of(cls, world: World) -> BestChoice:
        """Return the scores of a world."""
        dropping = world.score(world.dropped())
        kept = max(dropping, world.score(world.kept()))  # dropping brings nothing back, either
        at_most = min(world.most(), world.score(world.possible()))
        at_most = kept if math.isclose(kept, at_most, abs_tol=1e-9) else at_most
        return cls(dropping, kept, at_most, world.score(world.brought_back()))


def best_choice(config: EpisodeConfig) -> BestChoice | None:
    """Return the best scores in the world of an episode, under its history and cap; None if they cannot be told.

    The game is played twice, rightly and wrongly. What else the budget holds is left out, and so is who played.
    """
    if config.budget.prompt_tokens is None or config.protocol == "paper" or config.observation != "text":
        return None
    if config.first_observation == "prompt" and config.budget.history is not None:  # the head shrinks as it ages
        return None
    fields: dict[str, Any] = {
        "carry": None,
        "chain": None,
        "context": "window",
        "player": None,
        "player_options": {},
        "repeat": 0,
    }
    budget = Budget(history=config.budget.history, prompt_tokens=config.budget.prompt_tokens)
    plain = config.model_copy(update={**fields, "budget": budget, "strategy_sha256": None})
    try:
        return _best(canonical_text(plain.to_json()))
    except (InvalidArgumentError, MissingExtraError):  # the game, or what it is made of, is not here
        return None


@functools.lru_cache(4096)
def _best(config: str) -> BestChoice | None:
    """Return the best scores in the world of a config in JSON."""
    world = world_of(EpisodeConfig(**json.loads(config)))
    return None if world is None else BestChoice.of(world)


def world_of(config: EpisodeConfig) -> World | None:
    """Return the world of an episode, played without a strategy; None if nothing can be said of its best choice."""
    if not issubclass(config.spec.load(), ReadableGame):
        return None
    right, wrong = (_Play.of(config, is_right=is_right) for is_right in (True, False))
    if right is None or wrong is None or right.texts != wrong.texts:
        return None
    asked, rest = [], 0.0
    shown = {step: turn for turn, steps in enumerate(right.shows) for step in steps}
    in_head = 0 if config.first_observation == "prompt" else None
    for turn, (needs, chance, gained, lost) in enumerate(
        zip(right.needs, right.chances, right.rewards, wrong.rewards, strict=True)
    ):
        guessed = chance * gained + (1 - chance) * lost
        if needs and (right.history is None or min(needs) >= right.shows[turn][-1] - right.history):
            earlier = frozenset(shown[step] for step in needs) - {turn, in_head}
            asked.append(Asked(turn, earlier, gained, guessed))
        else:
            rest += guessed if needs else gained
    return World(right.sizes, right.room, asked, rest)


@dataclass
class _Play:
    """An episode in which every answer was right, or wrong. Its turns after the first are one action each."""

    history: int | None
    """How old an observation in a prompt may be, in steps."""
    room: int
    """The tokens that prompts have for turns."""
    sizes: list[int]
    """The tokens of each turn that is shown."""
    shows: list[tuple[int, ...]]
    """The observations that each shows."""
    texts: list[str]
    """The observations."""
    needs: list[Sequence[int]]
    """Before each action, the steps that it needs."""
    chances: list[float]
    """Of each action, how often a guess is right."""
    rewards: list[float]

    @classmethod
    def of(cls, config: EpisodeConfig, *, is_right: bool) -> _Play | None:
        """Play an episode; None if the game does not tell what is needed, or does not come to its end."""
        events: list[Event] = []
        seen, needs, chances = dict[int, str](), list[Sequence[int]](), list[float]()
        with Episode.from_config(config, transcript=events, is_recorded=True) as episode:
            game, conversation = episode.game, Conversation(episode)
            assert isinstance(game, ReadableGame)
            is_told = config.first_observation == "prompt"
            message = None if is_told else call("observe")
            while conversation.prompt() is not None:
                if message is not None:
                    conversation.receive(message)
                if episode.done:
                    break
                if game.needs is None:
                    return None
                seen[episode.stats.steps] = game.observation
                right = game.right_actions(seen, game.actions)
                if game.needs and not right:
                    return None
                others = [action for action in game.actions if action not in right]
                needs.append([*game.needs])
                chances.append(len(right) / len(game.actions))
                first, second = (right, others) if is_right else (others, right)
                message = call("act", action=[*first, *second][0])
        assert episode.result is not None
        record = Record(events)
        rewards = [each["data"]["reward"] for each in record.calls if "reward" in each["data"]]
        is_whole = episode.result.end_reason in GAME_ENDS and math.isclose(sum(rewards), episode.result.score)
        if not is_whole or episode.budget.prompt_tokens is None:
            return None
        turns = record.turns[: len(rewards)]
        sizes = [sum(form.tokens(episode.counter) for form in turn.whole) for turn in turns]
        room = episode.budget.prompt_tokens - record.views[0]["tokens"]
        shows = [turn.shows for turn in turns]
        if is_told:  # the first prompt has no turn, and what it shows stays in the head
            sizes, shows = [0, *sizes[:-1]], [(0,), *shows[:-1]]
        return cls(episode.budget.history, room, sizes, shows, [*seen.values()], needs, chances, rewards)
