"""Rewritings: what a compactor returns, as numbers of the conversation's messages, and new messages.

Messages are numbered from the first one after the system message: the task, what the host said before the first reply,
the turns. A message that a compactor returns is one of them if it says the same as that message does or did when it
was given, however it is spelled; it is then shown as it is now. All others are the compactor's own.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, takewhile
from typing import Any, TypeAlias

from smartplay_tools.context.compaction import GivenHistory
from smartplay_tools.context.turns import Item, Turn
from smartplay_tools.errors import InvalidArgumentError, StrategyError
from smartplay_tools.transcript.hashing import head_bytes
from smartplay_tools.types import arguments
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import (
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


@dataclass(frozen=True)
class Own:
    """A message of the compactor's own."""

    message: Message


Piece: TypeAlias = "range | Own"
"""Messages of the conversation in a row, or a message of the compactor's own."""

Place: TypeAlias = "int | Own"
"""One message: its number in the conversation, or a message of the compactor's own."""


def flat(pieces: Iterable[Piece]) -> list[Place]:
    """Return the messages of pieces one by one."""
    return [place for piece in pieces for place in ((piece,) if isinstance(piece, Own) else piece)]


def joined(places: Iterable[Place]) -> list[Piece]:
    """Return messages as pieces, those in a row together."""
    pieces: list[Piece] = []
    for place in places:
        if isinstance(place, Own):
            pieces.append(place)
        elif pieces and isinstance(last := pieces[-1], range) and last.stop == place:
            pieces[-1] = range(last.start, place + 1)
        else:
            pieces.append(range(place, place + 1))
    return pieces


def on_record(pieces: Iterable[Piece]) -> list[Any]:
    """Return pieces as a record holds them: the first and the last number of each row, and own messages."""
    return [piece.message if isinstance(piece, Own) else [piece.start, piece.stop - 1] for piece in pieces]


def from_record(recorded: Iterable[Any]) -> list[Piece]:
    """Return the pieces that a record holds."""
    return [range(each[0], each[1] + 1) if isinstance(each, list) else Own(each) for each in recorded]


class NumberedMessages:
    """The messages of a conversation by their numbers, as they are shown now."""

    def __init__(self, head: Sequence[Message]) -> None:
        """`head` is the messages before the first reply, without the system message."""
        self.now: list[Message] = list(head)
        """Every message as a prompt shows it now."""
        self.steps: list[int | None] = [None] * len(head)
        """The observation that each message shows now, None for none."""
        self._lines: list[bytes | None] = [None] * len(head)
        """The canonical JSON of each, as far as it was asked for."""
        self._turns: list[Turn] = []
        self._starts = [len(head)]
        """The number of the first message of each turn, and the number that comes next."""
        self._oldest = self._pictures = self._aged = 0
        """What is masked and left out (`age`), and the first turn that can still change by it."""
        self._results: dict[str, int] = {}
        """The results by the ids of their calls, as far as they were looked up."""
        self._replies: dict[str, int] = {}
        """The replies by the ids of their calls."""
        self._texts: dict[Any, list[int]] = {}
        """The other messages by what they say."""
        self._shown: dict[str, Mapping[str, Any]] = {}
        """The parts that stand for pictures, by their sha256."""
        self._read = 0
        """How many messages these have."""

    def append(self, turn: Turn) -> None:
        """Add a turn, nothing of which is masked yet."""
        self._turns.append(turn)
        self.now += turn.messages
        self.steps += (None, *[item.observation_step for item in turn.items])
        self._lines += [None] * len(turn.messages)
        self._starts.append(len(self.now))

    def age(self, oldest: int, pictures: int) -> list[range]:
        """Mask observations before the oldest, and leave out the first pictures; return the numbers that may change."""
        changed: list[range] = []
        if (oldest, pictures) == (self._oldest, self._pictures):
            return changed
        before, self._oldest, self._pictures = self._pictures, oldest, pictures
        for index in range(self._aged, len(self._turns)):
            turn, numbers = self._turns[index], range(self._starts[index], self._starts[index + 1])
            pictured = turn.first_picture + len(turn.pictured)
            if turn.is_young(oldest) and pictured <= before:
                continue  # its pictures were left out before, and it is not masked yet
            self.now[numbers.start : numbers.stop] = seen = turn.seen(oldest, pictures=pictures)
            shows = [
                None if item.is_masked(m) else item.observation_step
                for item, m in zip(turn.items, seen[1:], strict=True)
            ]
            self.steps[numbers.start : numbers.stop] = [None, *shows]
            self._lines[numbers.start : numbers.stop] = [None] * len(numbers)
            changed.append(numbers)
            if turn.step < oldest:
                self._aged = index + 1
            elif turn.is_young(oldest) and pictured >= pictures:
                break  # and so is every later turn
        return changed

    def turns_of(self, numbers: range) -> range:
        """Return the turns that messages in a row belong to."""
        first, last = (bisect_right(self._starts, number) - 1 for number in (numbers.start, numbers.stop - 1))
        return range(max(first, 0), last + 1)

    def item(self, number: int) -> Item | None:
        """Return the item that a message is; None for replies, and for messages before the first one."""
        turn = bisect_right(self._starts, number) - 1
        if turn < 0 or number == self._starts[turn]:
            return None
        return self._turns[turn].items[number - self._starts[turn] - 1]

    def role(self, place: Place) -> str:
        """Return the role of a message."""
        return (place.message if isinstance(place, Own) else self.now[place])["role"]

    def shown(self, piece: Piece) -> list[Message]:
        """Return messages as a prompt shows them now."""
        return [self._own(piece)] if isinstance(piece, Own) else self.now[piece.start : piece.stop]

    def lines(self, piece: Piece) -> list[bytes]:
        """Return the canonical JSON of `shown`."""
        if isinstance(piece, Own):
            return [head_bytes(self._own(piece))]
        lines = self._lines[piece.start : piece.stop]
        if None in lines:
            for number in piece:
                if self._lines[number] is None:
                    self._lines[number] = self._line(number)
            lines = self._lines[piece.start : piece.stop]
        return lines  # type: ignore[return-value]

    def _line(self, number: int) -> bytes:
        if (turn := bisect_right(self._starts, number) - 1) < 0:
            return head_bytes(self.now[number])
        seen = self._turns[turn].canonical_seen(self._oldest, pictures=self._pictures)
        return seen[number - self._starts[turn]]

    def _own(self, own: Own) -> Message:
        """An own message as it is shown: a result has the date of its call, whatever its text has become."""
        message = own.message
        number = self.result_of(message["tool_call_id"]) if message["role"] == "tool" else None
        if number is None or (item := self.item(number)) is None:
            return message
        is_masked = item.is_masked(self.now[number])
        if is_masked or (self.now[number] is not item.message and pictures_of(message)):
            text = "" if is_masked else text_of(message)
            return {**message, "content": text or item.masked["content"]}
        return message

    def result_of(self, call_id: str) -> int | None:
        """Return the result of a call of the conversation; None for another id."""
        self._look_up()
        return self._results.get(call_id)

    def has_id(self, call_id: str) -> bool:
        """Whether a call of the conversation has this id."""
        self._look_up()
        return call_id in self._replies

    def picture(self, sha256: str) -> dict[str, Any] | None:
        """Return the part that stands for a picture of the conversation; None for another one."""
        self._look_up()
        part = self._shown.get(sha256)
        return None if part is None else dict(part)

    def number_of(self, message: Message, given: Sequence[Place], *, later: int = 0) -> int | None:
        """Return which message another one is; None if it is none of them.

        Of several that say the same it is one of those `given`, from the last one back: the one before `later` others.
        """
        self._look_up()
        if message["role"] == "tool":
            number = self._results.get(message["tool_call_id"])
        elif calls := calls_of(message):
            number = self._replies.get(calls[0]["id"])
        elif same := self._texts.get(meaning(message)):
            if len(same) > 1:
                same = [*same, *(place for place in given if isinstance(place, int) and place in same)]
            return same[-1 - min(later, len(same) - 1)]
        else:
            return None
        if number is None:
            return None
        wanted = meaning(message)
        return number if any(wanted == meaning(form) for form in self._forms(number)) else None

    def _forms(self, number: int) -> Iterator[Message]:
        """The forms in which a message is or was given."""
        yield given_form(self.now[number])
        yield self.now[number]
        if (item := self.item(number)) is not None and self.now[number] is not item.message:
            yield item.message
            if pictures_of(item.message):
                yield item.unpictured

    def _look_up(self) -> None:
        """Enter the messages that are new."""
        for number in range(self._read, len(self.now)):
            message = self.now[number]
            if message["role"] == "tool":
                self._results[message["tool_call_id"]] = number
                original = message if (item := self.item(number)) is None else item.message
                self._shown |= {part["sha256"]: part for part in pictures_of(original)}
            elif calls := calls_of(message):
                self._replies |= dict.fromkeys((call["id"] for call in calls), number)
            else:
                self._texts.setdefault(meaning(message), []).append(number)
        self._read = len(self.now)


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


@dataclass
class Reader:
    """Reads what a compactor returns or asks."""

    messages: NumberedMessages
    new_id: Callable[[], str]
    """Makes the id of a call in place of one that the compactor has made up."""
    _ids: dict[str, str] = field(default_factory=dict)
    """The ids that it has made up, and those in their place."""
    _made: set[str] = field(default_factory=set)
    """All ids that were made in place of others."""

    def pieces(self, made: Any, given: Sequence[Place]) -> list[Piece]:
        """Return messages as pieces; a `StrategyError` names what is not a message, or cannot be sent."""
        read = self.read(made, given)
        present = {call["id"] for place in read if isinstance(place, Own) for call in calls_of(place.message)}
        for place in read:
            if isinstance(place, Own):
                self._replace_ids(place.message, present)
        if read != list(given):  # what it was given is never at fault
            self._check(read)
        return joined(read)

    def read(self, made: Any, given: Sequence[Place]) -> list[Place]:
        """Return messages one by one, which need not be a whole conversation."""
        if not isinstance(made, list | tuple | GivenHistory):
            raise StrategyError(f"Messages are a list, not {type(made).__name__}.")
        later: dict[Any, int] = {}
        read: list[Place] = []
        for at, message in reversed([*enumerate(made)]):
            own = self._own(message, at)
            key = None if calls_of(own) or own["role"] == "tool" else meaning(own)
            number = self.messages.number_of(own, given, later=later.get(key, 0))
            later[key] = later.get(key, 0) + 1
            read.append(Own(own) if number is None else number)
        return read[::-1]

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
                message = assistant_message({"role": role, "content": words, "tool_calls": fields["tool_calls"]})
            else:
                message = host_message({"role": role, "content": words, **fields})
            shown = [picture for part in pictures if (picture := self.messages.picture(part["sha256"])) is not None]
            if len(shown) < len(pictures) or (shown and role not in ("user", "tool")):
                raise InvalidArgumentError("It has a picture that it was not given, or that nobody can be shown there.")
        except (AttributeError, KeyError, TypeError, InvalidArgumentError) as error:
            raise StrategyError(f"Message {at} cannot be sent: {type(error).__name__}: {error}") from None
        text = str(text_of(message))
        message["content"] = [{"type": "text", "text": text}, *shown] if shown else text
        return with_arguments(
            message, [arguments.read(call["function"]["arguments"]).sent for call in calls_of(message)]
        )

    def _replace_ids(self, message: Message, present: set[str]) -> None:
        for call in calls_of(message):
            call["id"] = self._id(call["id"], present)
        if message["role"] == "tool":
            message["tool_call_id"] = self._id(message["tool_call_id"], present)

    def _id(self, sent: str, present: set[str]) -> str:
        """The id of a call: its own if it is that of a call that was given, or one that no other call has."""
        if self.messages.has_id(sent) or sent in self._made:
            return sent
        if sent not in self._ids or self._ids[sent] in present:
            self._ids[sent] = self.new_id()
            self._made.add(self._ids[sent])
        return self._ids[sent]

    def _check(self, read: Sequence[Place]) -> None:
        """Raise a `StrategyError` if no provider could take these messages."""
        waiting: list[str] = []
        seen: set[str] = set()
        last = None
        for at, place in enumerate(read):
            message = place.message if isinstance(place, Own) else self.messages.now[place]
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
                if isinstance(place, Own) and not (waiting or text_of(message).strip() or pictures_of(message)):
                    raise StrategyError(f"Message {at} is empty.")
            last = last if role in SYSTEM else role
        if waiting:
            raise StrategyError(f"Message {len(read) - 1} is the last, and a call has no result.")
        if not read:
            raise StrategyError("There is no message.")
        if last == "assistant":
            raise StrategyError(f"Message {len(read) - 1} is the last, and a reply.")


class Rewriting:
    """The history of a record that a compactor has rewritten, rebuilt without the compactor."""

    def __init__(self, head: Sequence[Message]) -> None:
        """`head` is the messages before the first reply, without the system message."""
        self._messages = NumberedMessages(head)
        self._turns = self._known = 0
        """How many turns are read, and how many messages the history has had so far."""
        self._history: list[Place] = []
        """What came back last, and the messages since."""
        self._pieces: list[Piece] = []
        """What the next prompt to play shows."""

    def take(self, event: Mapping[str, Any], turns: Sequence[Turn]) -> None:
        """Take a `rewrite` event."""
        self._read(event["turn"], turns)
        self._history += range(self._known, len(self._messages.now))
        self._known = len(self._messages.now)
        if event["messages"] is not None:
            self._history = flat(from_record(event["messages"]))
        if event["shown"] is not None:
            places = [place for first, last in event["shown"] for place in self._history[first : last + 1]]
            if event["task"]:
                systems = takewhile(lambda place: self._messages.role(place) in SYSTEM, places)
                places.insert(len([*systems]), 0)
            self._pieces = joined(places)

    def shown(self, view: Mapping[str, Any], turns: Sequence[Turn]) -> tuple[list[Message], list[bytes]]:
        """Return the messages of a prompt after its head, and their canonical JSON."""
        self._read(view["turn"], turns)
        self._messages.age(view["oldest"], view.get("pictures", 0))
        pieces = from_record(view["messages"]) if "messages" in view else self._pieces
        messages = chain.from_iterable(map(self._messages.shown, pieces))
        return list(messages), list(chain.from_iterable(map(self._messages.lines, pieces)))

    def _read(self, stop: int, turns: Sequence[Turn]) -> None:
        for turn in turns[self._turns : stop]:
            self._messages.append(turn)
        self._turns = stop
