"""What a record's player was sent, as a cache sees it: sequences of units, equal ones with the same number.

The units of a request are the tools as one, then each message. Inside the first unit that differs nothing is common: a
head to which the manual is added counts as new from there on. Priming belongs to no unit, since no request shares it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import accumulate, compress, count
from operator import is_not, ne
from typing import Any, NamedTuple

from smartplay_tools.context.turns import Turn, with_ids
from smartplay_tools.conversation import paper
from smartplay_tools.errors import TranscriptError
from smartplay_tools.messages import Message, calls_of, reasoning_of, text_of
from smartplay_tools.records.prompts import Rebuilder
from smartplay_tools.records.record import Record
from smartplay_tools.tokens import TokenCounter, Tokenizer
from smartplay_tools.tokens.counter import shared_counter
from smartplay_tools.transcript.events import Event
from smartplay_tools.transcript.hashing import canonical_json, tools_bytes
from smartplay_tools.transcript.times import read_times, times_file
from smartplay_tools.types import Purpose, ToolSpec, Usage


class Request(NamedTuple):
    """A prompt that had a reply. Tokens are the provider's where it counted them, else budget tokens."""

    units: tuple[int, ...]
    """The tools and the messages."""
    ends: tuple[int, ...]
    """Tokens up to the end of each unit, after a 0."""
    blocks: tuple[int, ...]
    """Content blocks likewise: a text, a call, a result and the reasoning of a reply are one each."""
    system: int
    """How many units are the tools or one of the system messages at the beginning."""
    stable: int
    """How many units end with the last message that is unchanged since the request before; 0 if none is."""
    purpose: Purpose
    prompt: int
    """Tokens of the prompt, priming included."""
    reply: int
    """Tokens of the reply."""
    answer: int
    """The unit that the reply is where it is shown again."""
    answered: int
    """Tokens up to the end of that unit."""
    score: float
    """The score when it was sent."""
    at: float | None
    """When it was sent, in seconds, if the times of the record were kept."""


@dataclass(frozen=True)
class RequestLog:
    """The requests of an episode, in order."""

    requests: Sequence[Request]
    ratio: Fraction | None
    """The provider's tokens of a prompt to a budget token; None if the provider counted none."""
    _paths: dict[bool, tuple[list[list[int]], list[int]]] = field(default_factory=dict, repr=False, compare=False)

    def paths(self, *, by_purpose: bool) -> tuple[list[list[int]], list[int]]:
        """Return a number for every prefix of every request that ends with a unit, and for each request with its reply.

        Equal prefixes have the same number. With `by_purpose`, requests with different purposes have no prefix in
        common that is longer than their system messages.
        """
        by_purpose = by_purpose and any(request.purpose != "play" for request in self.requests)
        if by_purpose not in self._paths:
            self._paths[by_purpose] = _numbered(self.requests, by_purpose=by_purpose)
        return self._paths[by_purpose]


def requests_of(record: Record, *, tokenizer: str | Tokenizer | None = None) -> RequestLog:
    """Return the requests of a record.

    `tokenizer` is required if the record was counted with a tokenizer object of yours. A record that has no prompts, or
    prompts without usage, is a `TranscriptError`.
    """
    usages = {(event["turn"], event.get("purpose", "play")): event for event in record.usages if "prompt" in event}
    if record.start is None or not record.heads:
        raise TranscriptError(f"{_called(record)} has no prompts: its episode was played with the host's own context.")
    if not usages and record.messages:
        raise TranscriptError(f"{_called(record)} has no usage, so nothing can be said about its cost.")
    units = _Units(shared_counter(tokenizer or record.start["config"].get("tokenizer")))
    views = [number for number, event in enumerate(record.events) if event["event"] == "view"]
    times = _times(record)
    prompts = {
        (view["turn"], view.get("purpose", "play")): (prompt, times[number])
        for number, (view, prompt) in zip(views, units.prompts(record), strict=True)
    }
    replies, ratio = units.replies(record), _ratio(usages.values())
    scores = {event["turn"]: float(event["data"]["score"]) for event in record.calls if "score" in event["data"]}
    requests: list[Request] = []
    sums, score = _Sums(), 0.0
    for key, (prompt, at) in prompts.items():
        score = scores.get(key[0] - 1, score)
        if key in usages and key in replies:
            stable = sums.move_to(prompt)
            requests.append(_request(sums, stable, replies[key], usages[key], ratio, score, at))
    return RequestLog(requests, ratio)


def _called(record: Record) -> str:
    return record.name or "The record"


def _times(record: Record) -> Sequence[float | None]:
    """The seconds at which each event was written, where they were kept."""
    events = len(record.events)
    if record.path is None or not times_file(record.path).exists():
        return [None] * events
    return [None if at is None else at / 1e9 for at in read_times(record.path, events)]


def _ratio(usages: Iterable[Mapping[str, Any]]) -> Fraction | None:
    """The provider's tokens to ours, over the prompts that were sent once and counted."""
    pairs = ((Usage.reported(event), event["prompt"]) for event in usages)
    counted = [(theirs.prompt, ours) for theirs, ours in pairs if theirs and theirs.requests == 1 and theirs.prompt]
    return Fraction(sum(theirs for theirs, _ in counted), sum(ours for _, ours in counted)) if counted else None


class _Unit(NamedTuple):
    number: int
    tokens: int
    blocks: int
    is_system: bool


class _Units:
    """The units of prompts; what prompts share is numbered and counted once."""

    def __init__(self, counter: TokenCounter) -> None:
        self._counter = counter
        self._units: dict[bytes, _Unit] = {}
        self._whole: dict[int, tuple[_Unit, ...]] = {}
        """The units of turns, unmasked."""
        self._masked: dict[tuple[int, int, int], tuple[_Unit, ...]] = {}
        """The units of turns, by how many results are masked: they are the oldest ones."""

    def prompts(self, record: Record) -> Iterator[tuple[Event, list[_Unit]]]:
        """Yield every `view` event of a record with the units of its prompt."""
        if _is_paper(record):
            for view, prompt, _ in paper.sent_prompts(record.events):
                yield view, [self._tools(prompt.tools), *map(self.of, prompt.messages)]
            return
        rebuilder = Rebuilder(record.events, record.turns)
        head, messages, whole = None, [], self._whole
        for event in record.events:
            if event["event"] == "head":
                rebuilder.use_head(event)
                tools = self._tools([ToolSpec(**tool) for tool in event["tools"]])
            elif event["event"] == "view":
                shown = rebuilder.shown(event)
                if shown.head is not head:
                    head, messages = shown.head, [*map(self.of, shown.head.messages)]
                units, texts = [tools, *messages], shown.texts
                for place, (turn, oldest, bare) in enumerate(shown.turns):
                    if place == shown.front:
                        units += map(self.of, shown.before)
                    if texts and turn.number in texts:
                        units.append(self.of(texts[turn.number]))
                    is_partly = (oldest and turn.dates and oldest > turn.dates[0]) or turn.left_out(shown.pictures)
                    seen = (
                        self._partly(turn, oldest, shown.pictures)
                        if is_partly
                        else whole.get(turn.number) or self.turn(turn)
                    )
                    units += [self.of(turn.bare), *seen[1:]] if bare and turn.is_wordy else seen
                yield event, [*units, *map(self.of, shown.after)]

    def replies(self, record: Record) -> dict[tuple[int, str], _Unit]:
        """Return the units of the replies by turn and purpose, as they are shown again."""
        edited = {call["turn"] for call in record.calls if call.get("host") == "edited"}
        sent = {event["turn"]: event for event in record.messages if event["by"] == "player"}
        replies: dict[tuple[int, str], _Unit] = {}
        for number, event in sent.items():
            if _is_paper(record) or number in edited:
                ids = event.get("ids") or [call["id"] for call in calls_of(event["message"])]
                replies[number, "play"] = self.of(with_ids(event["message"], ids))
            else:
                replies[number, "play"] = self.turn(record.turns[number])[0]
        return replies | {(event["turn"], "summary"): self.of(event["message"]) for event in record.summaries}

    def of(self, message: Message) -> _Unit:
        """Return the unit of a message."""
        written = canonical_json(message)
        if written not in self._units:
            tokens, is_system = self._counter.message(message), message["role"] in ("system", "developer")
            self._units[written] = _Unit(len(self._units), tokens, blocks_of(message), is_system)
        return self._units[written]

    def turn(self, turn: Turn) -> tuple[_Unit, ...]:
        """Return the units of a turn, unmasked."""
        if turn.number not in self._whole:
            self._whole[turn.number] = tuple(map(self.of, turn.messages))
        return self._whole[turn.number]

    def _partly(self, turn: Turn, oldest: int, pictures: int) -> tuple[_Unit, ...]:
        """The units of a turn of which observations are masked, or pictures left out."""
        key = turn.number, len(turn.masked(oldest)), len(turn.left_out(pictures))
        if key not in self._masked:
            self._masked[key] = tuple(map(self.of, turn.seen(oldest, pictures=pictures)))
        return self._masked[key]

    def _tools(self, tools: Sequence[ToolSpec]) -> _Unit:
        written = tools_bytes(tools)
        if written not in self._units:
            self._units[written] = _Unit(len(self._units), self._counter.tools(tools), 0, is_system=True)
        return self._units[written]


class _Sums:
    """Running sums over the units of a prompt; those that are the same in the next prompt are kept."""

    def __init__(self) -> None:
        self.units: tuple[int, ...] = ()
        self.ends: list[int] = [0]
        self.blocks: list[int] = [0]
        self.system = 0
        self._prompt: list[_Unit] = []

    def move_to(self, prompt: list[_Unit]) -> int:
        """Go on to the next prompt, and return how many units end with its last unchanged message; 0 if none is."""
        before, same = self.units, _common(is_not, prompt, self._prompt)
        new = prompt[same:]
        self._prompt = prompt
        self.units = (*before[:same], *[unit.number for unit in new])
        self.ends = [*self.ends[:same], *accumulate([unit.tokens for unit in new], initial=self.ends[same])]
        self.blocks = [*self.blocks[:same], *accumulate([unit.blocks for unit in new], initial=self.blocks[same])]
        self.system = next((at for at, unit in enumerate(prompt) if not unit.is_system), len(prompt))
        # What follows the tools is stable though they change.
        stable = same or 1 + _common(ne, self.units[1:], before[1:])
        return stable if stable > 1 else 0


def _request(
    sums: _Sums,
    stable: int,
    reply: _Unit,
    usage: Mapping[str, Any],
    ratio: Fraction | None,
    score: float,
    at: float | None,
) -> Request:
    tokens = [*sums.ends, usage["prompt"], sums.ends[-1] + usage["reply"]]
    if ratio is not None:
        tokens = [each * ratio.numerator // ratio.denominator for each in tokens]
    *ends, whole, answered = tokens
    provider = Usage.reported(usage)
    return Request(
        units=sums.units,
        ends=tuple(ends),
        blocks=tuple(sums.blocks),
        system=sums.system,
        stable=stable,
        purpose=usage.get("purpose", "play"),
        prompt=whole,
        reply=usage["reply"] if provider is None or not provider.prompt else provider.reply,
        answer=reply.number,
        answered=answered,
        score=score,
        at=at,
    )


def _common(differ: Callable[[Any, Any], bool], first: Sequence[Any], second: Sequence[Any]) -> int:
    """How many values at the beginning do not differ."""
    return next(compress(count(), map(differ, first, second)), min(len(first), len(second)))


def _is_paper(record: Record) -> bool:
    assert record.start is not None
    return bool(record.start["config"].get("protocol") == "paper")


def blocks_of(message: Message) -> int:
    """Return how many content blocks a message is: a text, a call, a result and its reasoning are one each."""
    return max(1, bool(text_of(message)) + len(calls_of(message)) + bool(reasoning_of(message)))


def _numbered(requests: Sequence[Request], *, by_purpose: bool) -> tuple[list[list[int]], list[int]]:
    numbers: dict[tuple[int, int, str], int] = {}
    paths: list[list[int]] = []
    answered: list[int] = []

    def extend(prefix: int, unit: int, purpose: str) -> int:
        return numbers.setdefault((prefix, unit, purpose), len(numbers))

    before: Request | None = None
    for request in requests:
        same = 0
        if before is not None:
            same = _common(ne, request.units, before.units)
            if by_purpose and request.purpose != before.purpose:
                same = min(same, request.system)
        path = paths[-1][:same] if paths else []
        for at in range(same, len(request.units)):
            purpose = request.purpose if by_purpose and at >= request.system else ""
            path.append(extend(path[-1] if path else -1, request.units[at], purpose))
        paths.append(path)
        answered.append(extend(path[-1], request.answer, request.purpose if by_purpose else ""))
        before = request
    return paths, answered
