"""Rewritings: what a compactor returns, as numbers of the conversation's messages, and new messages.

Messages are numbered from the first one after the system message: the task, what the host said before the first reply,
the turns. A message that a compactor returns is one of them if it says the same as that message does or did when it
was given, however it is spelled; it is then shown as it is now. All others are the compactor's own.
"""

from __future__ import annotations

from collections.abc import AsyncIterable, Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, takewhile
from typing import Any, TypeAlias

from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.context.turns import Form
from smartplay_tools.context.view import Piece, Selection
from smartplay_tools.context.window import ContextWindow
from smartplay_tools.errors import InvalidArgumentError, StrategyError
from smartplay_tools.types import arguments
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import (
    THOUGHT_PLACES,
    Message,
    assistant_message,
    calls_of,
    copy_of,
    host_message,
    pictures_of,
    text_and_pictures,
    text_of,
    with_arguments,
)
from smartplay_tools.types.pictures import is_picture

SYSTEM = ("system", "developer")

READ = frozenset({"role", "content", "tool_calls", "tool_call_id"})
"""The fields of a compactor's messages that are read."""

Place: TypeAlias = "int | Form"
"""One message: its number in the conversation, or a message of the compactor's own."""


def _key(place: Place) -> Any:
    return meaning(place.message) if isinstance(place, Form) else place


def flat(pieces: Iterable[Piece]) -> list[Place]:
    """Return the messages of pieces one by one."""
    return [place for piece in pieces for place in ((piece,) if isinstance(piece, Form) else piece)]


def joined(places: Iterable[Place]) -> list[Piece]:
    """Return messages as pieces, those in a row together."""
    pieces: list[Piece] = []
    for place in places:
        if isinstance(place, Form):
            pieces.append(place)
        elif pieces and isinstance(last := pieces[-1], range) and last.stop == place:
            pieces[-1] = range(last.start, place + 1)
        else:
            pieces.append(range(place, place + 1))
    return pieces


def on_record(pieces: Iterable[Piece]) -> list[Any]:
    """Return pieces as a record holds them: the first and the last number of each row, and own messages."""
    return [piece.message if isinstance(piece, Form) else [piece.start, piece.stop - 1] for piece in pieces]


def from_record(recorded: Iterable[Any]) -> list[Piece]:
    """Return the pieces that a record holds."""
    return [range(each[0], each[1] + 1) if isinstance(each, list) else Form(each) for each in recorded]


def length_of(piece: Piece) -> int:
    """Return how many messages a piece has."""
    return 1 if isinstance(piece, Form) else len(piece)


def part_of(pieces: Iterable[Piece], places: range) -> Iterator[Piece]:
    """Yield the messages at places of pieces."""
    start = 0
    for piece in pieces:
        length = length_of(piece)
        first, stop = max(places.start - start, 0), min(places.stop - start, length)
        if first < stop:
            yield piece if isinstance(piece, Form) else piece[first:stop]
        start += length


class Rewriting:
    """What a compactor has made of the messages of a window.

    It is changed by `rewrite` events (`take`), in an episode and in a record alike, and reads what a compactor returns
    or asks (`read`).
    """

    def __init__(self, window: ContextWindow, new_id: Callable[[], str] = str, *, reads_thoughts: bool = False) -> None:
        """`new_id` makes the id of a call in place of one that the compactor has made up.

        With `reads_thoughts` thoughts are a part of what replies say: they stay or leave as they come back.
        """
        self._window, self._new_id, self._reads_thoughts = window, new_id, reads_thoughts
        self._back: list[Piece] = [range(len(window.now))]
        self._seen = len(window.now)
        """What came back last, and the messages since; how many messages the window had then."""
        self.shown: list[Piece] = []
        """What the next prompt to play shows after its head."""
        self._replies: dict[str, int] = {}
        """The replies by the ids of their calls."""
        self._said: dict[Any, list[int]] = {}
        """The other messages by what they say."""
        self._pictures: dict[str, Mapping[str, Any]] = {}
        """The parts that stand for pictures, by their sha256."""
        self._read = 0
        """How many messages these have."""
        self._ids: dict[str, str] = {}
        """The ids that the compactor has made up, and those in their place."""
        self._made: set[str] = set()
        """All ids that were made in place of others."""
        self._marks: dict[Any, Mapping[str, Any]] = {}
        """The fields that the compactor has added to messages, by their numbers, or by what its own ones say."""

    @property
    def pieces(self) -> list[Piece]:
        """What came back last, and the messages since."""
        first, self._seen = self._seen, len(self._window.now)
        if first < self._seen:
            last = self._back[-1] if self._back else None
            if isinstance(last, range) and last.stop == first:
                first = last.start
                self._back.pop()
            self._back.append(range(first, self._seen))
        return self._back

    def take(self, event: Mapping[str, Any]) -> None:
        """Take a `rewrite` event: what came back takes the place of the history, and a part of it is shown."""
        pieces = self.pieces
        if event["messages"] is not None:
            pieces = self._back = from_record(event["messages"])
        if event["shown"] is not None:
            parts = (part_of(pieces, range(first, last + 1)) for first, last in event["shown"])
            self.shown = list(chain.from_iterable(parts))
        if event["task"]:
            roles = (form.message["role"] for form in self.walk(self.shown))
            systems = len([*takewhile(SYSTEM.__contains__, roles)])
            after = range(systems, sum(map(length_of, self.shown)))
            self.shown = [*part_of(self.shown, range(systems)), range(1), *part_of(self.shown, after)]

    def selection(self, question: Sequence[Piece] | None = None) -> Selection:
        """Return what the next prompt to play shows, or a `question`, which names no turns."""
        window, count, pieces = self._window, len(self._window.turns), self.shown if question is None else question
        rows = [] if question is not None else [window.turns_of(row) for row in pieces if isinstance(row, range)]
        *others, run = rows if rows and rows[-1].stop == count else [*rows, range(count, count)]
        before = sorted({turn for each in others for turn in each if turn not in run})
        turns = [*(range(turn, turn + 1) for turn in before), run]
        return Selection(turns, pieces, window.oldest, window.trimmed_before, window.elided)

    def walk(self, pieces: Iterable[Piece]) -> Iterator[Form]:
        """Yield messages as a prompt shows them now one by one."""
        window = self._window
        return chain.from_iterable(
            (window.text(piece),) if isinstance(piece, Form) else map(window.now.__getitem__, piece) for piece in pieces
        )

    def pieces_of(self, made: Any, given: Sequence[Place], *, is_question: bool = False) -> list[Piece]:
        """Return messages as pieces; a `StrategyError` names what is not a message, or cannot be sent.

        Only a question needs a message: without any, a prompt to play shows head and task.
        """
        read = self.read(made, given)
        present = {call["id"] for place in read if isinstance(place, Form) for call in calls_of(place.message)}
        for place in read:
            if isinstance(place, Form):
                self._replace_ids(place.message, present)
        if not is_question:
            for place, message in zip(read, made, strict=True):
                self._mark(place, message)
        if read != list(given):  # what it was given is never at fault
            self._check(read)
        if is_question and not read:
            raise StrategyError("There is no message in the question.")
        return joined(read)

    def given(self, pieces: Iterable[Piece]) -> list[Message]:
        """Return copies of messages as a compactor is given them, with its marks."""
        places = flat(pieces)
        forms = self.walk(joined(places))
        copies: list[Any] = [copy_of(given_form(form.message)) for form in forms]
        for place, copy in zip(places, copies, strict=True):
            copy.update(self._marks.get(_key(place), {}))
        return copies

    def _mark(self, place: Place, message: Mapping[str, Any]) -> None:
        """Keep the fields of a message that are not read, for the compactor's next call."""
        known = (place if isinstance(place, Form) else self._window.now[place]).message
        marks = {name: value for name, value in {**message}.items() if name not in known and name not in READ}
        if marks:
            self._marks[_key(place)] = marks
        else:
            self._marks.pop(_key(place), None)

    def read(self, made: Any, given: Sequence[Place]) -> list[Place]:
        """Return messages one by one, which need not be a whole conversation."""
        check_list(made)
        later: dict[Any, int] = {}
        read: list[Place] = []
        for at, message in reversed([*enumerate(made)]):
            own = self._own(message, at)
            key = None if calls_of(own) or own["role"] == "tool" else meaning(own)
            number = self._number_of(own, given, later=later.get(key, 0))
            later[key] = later.get(key, 0) + 1
            read.append(Form(own) if number is None else self._thought_of(number, message))
        return read[::-1]

    def _thought_of(self, number: int, message: Mapping[str, Any]) -> Place:
        """A message of the conversation, without the thoughts that one who reads them has left out."""
        if not self._reads_thoughts or not THOUGHT_PLACES.isdisjoint(message):
            return number
        turn = self._window.turn_of(number)
        reply = self._window.turns[turn].thoughtless if number == self._window.starts[turn] else None
        return number if reply is None else reply

    def _number_of(self, message: Message, given: Sequence[Place], *, later: int = 0) -> int | None:
        """Return which message another one is; None if it is none of them.

        Of several that say the same it is one of those `given`, from the last one back: the one before `later` others.
        """
        self._look_up()
        if message["role"] == "tool":
            number = self._window.result_of(message["tool_call_id"])
        elif calls := calls_of(message):
            number = self._replies.get(calls[0]["id"])
        elif same := self._said.get(meaning(message)):
            if len(same) > 1:
                same = [*same, *(place for place in given if isinstance(place, int) and place in same)]
            return same[-1 - min(later, len(same) - 1)]
        else:
            return None
        if number is None:
            return None
        wanted = meaning(message)
        return number if any(wanted == meaning(form) for form in self._spelled(number)) else None

    def _spelled(self, number: int) -> Iterator[Message]:
        """The forms in which a message is or was given."""
        now = self._window.now[number].message
        yield given_form(now)
        yield now
        if (item := self._window.item(number)) is not None and now is not item.message:
            yield item.message
            if pictures_of(item.message):
                yield item.elided

    def _look_up(self) -> None:
        """Enter the messages that are new."""
        now = self._window.now
        for number in range(self._read, len(now)):
            message = now[number].message
            if message["role"] == "tool":
                original = message if (item := self._window.item(number)) is None else item.message
                self._pictures |= {part["sha256"]: part for part in pictures_of(original)}
            elif calls := calls_of(message):
                self._replies |= dict.fromkeys((call["id"] for call in calls), number)
            else:
                self._said.setdefault(meaning(message), []).append(number)
        self._read = len(now)

    def _own(self, given: Any, at: int) -> Message:
        """A message in canonical form, with the fields that are read alone."""
        try:
            role, content = given["role"], given.get("content") or ""
            if not isinstance(content, str | list | tuple):
                raise InvalidArgumentError(f"Its content is {type(content).__name__}.")
            pictures = [] if isinstance(content, str) else [part for part in content if is_picture(part)]
            words = content if isinstance(content, str) else [part for part in content if part not in pictures]
            fields = {name: given.get(name) for name in ("tool_calls", "tool_call_id")}
            if role == "assistant":
                thoughts = {name: given[name] for name in THOUGHT_PLACES if self._reads_thoughts and name in given}
                said = {"role": role, "content": words, "tool_calls": fields["tool_calls"]}
                message = assistant_message(said | thoughts)
            else:
                message = host_message({"role": role, "content": words, **fields})
            shown = [picture for part in pictures if (picture := self._picture(part["sha256"])) is not None]
            if len(shown) < len(pictures) or (shown and role not in ("user", "tool")):
                raise InvalidArgumentError("It has a picture that it was not given, or that nobody can be shown there.")
        except (AttributeError, KeyError, TypeError, InvalidArgumentError) as error:
            raise StrategyError(f"Message {at} cannot be sent: {type(error).__name__}: {error}") from None
        text = str(text_of(message))
        message["content"] = [{"type": "text", "text": text}, *shown] if shown else text
        return with_arguments(
            message, [arguments.read(call["function"]["arguments"]).sent for call in calls_of(message)]
        )

    def _picture(self, sha256: str) -> dict[str, Any] | None:
        """Return the part that stands for a picture of the conversation; None for another one."""
        self._look_up()
        part = self._pictures.get(sha256)
        return None if part is None else dict(part)

    def _replace_ids(self, message: Message, present: set[str]) -> None:
        for call in calls_of(message):
            call["id"] = self._id(call["id"], present)
        if message["role"] == "tool":
            message["tool_call_id"] = self._id(message["tool_call_id"], present)

    def _id(self, sent: str, present: set[str]) -> str:
        """The id of a call: its own if it is that of a call that was given, or one that no other call has."""
        self._look_up()
        if sent in self._replies or sent in self._made:
            return sent
        if sent not in self._ids or self._ids[sent] in present:
            self._ids[sent] = self._new_id()
            self._made.add(self._ids[sent])
        return self._ids[sent]

    def _check(self, read: Sequence[Place]) -> None:
        """Raise a `StrategyError` if no provider could take these messages."""
        waiting: list[str] = []
        seen: set[str] = set()
        last = None
        for at, place in enumerate(read):
            message = place.message if isinstance(place, Form) else self._window.now[place].message
            role = message["role"]
            if role == "tool":
                if message["tool_call_id"] not in waiting:
                    raise StrategyError(f"Message {at} is a result without its call.")
                waiting.remove(message["tool_call_id"])
            elif waiting:
                raise StrategyError(f"Message {at} stands between a call and its result.")
            else:
                waiting = [call["id"] for call in calls_of(message)]
                if len({*waiting}) < len(waiting) or not seen.isdisjoint(waiting):
                    raise StrategyError(f"Message {at} has the id of another call.")
                seen.update(waiting)
                if isinstance(place, Form) and not (waiting or text_of(message).strip() or pictures_of(message)):
                    raise StrategyError(f"Message {at} is empty.")
            last = last if role in SYSTEM else role
        if waiting:
            raise StrategyError(f"Message {len(read) - 1} is the last, and a call has no result.")
        if last == "assistant" and read[-1] != len(self._window.now) - 1:
            raise StrategyError(f"Message {len(read) - 1} is the last, and a reply.")


def check_list(made: Any, *, is_question: bool = False) -> None:
    """Raise a `StrategyError` that says what to write, if a compactor's messages are no list."""
    if isinstance(made, list | tuple | GivenHistory):
        return
    kind = type(made).__name__
    if is_question:
        raise StrategyError(
            f"What is yielded is a question, a list of messages, not {kind}: yield [message], and return list(...) of "
            "what takes the place of the history."
        )
    if made is None:
        raise StrategyError("It has returned nothing: return the history, also where it was changed in place.")
    if isinstance(made, AsyncIterable):
        raise StrategyError(f"Messages are a list, not {kind}: ask with `asked`, and return a list.")
    hint = " Return list(...) of it." if isinstance(made, Iterable) and not isinstance(made, str | Mapping) else ""
    raise StrategyError(f"Messages are a list, not {kind}.{hint}")


def given_form(message: Message) -> Message:
    """Return a message as a compactor is given it, to be copied: arguments that are no JSON object read `{}`."""
    if all(object_in(call["function"]["arguments"]) is not None for call in calls_of(message)):
        return message
    given = copy_of(message)
    for call in given["tool_calls"]:
        if object_in(call["function"]["arguments"]) is None:
            call["function"]["arguments"] = "{}"
    return given


def meaning(message: Message) -> Any:
    """Return what two spellings of a message have in common: role, text, pictures, calls and call id."""
    text, pictures = text_and_pictures(message)
    calls = [
        (call["id"], call["function"]["name"], arguments.meaning(arguments.read(call["function"]["arguments"])))
        for call in calls_of(message)
    ]
    call_id = message["tool_call_id"] if message["role"] == "tool" else None
    return message["role"], text, tuple([part["sha256"] for part in pictures]), tuple(calls), call_id
