"""Strategies of a manager: what is given as `strategy=`, and how one is called for a conversation.

A strategy is called as in a game: once for each prompt that the conversation had, before each reply and at its end, by
an object of its own. So what it shows follows from the conversation alone, whatever was asked before, and the answers
of a model, which are kept under a digest of what they are about. An object that has come to the end of a conversation
is kept for a while, since the conversation will go on from there.
"""

from __future__ import annotations

import copy
import hashlib
import inspect
import math
import threading
from collections.abc import Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from smartplay_tools.context.choosing import choosing
from smartplay_tools.context.strategies.custom import (
    FunctionCompactor,
    Loaded,
    chooses,
    compacts,
    load_strategy,
    make_strategy,
    name_on_record,
)
from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Selection
from smartplay_tools.errors import InvalidArgumentError, PromptOverflowError, StrategyError, name_of
from smartplay_tools.manager.counting import MessageCounter
from smartplay_tools.manager.kept import KeptCompacting
from smartplay_tools.manager.memo import Texts
from smartplay_tools.manager.reading import Reading
from smartplay_tools.manager.summaries import AskError, Question, read_answer
from smartplay_tools.manager.units import Chosen, Part, Shown, digests_of
from smartplay_tools.manager.window import AgentWindow
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.messages import Message

FOLDS = 16
"""How many conversations a runner remembers the strategies of."""

MOST_OF_AN_ANSWER = 4_096
"""The tokens that an answer may have where prompts have no cap."""


class StrategyMaker:
    """Makes the strategy of each conversation from what a user has given: a name, a class, an object or a function."""

    def __init__(self, given: Any) -> None:
        if isinstance(given, str):
            self.name, self._given, self._loaded = name_on_record(given), given, load_strategy(given)
        else:
            is_function, is_class = inspect.isroutine(given), isinstance(given, type)
            if not is_function and chooses(given) == compacts(given):
                raise InvalidArgumentError(
                    f"{name_of(given if is_class else type(given))} is no strategy: give Summaries(tokens=...), a "
                    "name, a class or an object with choose(past, room) or compact(history, room), or a function of "
                    "history and room."
                )
            self.name = self._given = name_of(given if is_function or is_class else type(given))
            made_of = partial(FunctionCompactor if is_function else copy.deepcopy, given)
            self._loaded = Loaded(given if is_class else made_of)
        made = self()
        self.compacts, self.remembers = compacts(made), bool(getattr(made, "remembers", True))
        self.reads_thoughts = bool(getattr(made, "reads_thoughts", False))

    def __call__(self) -> Any:
        """Return an object for one conversation."""
        return make_strategy(self._given, self._loaded)


@dataclass(frozen=True)
class AskedStrategy:
    """What a strategy is asked about: a conversation after its head, as it was read."""

    reading: Reading
    """As it was when the prompt was asked for."""
    seed: bytes
    """A digest of what shapes prompts beside the units."""
    room: int | None
    """The tokens beside tools and head; None without a cap."""
    reserved: tuple[int, Mapping[str, int]]
    """The cap on prompts, and the tokens of what they have beside the units, by part."""
    lead: Sequence[Part]
    """The messages of the head that a compactor is given."""
    lacks_user: bool

    @property
    def begin(self) -> int:
        """The first unit that is given: the user's first words, where the head has none."""
        return self.reading.users[0] if self.lacks_user and self.reading.users else 0

    def has_prompt(self, unit: int) -> bool:
        """Whether there was a prompt after a unit before the last: a reply follows it."""
        return self.reading.turns[unit + 1].unit.kind == "reply"

    def keys(self) -> list[bytes]:
        """Return the digest of the conversation up to each of its units."""
        turns, pinned = enumerate(self.reading.turns), self.reading.pinned
        return digests_of(self.seed, (t.unit.digest + bytes([at in pinned, t.unit.is_late]) for at, t in turns))

    def kept(self, stop: int) -> set[int]:
        """Return the turns before one that every prompt shows, beside the newest."""
        first = {self.begin} if self.lacks_user and self.reading.users else set[int]()
        return {unit - self.begin for unit in self.reading.kept(stop) | first if self.begin <= unit < stop}


class _Fold:
    """A strategy that has been called for every prompt of a conversation so far."""

    def __init__(self, window: AgentWindow, strategy: Any) -> None:
        self.window = window
        self.compacting = KeptCompacting(window, strategy) if compacts(strategy) else None
        self.rule = choosing(window, strategy) if self.compacting is None else self.compacting.make
        self.forms: Sequence[Form] = ()
        """What the latest prompt shows."""
        self.failed = ""


class StrategyRunner:
    """Calls the strategies of a manager's conversations."""

    def __init__(
        self, make: StrategyMaker, budget: ResolvedBudget, messages: MessageCounter, memo: Texts, *, goes_on: bool
    ) -> None:
        """`goes_on` says that a prompt whose question nobody answers is made without the compactor."""
        self._make, self._budget, self._messages = make, budget, messages
        self.compacts = make.compacts
        self._memo, self._goes_on = memo, goes_on
        self._folds: dict[bytes, _Fold] = {}
        self._lock = threading.Lock()

    def chosen(self, asked: AskedStrategy) -> Generator[Question, str, Chosen]:
        """Yield the questions of the strategy, be sent the answers, and return what the prompt shows."""
        turns, begin = asked.reading.turns, asked.begin
        if len(turns) <= begin:
            return Chosen([*map(Shown.whole, asked.lead)])
        keys, last = asked.keys(), len(turns) - 1
        with self._lock:
            ends = (at for at in range(last, begin - 1, -1) if at == last or asked.has_prompt(at))
            known = next((at for at in ends if keys[at] in self._folds), None)
            fold = None if known is None else self._folds.pop(keys[known])
        fold = fold or self._begun(asked)
        for turn, given in zip(fold.window.turns, turns[begin:], strict=False):
            turn.unit = given.unit  # an equal one of the list as it is now
        for at in range(begin if known is None else known + 1, last + 1):
            fold.window.add_unit(turns[at].unit, turns[at].step)
            if at == last:
                yield from self._played(fold, asked, keys[at], at)
            elif self._make.remembers and asked.has_prompt(at):
                with suppress(PromptOverflowError):  # the prompt was refused then
                    yield from self._played(fold, asked, keys[at], at)
        chosen = self._restored(fold, asked)
        if not fold.failed:
            with self._lock:
                self._folds[keys[last]] = fold
                if len(self._folds) > FOLDS:
                    del self._folds[next(iter(self._folds))]
        return chosen

    def _begun(self, asked: AskedStrategy) -> _Fold:
        cap = None if asked.room is None else asked.room + PRIMING + sum(part.cost.whole for part in asked.lead)
        budget = self._budget.model_copy(update={"prompt_tokens": cap})
        window = AgentWindow(asked.reading.form, self._messages, budget, asked.lead)
        window.is_read, window.shows_thoughts = True, self._make.reads_thoughts
        window.reserved = asked.reserved
        return _Fold(window, self._make())

    def _played(self, fold: _Fold, asked: AskedStrategy, key: bytes, at: int) -> Generator[Question, str, None]:
        """Have the strategy make the prompt after a unit."""
        window = fold.window
        window.keep(asked.kept(at + 1))
        cap = window.budget.prompt_tokens
        with window.fitting(math.inf if cap is None else cap):
            selection = yield from self._selected(fold, key)
            fold.forms = window.forms(selection)

    def _selected(self, fold: _Fold, key: bytes) -> Generator[Question, str, Selection]:
        """Call the strategy, and have its questions answered."""
        making, reply, number = fold.rule(), None, 0
        fold.failed = ""
        try:
            while True:
                try:
                    view = making.send(reply)
                except StopIteration as end:
                    selection: Selection = end.value
                    break
                text = yield from self._answer(key, number, view.messages)
                reply, number = Message(role="assistant", content=text), number + 1
        except AskError as error:
            if not self._goes_on or fold.compacting is None:
                raise
            fold.failed = str(error)
            return fold.compacting.untouched()
        finally:
            making.close()
        return selection

    def _answer(self, key: bytes, number: int, messages: list[Message]) -> Generator[Question, str, str]:
        """The answer to a question, which is asked once for what it is about."""
        digest = hashlib.sha256(key + canonical_json([self._make.name, number, messages])).hexdigest()
        with self._lock:
            known = self._memo.get(digest)
        if known is not None:
            return known
        most = self._budget.prompt_tokens or MOST_OF_AN_ANSWER
        answer = yield [dict(message) for message in messages], most
        with self._lock:
            return self._memo.setdefault(digest, read_answer(answer))

    def _restored(self, fold: _Fold, asked: AskedStrategy) -> Chosen:
        """What the latest prompt shows, in the form of the agent."""
        window = fold.window
        window.rewritten = set()
        shown = [*window.shown(fold.forms)]
        total = sum(each.tokens for each in shown) - sum(part.cost.whole for part in asked.lead)
        if asked.room is not None and total > asked.room:
            raise StrategyError(f"The choice takes {total} tokens, and there is room for {asked.room}.")
        return Chosen(shown, window.always - {len(window.turns) - 1}, sorted(window.rewritten), fold.failed)
