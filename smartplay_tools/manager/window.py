"""The window of games over an agent's messages, in which the built-in rule, strategies and compactors decide.

Every unit of a reading is a turn. Its messages have the tokens that the manager counts, and are chat messages of words
alone once a strategy looks at them. So a prompt of an agent is decided, counted and cut by the code that games have,
and what is shown is put back into the form of the agent: a message that stays is the object that was given.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from operator import attrgetter
from typing import Any, Literal, TypeVar

from smartplay_tools.context.grid import block_of, jump_of
from smartplay_tools.context.newest import first_young, newest_run, step_of
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.errors import PromptOverflowError
from smartplay_tools.manager.counting import PICTURE_LEFT, RESULT_LEFT, MessageCounter
from smartplay_tools.manager.forms import Content, Given, MessageForm, without_pictures
from smartplay_tools.manager.units import Chosen, Part, Shown, Unit, as_first_shown, squeezed
from smartplay_tools.providers.reply_fields import texts_in
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.call_ids import CallIds
from smartplay_tools.types.messages import Message, MessageToolCall, calls_of, text_of

WORDING = Wording(VERSION, {**Wording.of(VERSION).texts, "observation_left": RESULT_LEFT})
"""The sentences of games, with the manager's in place of a result that is too old."""

T = TypeVar("T")

HIDDEN = "."
"""Stands for thoughts that nobody can read."""

Level = Literal["whole", "masked", "unpictured", "trimmed"]
"""How a message is shown: a field of its `Cost`."""


class AgentForm(Form):
    """A message of a turn at a level: the reply, or one result. Its chat message is made when it is first read."""

    __slots__ = ("index", "level", "turn")

    def __init__(self, turn: AgentTurn, index: int, level: Level, tokens: int) -> None:
        """`index` is its place in the turn, 0 for the reply."""
        self.turn, self.index, self.level, self.step = turn, index, level, None
        self.is_counted(turn.window.counter, tokens)

    def __getattr__(self, name: str) -> Any:
        if name != "message":
            raise AttributeError(name)
        said = self.turn.said
        forms = [said.trimmed] if self.level == "trimmed" else said.masked if self.level == "masked" else said.whole
        self.message = forms[self.index].message
        return self.message

    @property
    def is_result(self) -> bool:
        """Whether it is the result of a call."""
        return self.index > 0


class AgentTurn(Turn):
    """A unit as a turn."""

    def __init__(self, window: AgentWindow, number: int, unit: Unit, step: int, first_picture: int) -> None:
        """`step` is how many units with results there are up to it."""
        self.window, self.number, self.unit, self.step, self.first_picture = window, number, unit, step, first_picture
        results = [(at, part) for at, part in enumerate(unit.parts) if part.cost.is_result]
        self.places = [(at, index) for at, part in results for index in range(len(window.form.answers(part.message)))]
        """For each result, which part of the unit it is in, and which result of the part it is."""
        self.shows = (step,) * len(self.places)
        self._pictures = sum(part.cost.pictures for _, part in results)
        reply = sum(part.cost.whole for part in unit.parts if not part.cost.is_result)
        self.whole = (AgentForm(self, 0, "whole", reply), *self._results_at("whole"))
        self._levels: dict[Level, tuple[Form, ...]] = {"whole": self.whole}
        """All its messages, with the results at each level."""

    def __getattr__(self, name: str) -> Any:
        if name not in ("assistant", "shown", "items", "calls", "arguments"):
            raise AttributeError(name)
        return getattr(self.said, name)

    @cached_property
    def said(self) -> Turn:
        """The turn as chat messages."""
        return self.window.said(self)

    @cached_property
    def thoughtless(self) -> Form | None:
        """The reply without its thoughts; None if it has none, or nothing else."""
        return self.said.thoughtless

    @cached_property
    def trimmed(self) -> Form:
        """The reply with its calls alone."""
        return AgentForm(self, 0, "trimmed", sum(part.cost.trimmed for part in self.unit.parts))

    def is_whole(self, forms: Sequence[Form]) -> bool:
        """Whether these are all its messages, with nothing changed."""
        return tuple(forms) == self.whole and all(part.cost.cut is None for part in self.unit.parts)

    @property
    def pictures_so_far(self) -> int:
        """How many pictures there are up to its end."""
        return self.first_picture + self._pictures

    @cached_property
    def is_wordy(self) -> bool:
        """Whether a reply with calls is trimmed; the built-in rule has no regard to its words."""
        return bool(self.places) and (not self.window.is_read or self.said.is_wordy)

    def seen(self, oldest: int, *, trimmed_before: int = 0, elided: int = 0) -> tuple[Form, ...]:
        """Return its messages, each at its level; pictures leave with all of their unit."""
        level: Level = "whole"
        if self.places and self.step < oldest and not self.unit.is_late:
            level = "masked"
        elif self._pictures and self.first_picture < elided:
            level = "unpictured"
        if level not in self._levels:
            self._levels[level] = (self.whole[0], *self._results_at(level))
        forms = self._levels[level]
        return (self.trimmed, *forms[1:]) if self.step < trimmed_before and self.is_wordy else forms

    def _results_at(self, level: Level) -> Iterator[AgentForm]:
        """Its results at a level; their tokens add up to those of the messages that they are in."""
        window, rest = self.window, 0
        for number, (at, index) in enumerate(self.places, 1):
            part = self.unit.parts[at]
            rest = getattr(part.cost, level) if index == 0 else rest
            tokens = rest
            if number < len(self.places) and self.places[number][0] == at:  # others of this message follow
                text = RESULT_LEFT if level == "masked" else window.told(part)[index]
                tokens = window.counter.message({"role": "tool", "content": text})
            rest -= tokens
            yield AgentForm(self, number, level, tokens)


class AgentWindow(ContextWindow):
    """A window over units."""

    turns: list[AgentTurn]  # type: ignore[assignment]  # every turn is made by `add_unit`

    def __init__(
        self, form: MessageForm, messages: MessageCounter, budget: ResolvedBudget, lead: Sequence[Part] = ()
    ) -> None:
        """`lead` are messages before the first unit."""
        self.form, self.messages, self.ids = form, messages, CallIds()
        self.is_read = self.shows_thoughts = False
        """Whether a strategy decides, and whether it is given thoughts."""
        self.rewritten: set[int] = set()
        """The messages in whose place a strategy has put its own."""
        self.reserved: tuple[int, Mapping[str, int]] = 0, {}
        """The cap on prompts, and the tokens of what they have beside the units, by part."""
        self._taken: list[list[str]] = []
        """For each turn the ids of its calls, of which none comes twice."""
        self._given_ids: dict[str, str] = {}
        """The ids that the model has sent, by these."""
        self._thoughtless: dict[int, Turn] = {}
        """The turns by the identity of their replies as they are without thoughts."""
        super().__init__([], (), budget, messages.counter, Strategies(budget, messages.counter, WORDING))
        self.now = [AgentTurn(self, -1, Unit("word", [part]), 0, 0).whole[0] for part in lead]
        self.starts = [len(lead)]

    def add_unit(self, unit: Unit, step: int) -> None:
        """Add a unit as a turn; `step` is how many units with results there are up to it."""
        pictures = self.turns[-1].pictures_so_far if self.turns else 0
        self.add(AgentTurn(self, len(self.turns), unit, step, pictures))

    # What is shown.

    @property
    def always_tokens(self) -> int:
        """The tokens of the head and the turns that every prompt shows."""
        return super().always_tokens + self.tokens(range(self.starts[0]))

    def keep(self, kept: Iterable[int], most: float = math.inf) -> None:
        """Give every message its level, and pin turns that every prompt shows, beside the newest."""
        self.grow_old()
        self.pin({turn: self.turn_tokens(turn) for turn in {*kept, len(self.turns) - 1}}, most)

    @contextmanager
    def fitting(self, most: float) -> Iterator[None]:
        """Show the newest turn with shorter results where what every prompt shows would not fit."""
        turn, needs = self.turns[-1], self.always_tokens
        if needs <= most:
            yield
            return
        newest, last = self.turn_tokens(turn.number), turn.number
        shorter = squeezed(turn.unit, most - needs + newest, self.form, self.messages)
        if shorter is None:
            pins = needs - newest - self.head_tokens - self.tokens(range(self.starts[0]))
            cap, parts = self.reserved
            raise PromptOverflowError.of(cap, {**parts, "pinned": pins, "newest turn": newest})
        self.back_to(last)
        self.add(AgentTurn(self, last, shorter, turn.step, turn.first_picture))
        try:
            yield
        finally:
            self.back_to(last)
            self.add(turn)

    def newest_units(self, room: float, kept: Iterable[int], users: Sequence[int]) -> Chosen:
        """Return what the built-in rule shows.

        `users` are the units of which one has to stand first, if there are any.
        """
        budget, most = self.budget, room + self.head_tokens
        self.keep(kept, most)
        low = first_young(self.turns, self.oldest) if budget.beyond_history == "drop" else 0
        first = newest_run(self.prompt_tokens, most, self.places, block_of(budget.slack, room), low)
        if not bisect_left(self._pins, first) and self.turns[first].unit.kind == "reply":
            first = next((number for number in users if number > first), first)
        with self.fitting(most):
            return Chosen([*self.shown(self.forms(self.run_from(first)))], range(first))

    def beginnings(self, room: float, first: int) -> list[int]:
        """Return the units after the first with which runs of a conversation begin as it grows, up to one of them.

        They are the units of the grid, whichever of them a prompt has begun with: a function of the conversation alone.
        """
        budget, places, found = self.budget, self.places, {first}
        if not math.isinf(room):
            block = block_of(budget.slack, room)
            found |= {bisect_left(places, number * block) for number in range(1, places[first] // block + 1)}
        if budget.history is not None and budget.beyond_history == "drop":
            steps = range(jump := jump_of(budget.slack, budget.history), self.turns[first].step + 1, jump)
            found |= {bisect_left(self.turns, step, key=step_of) for step in steps}
        return sorted(unit for unit in found if 0 < unit <= first)

    # Chat messages.

    def said(self, turn: AgentTurn) -> Turn:
        """Return a unit as chat messages of words alone."""
        form, replies = self.form, turn.unit.replies
        text = "".join(words_of(part.message, form) for part in replies)
        assistant: Message = {"role": replies[0].message.get("role", "assistant"), "content": text}
        waiting: dict[str, list[str]] = {}
        if turn.unit.kind == "reply":
            assistant = {"role": "assistant", "content": text}
            called = [call for part in replies for call in calls_in(part.message, form)]
            calls: list[MessageToolCall] = []
            for mine, (call_id, name, arguments) in zip(self._ids_of(turn.number), called, strict=True):
                waiting.setdefault(call_id, []).append(mine)
                calls.append({"id": mine, "type": "function", "function": {"name": name, "arguments": arguments}})
            if calls:
                assistant["tool_calls"] = calls
            if self.shows_thoughts and any(form.thinks(part.message) for part in replies):
                assistant["reasoning_content"] = "".join(map(self._thoughts, replies)) or HIDDEN
            trimmed = sum(part.cost.trimmed for part in replies)
            if self.strategies.trimming is not None and trimmed != sum(part.cost.whole for part in replies):
                assistant["reasoning_content"] = HIDDEN  # thoughts that only the form knows leave with the words
        items: list[Item] = []
        for at, index in turn.places:
            part = turn.unit.parts[at]
            mine = waiting[form.answers(part.message)[index]].pop(0)
            message: Message = {"role": "tool", "content": self.told(part)[index], "tool_call_id": mine}
            if self.shows_thoughts and self._beside(part):
                message["name"] = "user"  # whose words end a turn
            items.append(Item(message, turn.step, turn.step, len(items), words=WORDING))
        said = Turn(turn.number, assistant, tuple(items), turn.step)
        if said.thoughtless is not None:
            self._thoughtless[id(said.thoughtless.message)] = said
        return said

    def _ids_of(self, number: int) -> list[str]:
        """The ids of a turn's calls, which are taken in the order of the conversation."""
        for turn in self.turns[len(self._taken) : number + 1]:
            parts = turn.unit.replies if turn.unit.kind == "reply" else ()
            called = [call for part in parts for call in self.form.calls(part.message)]
            self._taken.append(self.ids.take(called, turn.number))
            self._given_ids.update(zip(self._taken[-1], called, strict=True))
        return self._taken[number]

    def _thoughts(self, part: Part) -> str:
        """What can be read of the thoughts of a message, and of what stands beside its words."""
        others = (other for said in self.form.said(part.message) for other in (*said.others, *said.content.others))
        return "".join(text for other in others for text in texts_in(dict(other)))

    def told(self, part: Part) -> list[str]:
        """Return the results of a message as text; words that stand beside them are a part of the last."""
        message = as_first_shown(part, self.form)
        texts = [told(Content.of(content)) for content in self.form.results(message)]
        if beside := self._beside(part):
            texts[-1] = f"{texts[-1]}\n{beside}"
        return texts

    def _beside(self, part: Part) -> str:
        """The words that stand beside the results of a message."""
        return "".join(told(said.content) for said in self.form.said(part.message) if said.role != "tool")

    def edited(self, form: Form) -> int | None:
        """Return the turn of whose reply a strategy has changed no words; None for any other message."""
        message = form.message
        if (said := self._thoughtless.get(id(message))) is not None:
            return said.number
        calls = calls_of(message)
        number = self.result_of(calls[0]["id"]) if calls else None
        if number is None:
            return None
        shown = self.turns[turn := self.turn_of(number)].shown
        is_same = [call["id"] for call in calls_of(shown)] == [call["id"] for call in calls]
        return turn if is_same and text_of(shown) == text_of(message) else None

    # The form of the agent.

    def shown(self, forms: Iterable[Form]) -> Iterator[Shown]:
        """Yield what a prompt shows in the form of the agent."""
        for group in grouped(forms, attrgetter("is_result")):
            yield from self.group(group)

    def group(self, forms: Sequence[Form]) -> Iterator[Shown]:
        """Yield a reply with its results, or one other message."""
        first, *results = forms
        if isinstance(first, AgentForm) and first.turn.is_whole(forms):
            yield from (Shown.whole(part, first.turn.number) for part in first.turn.unit.parts)
            return
        if isinstance(first, AgentForm):
            yield from self._replied(first)
        elif (turn := self.edited(first)) is not None:
            yield from self._edited(self.turns[turn], first.message)
        else:
            yield from map(self._own, self._written(first.message))
        yield from self._answers(results)

    def _replied(self, form: AgentForm) -> Iterator[Shown]:
        turn = form.turn
        for part in turn.unit.replies:
            if form.level != "trimmed":
                yield Shown.whole(part, turn.number)
            elif (shorter := self.form.trimmed(part.message)) is not None:
                yield Shown(part, shorter, part.cost.trimmed, "trimmed", turn.number)

    def _edited(self, turn: AgentTurn, message: Message) -> Iterator[Shown]:
        """Yield a reply with the arguments of another message, and with thoughts only if that has some."""
        opens = True
        arguments = {self._given_ids[call["id"]]: call["function"]["arguments"] for call in calls_of(message)}
        thoughts = not self.shows_thoughts or "reasoning_content" in message
        for part in turn.unit.replies:
            edited = self.form.edited(part.message, arguments, thoughts=thoughts)
            if edited is None:
                continue
            tokens, opens = self.messages.tokens(edited, self.form, opens=opens), False
            if edited == part.message:
                yield Shown(part, part.message, tokens, turn=turn.number)
                continue
            yield Shown(part, edited, tokens, "rewritten", turn.number)
            self.rewritten.update([] if part.source is None else [part.source])

    def _answers(self, forms: Iterable[Form]) -> Iterator[Shown]:
        """Yield the messages with these results: those of one message that was given are in one again."""
        found = dict[tuple[int, int], dict[int, Form]]()
        made: list[Given] = []
        for form in forms:
            if isinstance(form, AgentForm):
                turn, number = form.turn, form.index
            elif (place := self.result_of(form.message["tool_call_id"])) is None:
                made += self.form.made([form.message["tool_call_id"]], text_of(form.message))
                continue
            else:
                turn = self.turns[self.turn_of(place)]
                number = place - self.starts[turn.number]
            at, index = turn.places[number - 1]
            found.setdefault((turn.number, at), {})[index] = form
        for (number, at), shown in found.items():
            turns = (form.turn for form in shown.values() if isinstance(form, AgentForm))
            yield self._result(next(turns, self.turns[number]), at, shown)
        yield from map(self._own, self.form.joined(made))

    def _result(self, turn: AgentTurn, at: int, shown: Mapping[int, Form]) -> Shown:
        part = turn.unit.parts[at]
        whole = self.form.results(as_first_shown(part, self.form))
        contents: list[Any] = [None] * len(whole)
        changes = {"cut"} if part.cost.cut is not None else set[str]()
        for index, form in shown.items():
            contents[index] = whole[index]
            if not isinstance(form, AgentForm):
                contents[index] = text_of(form.message)
                changes.add("rewritten")
            elif form.level == "masked":
                contents[index] = RESULT_LEFT
                changes.add("masked")
            elif form.level == "unpictured" and part.cost.pictures:
                contents[index] = without_pictures(whole[index], PICTURE_LEFT)
                changes.add("elided")
        if len(shown) < len(whole):
            changes.add("rewritten")
        change = next((name for name in ("rewritten", "masked", "elided", "cut") if name in changes), None)
        if change is None:
            return Shown.whole(part, turn.number)
        message = self.form.with_results(part.message, contents)
        assert message is not None
        if change == "rewritten":
            self.rewritten.update([] if part.source is None else [part.source])
            return Shown(part, message, self.messages.tokens(message, self.form), change, turn.number)
        return Shown(part, message, sum(form.tokens(self.counter) for form in shown.values()), change, turn.number)

    def _written(self, message: Message) -> Sequence[Given]:
        """A strategy's own message in the form; calls that the model has made have the ids that it sent."""
        role, text, calls = message["role"], text_of(message), []
        for call in calls_of(message):
            number = self.result_of(call["id"])
            if number is not None:
                replies = self.turns[self.turn_of(number)].unit.replies
                self.rewritten.update(part.source for part in replies if part.source is not None)
            sent = self._given_ids.get(call["id"], call["id"])
            calls.append((sent, call["function"]["name"], call["function"]["arguments"]))
        return self.form.written(role, text, calls)

    def _own(self, message: Given) -> Shown:
        tokens = self.messages.tokens(message, self.form)
        return Shown(Part(None, message), message, tokens)


def grouped(messages: Iterable[T], is_result: Callable[[T], bool]) -> list[list[T]]:
    """Return messages in groups: a reply with its results, or one other message."""
    groups: list[list[T]] = []
    for message in messages:
        if groups and is_result(message):
            groups[-1].append(message)
        else:
            groups.append([message])
    return groups


def words_of(message: Given, form: MessageForm) -> str:
    """Return the words of a message, with a mark for each part that has none."""
    return "".join(told(said.content) for said in form.said(message))


def told(content: Content) -> str:
    """Return content as text."""
    return "".join([content.text, *(f"[{each.get('type')}]" for each in (*content.pictures, *content.closed))])


def calls_in(message: Given, form: MessageForm) -> Iterator[tuple[str, str, str]]:
    """Yield the calls of a message: id, name and arguments."""
    calls = [call for said in form.said(message) for call in said.calls]
    for at, call_id in enumerate(form.calls(message)):
        yield call_id, *(calls[at] if at < len(calls) else (str(message.get("type")), "{}"))
