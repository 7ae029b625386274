"""The window of games over an agent's messages, for strategies that choose turns and compactors that rewrite them.

Every unit of a reading becomes a turn: its reply, or its words, and its results as chat messages of words alone, with
the tokens that the manager counts. So a strategy of games works on the messages of any agent by the code that it has in
games (`context.choosing`, `context.compacting`). What it returns is put back into the form of the agent: a message that
stays is the object that was given. What a manager always shows stays whatever a strategy does (`AgentWindow.kept`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.context.compacting import Compacting
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.context.rewriting import Place, flat, joined, on_record
from smartplay_tools.context.strategies import Strategies
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.context.turns import Form, Item, Turn
from smartplay_tools.context.view import Piece, Selection, ranges_of
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.manager.choice import Shown, as_first_shown, squeezed
from smartplay_tools.manager.counting import RESULT_LEFT, Cost, MessageCounter
from smartplay_tools.manager.forms import Content, Given, MessageForm
from smartplay_tools.manager.reading import Part, Unit
from smartplay_tools.providers.reply_fields import texts_in
from smartplay_tools.types import ResolvedBudget
from smartplay_tools.types.call_ids import CallIds
from smartplay_tools.types.messages import Message, MessageToolCall, calls_of, text_of

__all__ = ["AgentWindow", "Entry", "KeptCompacting", "Lead", "Restored"]

WORDING = Wording(VERSION, {**Wording.of(VERSION).texts, "observation_left": RESULT_LEFT})
"""The sentences of games, with the manager's in place of a result that is too old."""

HIDDEN = "."
"""Stands for thoughts that nobody can read."""

Lead = Sequence[tuple[int, Part]]
"""Messages before the first unit that a compactor is given, each with its place in the head."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A message of a prompt: its number in the window, or a strategy's own message, and how it is shown."""

    place: Place
    form: Form


class AgentWindow(ContextWindow):
    """A window over units. `kept` are the turns that every prompt shows, beside the newest."""

    def __init__(
        self, budget: ResolvedBudget, counter: TokenCounter, messages: MessageCounter, form: MessageForm, lead: Lead
    ) -> None:
        self.form, self._messages, self.ids = form, messages, CallIds()
        self.kept: frozenset[int] = frozenset()
        self.shows_thoughts = False
        """Whether the strategy is given thoughts."""
        self.thoughtless: dict[int, int] = {}
        """The turns by the identity of their replies as they are without thoughts."""
        self.places: list[list[tuple[int, int]]] = []
        """For each turn, which part of its unit each of its results is in, and which result of the part it is."""
        self.given_ids: dict[str, str] = {}
        """The ids that the model has sent, by those in the window, of which none comes twice."""
        said: list[Message] = [
            {"role": part.message["role"], "content": words_of(part.message, form)} for _, part in lead
        ]
        super().__init__([], (), budget, counter, Strategies(budget, counter, WORDING), lead=said)
        for form_of_lead, (_, part) in zip(self.now, lead, strict=True):
            form_of_lead.is_counted(counter, part.cost.whole)

    @property
    def always(self) -> set[int]:
        """The turns that every prompt shows."""
        return {*self.kept, len(self.turns) - 1}

    @property
    def always_tokens(self) -> int:
        """The tokens of the head and of these turns."""
        turns = sum(self.tokens(self.row(turn, turn + 1)) for turn in self.always)
        return self.head_tokens + self.tokens(range(self.starts[0])) + turns

    def add_unit(self, unit: Unit, step: int, *, ages: bool) -> None:
        """Add a unit as a turn; `step` is how many units with results there are up to it."""
        replies = [part for part in unit.parts if not part.cost.is_result]
        first, number, items = replies[0].message, len(self.turns), list[Item]()
        text = "".join(filter(None, (words_of(part.message, self.form) for part in replies)))
        assistant: Message = {"role": first.get("role", "assistant"), "content": text}
        ids: dict[str, list[str]] = {}
        if unit.kind == "reply":
            assistant = {"role": "assistant", "content": text}
            called = [call for part in replies for call in calls_in(part.message, self.form)]
            taken = self.ids.take([call_id for call_id, _, _ in called], number)
            for (call_id, _, _), mine in zip(called, taken, strict=True):
                ids.setdefault(call_id, []).append(mine)
                self.given_ids[mine] = call_id
            calls: list[MessageToolCall] = [
                {"id": mine, "type": "function", "function": {"name": name, "arguments": arguments}}
                for mine, (_, name, arguments) in zip(taken, called, strict=True)
            ]
            if calls:
                assistant["tool_calls"] = calls
            if self.shows_thoughts and any(self.form.thinks(part.message) for part in replies):
                assistant["reasoning_content"] = "".join(map(self._thoughts, replies)) or HIDDEN
            trimmed = sum(part.cost.trimmed for part in replies)
            if self.strategies.trimming is not None and trimmed != sum(part.cost.whole for part in replies):
                assistant["reasoning_content"] = HIDDEN  # thoughts that only the form knows leave with the words
        places: list[tuple[int, int]] = []
        for at, part in enumerate(unit.parts):
            if not part.cost.is_result:
                continue
            for index, (call_id, text) in enumerate(
                zip(self.form.answers(part.message), self._told(part), strict=True)
            ):
                message: Message = {"role": "tool", "content": text, "tool_call_id": ids[call_id].pop(0)}
                if self.shows_thoughts and self._beside(part):
                    message["name"] = "user"  # whose words end a turn
                date = step if ages else None
                items.append(Item(message, step, date, len(places), words=WORDING))
                places.append((at, index))
        self.places.append(places)
        whole = sum(part.cost.whole for part in replies)
        turn = Turn(number, assistant, tuple(items), step, reply_tokens=whole)
        self._count(turn, unit)
        if turn.thoughtless is not None:
            self.thoughtless[id(turn.thoughtless.message)] = number
        self.append(turn)

    def _thoughts(self, part: Part) -> str:
        """What can be read of the thoughts of a message, and of what stands beside its words."""
        others = (other for said in self.form.said(part.message) for other in (*said.others, *said.content.others))
        return "".join(text for other in others for text in texts_in(dict(other)))

    def edited(self, form: Form) -> int | None:
        """Return the turn of whose reply a strategy has changed no words; None for any other message."""
        message = form.message
        if (turn := self.thoughtless.get(id(message))) is not None:
            return turn
        calls = calls_of(message)
        number = self.result_of(calls[0]["id"]) if calls else None
        if number is None:
            return None
        said = self.turns[turn := self.turn_of(number)].shown
        is_same = [call["id"] for call in calls_of(said)] == [call["id"] for call in calls]
        return turn if is_same and text_of(said) == text_of(message) else None

    def _count(self, turn: Turn, unit: Unit) -> None:
        """Give the messages of a turn the tokens that the manager has counted."""
        counter, numbers = self.counter, range(1, len(turn.whole))
        for forms, masked in ((turn.whole, False), (turn.masked, True)):
            sizes = self._sizes(unit, {}, masked=masked)
            for number in numbers:
                forms[number].is_counted(counter, sizes[number - 1])
        if turn.calls:
            turn.trimmed.is_counted(counter, sum(part.cost.trimmed for part in unit.parts))

    def _sizes(
        self, unit: Unit, changed: Mapping[int, tuple[Sequence[Any], int]], *, masked: bool = False
    ) -> list[int]:
        """The tokens of each result of a unit, which add up to those of its messages."""
        sizes: list[int] = []
        for at, part in enumerate(unit.parts):
            if not part.cost.is_result:
                continue
            total = part.cost.masked if masked else changed[at][1] if at in changed else part.cost.whole
            texts = [RESULT_LEFT] * len(self.form.results(part.message)) if masked else self._told(part)
            own = [self.counter.message({"role": "tool", "content": text}) for text in texts[:-1]]
            sizes += [*own, total - sum(own)]
        return sizes

    def _told(self, part: Part) -> list[str]:
        """The results of a message as text; words that stand beside them are a part of the last."""
        message = as_first_shown(part, self.form)
        texts = [told(Content.of(content)) for content in self.form.results(message)]
        if beside := self._beside(part):
            texts[-1] = f"{texts[-1]}\n{beside}"
        return texts

    def _beside(self, part: Part) -> str:
        """The words that stand beside the results of a message."""
        return "".join(told(said.content) for said in self.form.said(part.message) if said.role != "tool")

    def counted(self, message: Given, *, opens: bool = True) -> int:
        """Return the tokens of a message of the agent's form; `opens` says whether a reply begins with it."""
        return self._messages.tokens(message, self.form, opens=opens)

    def squeeze(self, unit: Unit, room: int) -> dict[int, tuple[Sequence[Any], int]]:
        """Show the newest turn with shorter results, until `whole_again`; return these, nothing if none would do."""
        made = squeezed(unit, room, self.form, self._messages)
        if made:
            turn, start = self.turns[-1], self.starts[-2]
            texts = [
                text
                for at, part in enumerate(unit.parts)
                if at in made
                for text in self._squeezed_texts(part, made[at])
            ]
            for number, (text, size) in enumerate(zip(texts, self._sizes(unit, made), strict=True), 1):
                form = Form(
                    {**turn.whole[number].message, "content": text}, turn.number, position=number - 1, step=turn.step
                )
                form.is_counted(self.counter, size)
                self.now[start + number] = form
            del self._sums[start + 1 :]
        return made

    def _squeezed_texts(self, part: Part, made: tuple[Sequence[Any], int]) -> list[str]:
        shorter = self.form.with_results(part.message, made[0])
        assert shorter is not None
        return self._told(Part(part.source, shorter, Cost(0)))

    def whole_again(self) -> None:
        """Show the newest turn as it was added."""
        start = self.starts[-2]
        self.now[start:] = self.turns[-1].whole
        del self._sums[start + 1 :]


class KeptCompacting(Compacting):
    """The rule of a compactor over an agent's messages: what every prompt shows stays, whatever comes back.

    What is missing of it is put back where it stood. While the prompt is over its cap, units leave it, oldest first,
    and then the messages before the first reply. A unit that stays and was made too long is shown as it was given.
    """

    def __init__(self, window: AgentWindow, compactor: Any, restored: Restored) -> None:
        super().__init__(window, compactor, ids=window.ids)
        self._agent, self._restored = window, restored

    def untouched(self) -> Selection:
        """Return what a prompt shows where the compactor is not called."""
        return self._to_play(self._history.pieces)

    def _to_play(self, pieces: list[Piece]) -> Selection:
        window, cap = self._agent, self._window.budget.prompt_tokens
        groups = grouped(window, self._with_kept(flat(pieces)))
        sizes = [self._group_tokens(group) for group in groups]
        total, shown = window.head_tokens + sum(sizes), [True] * len(groups)
        firsts = (at for at, group in enumerate(groups) if message_at(window, group[0])["role"] == "assistant")
        first = next(firsts, len(groups))
        for at in (*range(first, len(groups)), *range(first)):
            if cap is None or total <= cap:
                break
            if not self._is_kept(groups[at]):
                shown[at], total = False, total - sizes[at]
        for at, group in enumerate(groups):
            if cap is None or total <= cap:
                break
            if any(isinstance(place, Form) for place in group) and self._is_kept(group):  # it has made it longer
                turn = next(window.turn_of(n) for place in group if (n := self._number(place)) is not None)
                groups[at] = [*window.row(turn, turn + 1)]
                total += self._group_tokens(groups[at]) - sizes[at]
        numbers, start = list[int](), 0
        for group, stays in zip(groups, shown, strict=True):
            numbers += range(start, start + len(group)) if stays else ()
            start += len(group)
        back = joined(place for group in groups for place in group)
        self._history.take({"messages": on_record(back), "shown": ranges_of(numbers), "task": False})
        self._played = total
        return self._history.selection()

    def _with_kept(self, places: Sequence[Place]) -> list[Place]:
        """Return messages with those that every prompt shows; the head comes first."""
        window = self._agent
        found = [place for place in places if isinstance(place, Form) or place >= window.starts[0]]
        there = {window.turn_of(number) for place in found if (number := self._number(place)) is not None}
        for turn in sorted(window.always - there):
            row = window.row(turn, turn + 1)
            later = (at for at, place in enumerate(found) if (n := self._number(place)) is not None and n >= row.stop)
            at = next(later, len(found))
            found[at:at] = row
        return [*range(window.starts[0]), *found]

    def _number(self, place: Place) -> int | None:
        """The number of a message, or of the one in whose place it stands."""
        if not isinstance(place, Form):
            return place
        message = place.message
        if (turn := self._agent.edited(place)) is not None:
            return self._window.starts[turn]
        if message["role"] == "tool":
            return self._window.result_of(message["tool_call_id"])
        ids = (self._window.result_of(call["id"]) for call in calls_of(message))
        return next((number for number in ids if number is not None), None)

    def _is_kept(self, group: Sequence[Place]) -> bool:
        numbers = [number for place in group if (number := self._number(place)) is not None]
        return any(
            number < self._window.starts[0] or self._window.turn_of(number) in self._agent.always for number in numbers
        )

    def _group_tokens(self, group: Sequence[Place]) -> int:
        window = self._agent
        if not any(isinstance(place, Form) for place in group):
            return sum(window.now[place].tokens(window.counter) for place in group if not isinstance(place, Form))
        entries = [Entry(p, window.text(p) if isinstance(p, Form) else window.now[p]) for p in group]
        return sum(each.tokens for each, _ in self._restored.group(entries))


class Restored:
    """Puts what a window shows back into the form of the agent, with the objects that were given."""

    def __init__(self, window: AgentWindow, units: Sequence[Unit], lead: Lead) -> None:
        self._window, self._lead, self._form = window, lead, window.form
        self.units = units
        """Those of the turns, as they are now."""
        self.squeezed: Mapping[int, tuple[Sequence[Any], int]] = {}
        """What is shorter in the newest unit, by its parts."""
        self.rewritten: set[int] = set()
        """The messages in whose place a strategy has put its own."""

    def all(self, entries: Iterable[Entry]) -> Iterator[tuple[Shown, int | None]]:
        """Yield messages of a prompt, each with its turn; None for one that the strategy has made."""
        by_place = [*entries]
        start = 0
        for group in grouped(self._window, [entry.place for entry in by_place]):
            yield from self.group(by_place[start : start + len(group)])
            start += len(group)

    def group(self, entries: Sequence[Entry]) -> Iterator[tuple[Shown, int | None]]:
        """Yield a reply with its results, or one other message."""
        first, *results = entries
        if first.form.message["role"] == "tool":  # of a reply that the strategy has put elsewhere; never sent
            results = [*entries]
        elif isinstance(first.place, Form) and (turn := self._window.edited(first.form)) is not None:
            yield from self._edited(turn, first.form.message)
        elif isinstance(first.place, Form):
            yield from ((self._own(message), None) for message in self._written(first.form.message))
        elif first.place < self._window.starts[0]:
            part = self._lead[first.place][1]
            yield Shown(part, part.message), None
        else:
            yield from self._replied(first.place, first.form)
        yield from self._results(results)

    def _replied(self, number: int, form: Form) -> Iterator[tuple[Shown, int | None]]:
        turn = self._window.turn_of(number)
        is_trimmed = form is not self._window.turns[turn].whole[0]
        for part in self.units[turn].parts:
            if part.cost.is_result:
                continue
            if not is_trimmed:
                yield Shown(part, part.message), turn
            elif (shorter := self._form.trimmed(part.message)) is not None:
                yield Shown(part, shorter, part.cost.trimmed, "trimmed"), turn

    def _edited(self, turn: int, message: Message) -> Iterator[tuple[Shown, int | None]]:
        """Yield a reply with the arguments of another message, and with thoughts only if that has some."""
        window, opens = self._window, True
        arguments = {window.given_ids[call["id"]]: call["function"]["arguments"] for call in calls_of(message)}
        thoughts = not window.shows_thoughts or "reasoning_content" in message
        for part in self.units[turn].parts:
            edited = None if part.cost.is_result else self._form.edited(part.message, arguments, thoughts=thoughts)
            if edited is None:
                continue
            tokens, opens = window.counted(edited, opens=opens), False
            if edited == part.message:
                yield Shown(part, part.message, tokens), turn
                continue
            yield Shown(part, edited, tokens, "rewritten"), turn
            self.rewritten.update([] if part.source is None else [part.source])

    def _results(self, entries: Sequence[Entry]) -> Iterator[tuple[Shown, int | None]]:
        """Yield the messages with these results: those of one message that was given are in one again."""
        window, found = self._window, dict[tuple[int, int], dict[int, Entry]]()
        made: list[Given] = []
        for entry in entries:
            call_id = entry.form.message["tool_call_id"]
            number = entry.place if not isinstance(entry.place, Form) else window.result_of(call_id)
            if number is None:
                made += self._form.made([call_id], text_of(entry.form.message))
                continue
            turn = window.turn_of(number)
            at, index = window.places[turn][number - window.starts[turn] - 1]
            found.setdefault((turn, at), {})[index] = entry
        for (turn, at), shown in found.items():
            yield self._result(turn, at, shown), turn
        yield from ((self._own(message), None) for message in self._form.joined(made))

    def _result(self, turn: int, at: int, shown: Mapping[int, Entry]) -> Shown:
        part, squeezed = self.units[turn].parts[at], None
        if turn == len(self._window.turns) - 1:
            squeezed = self.squeezed.get(at)
        whole = self._form.results(as_first_shown(part, self._form)) if squeezed is None else squeezed[0]
        contents: list[Any] = [None] * len(whole)
        changes = {"cut"} if squeezed is not None or part.cost.cut is not None else set[str]()
        for index, entry in shown.items():
            contents[index] = whole[index]
            if isinstance(entry.place, Form):
                contents[index] = text_of(entry.form.message)
                changes.add("rewritten")
            elif text_of(entry.form.message) == RESULT_LEFT:
                contents[index] = RESULT_LEFT
                changes.add("masked")
        if len(shown) < len(whole):
            changes.add("rewritten")
        change = next((name for name in ("rewritten", "masked", "cut") if name in changes), None)
        if change is None:
            return Shown(part, part.message)
        message = self._form.with_results(part.message, contents)
        assert message is not None
        if part.source is not None and change == "rewritten":
            self.rewritten.add(part.source)
        return Shown(part, message, self._window.counted(message), change)

    def _written(self, message: Message) -> Sequence[Given]:
        """A strategy's own message in the form; calls that the model has made have the ids that it sent."""
        role, text, calls = message["role"], text_of(message), []
        for call in calls_of(message):
            number = self._window.result_of(call["id"])
            if number is not None:
                parts = self.units[self._window.turn_of(number)].parts
                self.rewritten.update(p.source for p in parts if p.source is not None and not p.cost.is_result)
            sent = self._window.given_ids.get(call["id"], call["id"])
            calls.append((sent, call["function"]["name"], call["function"]["arguments"]))
        return self._form.written(role, text, calls)

    def _own(self, message: Given) -> Shown:
        return Shown(Part(None, message, Cost(self._window.counted(message))), message)


def message_at(window: ContextWindow, place: Place) -> Message:
    """Return a message by its number, or a strategy's own."""
    return place.message if isinstance(place, Form) else window.now[place].message


def grouped(window: ContextWindow, places: Iterable[Place]) -> list[list[Place]]:
    """Return messages in groups: a reply with its results, or one other message."""
    groups: list[list[Place]] = []
    for place in places:
        if groups and message_at(window, place)["role"] == "tool":
            groups[-1].append(place)
        else:
            groups.append([place])
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
