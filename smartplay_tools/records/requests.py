"""The requests of an episode as a provider's cache sees them: sequences of units, and the prefixes that they share.

Equal units have the same number. The units of a request are the tools as one, then each message. Inside the first unit
that differs nothing is common: a head to which the manual is added counts as new from there on. Priming belongs to no
unit, since no request shares it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import compress, count
from operator import is_not
from typing import Any, NamedTuple

from smartplay_tools.context.tokens import TokenCounter, Tokenizer
from smartplay_tools.context.turns import Form, with_ids
from smartplay_tools.episode.cells import counter_of
from smartplay_tools.errors import TranscriptError
from smartplay_tools.records.prompts import Rebuilder, sent_prompts
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import purpose_of
from smartplay_tools.transcript.hashing import canonical_json, tools_bytes
from smartplay_tools.transcript.times import read_times, times_file
from smartplay_tools.types import Purpose, ToolSpec, Usage
from smartplay_tools.types.messages import Message, calls_of, reasoning_of, text_of


class Unit(NamedTuple):
    """The tools of a request, or one of its messages; equal ones are the same object."""

    number: int
    tokens: int
    blocks: int
    """Content blocks: a text, a call, a result and the reasoning of a reply are one each."""
    is_system: bool
    """Whether it is the tools or a system message."""


class Request(NamedTuple):
    """A prompt that had a reply. Tokens are the provider's where it counted them, else budget tokens."""

    units: Sequence[Unit]
    """The tools and the messages, in budget tokens."""
    same: int
    """How many units at the beginning are the same as in the previous request."""
    stable: int
    """How many units end with the last message that is unchanged since the request before; 0 if none is."""
    purpose: Purpose
    prompt: int
    """Tokens of the prompt, priming included."""
    reply: int
    """Tokens of the reply."""
    answer: Unit
    """The reply as a unit of later requests."""
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
    remembered: dict[Any, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Results shared by rules that store the same prefixes, by what they store."""

    @cached_property
    def columns(self) -> tuple[list[int], list[int], list[float]]:
        """The tokens of the prompts and of the replies, and the scores."""
        requests = self.requests
        return [each.prompt for each in requests], [each.reply for each in requests], [each.score for each in requests]

    @cached_property
    def seconds(self) -> float | None:
        """The seconds from the first request to the last; None if the times are not known."""
        times = [each.at for each in self.requests if each.at is not None]
        return max(times, default=0.0) - min(times, default=0.0) if len(times) == len(self.requests) else None

    @cached_property
    def prefixes(self) -> Prefixes:
        """The prefixes of the requests."""
        return self._numbered(by_purpose=False)

    @cached_property
    def prefixes_by_purpose(self) -> Prefixes:
        """The same, where requests with different purposes have only their tools and system messages in common."""
        if all(request.purpose == "play" for request in self.requests):
            return self.prefixes
        return self._numbered(by_purpose=True)

    def _numbered(self, *, by_purpose: bool) -> Prefixes:
        tagged: dict[tuple[Unit, Purpose], Unit] = {}

        def told_apart(units: Sequence[Unit], purpose: Purpose) -> list[Unit]:
            return [tagged.setdefault((unit, purpose), unit._replace(number=-1 - len(tagged))) for unit in units]

        prefixes = Prefixes(self.ratio)
        for request in self.requests:
            units, same, answer = request.units, request.same, request.answer
            if by_purpose:
                system = next((at for at, unit in enumerate(units) if not unit.is_system), len(units))
                units, same = [*units[:system], *told_apart(units[system:], request.purpose)], min(same, system)
                [answer] = told_apart([answer], request.purpose)
            prefixes.add(units, same, answer)
        return prefixes


class Prefixes:
    """The prefixes of requests that end with a unit, each with a number; equal ones have the same.

    They form a tree: each prefix extends another by one unit. The empty prefix is 0. A prefix has the number after that
    of the one it extends, unless that one was extended by another unit before.
    """

    def __init__(self, ratio: Fraction | None = None) -> None:
        """`ratio` is that of the provider's tokens to ours."""
        self.paths: list[list[int]] = []
        """For each request its prefixes, by their length in units."""
        self.shared: list[int] = []
        """For each request, how many of its units an earlier one begins with."""
        self.shared_with_reply: list[int] = []
        """For each request, how many of its units an earlier one, or one with its reply, begins with."""
        self.answers: list[int] = []
        """For each request the prefix that is itself with its reply."""
        self._ratio = ratio
        self._before = [0]
        """Each prefix without its last unit."""
        self._units: list[Unit] = [Unit(-1, 0, 0, is_system=False)]
        """The last unit of each prefix."""
        self._branches: dict[tuple[int, int], int] = {}
        """The prefixes whose number is not the next, by the one before and the last unit."""
        self._replies: set[int] = set()
        """The prefixes that end with a reply, and with which no request begins."""

    def add(self, units: Sequence[Unit], same: int, answer: Unit) -> None:
        """Add the next request, whose first units are the `same` as those of the one before."""
        path = self.paths[-1][: same + 1] if self.paths else [0]
        for unit in units[same:]:
            if (prefix := self._after(path[-1], unit)) is None:
                break
            path.append(prefix)
        shared = len(path) - 1
        self.shared_with_reply.append(shared)
        self.shared.append(shared - (path[shared] in self._replies))  # nothing follows a reply that was not shown again
        self._replies.discard(path[shared])
        path += self._grown(path[shared], units[shared:])
        self.paths.append(path)
        if (prefix := self._after(path[-1], answer)) is None:
            [prefix] = self._grown(path[-1], [answer])
            self._replies.add(prefix)
        self.answers.append(prefix)

    def _after(self, prefix: int, unit: Unit) -> int | None:
        """The prefix that is this one and a unit, if there is one."""
        following = prefix + 1
        if following < len(self._units) and self._before[following] == prefix and self._units[following] is unit:
            return following
        return self._branches.get((prefix, unit.number))

    def _grown(self, prefix: int, units: Sequence[Unit]) -> Sequence[int]:
        """Number the prefixes that extend one by each of these units in turn."""
        first = len(self._units)
        if units and first != prefix + 1:
            self._branches[prefix, units[0].number] = first
        new = range(first, first + len(units))
        self._before += (prefix, *new)[: len(units)]
        self._units += units
        return new

    @cached_property
    def tokens(self) -> list[int]:
        """The tokens of each prefix, which are the provider's if there is a ratio."""
        tokens = self._summed([unit.tokens for unit in self._units])
        if (ratio := self._ratio) is None:
            return tokens
        return [each * ratio.numerator // ratio.denominator for each in tokens]

    @cached_property
    def blocks(self) -> list[int]:
        """The content blocks of each prefix; tools are none."""
        return self._summed([unit.blocks for unit in self._units])

    def _summed(self, sizes: Sequence[int]) -> list[int]:
        sums: list[int] = []
        for before, size in zip(self._before, sizes, strict=True):
            sums.append(size + sums[before] if sums else size)
        return sums


Key = tuple[int, Purpose, int]
"""The turn of a request, what it asks for, and how many questions of a compactor for the same turn came before it."""


def requests_of(record: Record, *, tokenizer: str | Tokenizer | None = None) -> RequestLog:
    """Return the requests of a record.

    `tokenizer` is required if the record was counted with one that does not ship with this package, unless the program
    has named the same before. A record that has no prompts, or prompts without usage, is a `TranscriptError`.
    """
    if record.start is None or not record.heads:
        raise TranscriptError(f"{record.called} has no prompts: its episode was played with the host's own context.")
    counted = [event for event in record.usages if "prompt" in event]
    usages = dict(zip(_keys(counted), counted, strict=True))
    if not usages and record.messages:
        raise TranscriptError(f"{record.called} has no usage, so nothing can be said about its cost.")
    units = _Units(record, counter_of(record.config, tokenizer, is_recorded=True))
    prompts = dict(zip(_keys(record.views), zip(units.prompts(), _times(record), strict=True), strict=True))
    replies, ratio = units.replies(), _ratio(usages.values())
    scores = {event["turn"]: float(event["data"]["score"]) for event in record.calls if "score" in event["data"]}
    requests: list[Request] = []
    before: list[Unit] = []
    score = 0.0
    for key, (prompt, at) in prompts.items():
        score = scores.get(key[0] - 1, score)
        if key in usages and key in replies:
            same, (tokens, reply) = _common(prompt, before), _counted(usages[key], ratio)
            # Messages after the tools are stable even if the tools change.
            stable = same or 1 + _common(prompt[1:], before[1:])
            stable = stable if stable > 1 else 0
            requests.append(Request(prompt, same, stable, key[1], tokens, reply, replies[key], score, at))
            before = prompt
    return RequestLog(requests, ratio)


def _keys(events: Iterable[Mapping[str, Any]]) -> Iterator[Key]:
    """Yield the keys of `view` or `usage` events."""
    asked: Counter[int] = Counter()
    for event in events:
        turn, purpose = event["turn"], purpose_of(event)
        yield turn, purpose, asked[turn] if purpose == "compaction" else 0
        asked[turn] += purpose == "compaction"


def _times(record: Record) -> Sequence[float | None]:
    """The seconds at which each view was written, where they were kept."""
    if record.path is None or not times_file(record.path).exists():
        return [None] * len(record.views)
    times = read_times(record.path, len(record.events))
    views = (at for event, at in zip(record.events, times, strict=True) if event["event"] == "view")
    return [None if at is None else at / 1e9 for at in views]


def _ratio(usages: Iterable[Mapping[str, Any]]) -> Fraction | None:
    """The provider's tokens to ours, over the prompts that were sent once and counted."""
    pairs = ((Usage.reported(event), event["prompt"]) for event in usages)
    counted = [(theirs.prompt, ours) for theirs, ours in pairs if theirs and theirs.requests == 1 and theirs.prompt]
    return Fraction(sum(theirs for theirs, _ in counted), sum(ours for _, ours in counted)) if counted else None


def _counted(usage: Mapping[str, Any], ratio: Fraction | None) -> tuple[int, int]:
    """The tokens of a prompt and of its reply, the provider's where it counted them."""
    prompt, provider = usage["prompt"], Usage.reported(usage)
    if ratio is not None:
        prompt = prompt * ratio.numerator // ratio.denominator
    return prompt, usage["reply"] if provider is None or not provider.prompt else provider.reply


class _Units(dict[Form, Unit]):
    """The units of a record's prompts by the forms of messages; equal ones are numbered and counted once."""

    def __init__(self, record: Record, counter: TokenCounter) -> None:
        super().__init__()
        self._record, self._counter = record, counter
        self._units: dict[Hashable, Unit] = {}

    def __missing__(self, form: Form) -> Unit:
        unit = self[form] = self._of(form.message)
        return unit

    def prompts(self) -> Iterator[list[Unit]]:
        """Yield the units of every prompt of the record."""
        if self._record.is_paper:
            for sent in sent_prompts(self._record.events):
                yield [self._tools(sent.prompt.tools), *map(self._of, sent.prompt.messages)]
            return
        rebuilder, known = Rebuilder(self._record.events, self._record.turns), None
        for event in self._record.events:
            rebuilder.take(event)
            if event["event"] == "view":
                tools, forms = rebuilder.parts(event)
                if tools is not known:
                    known, unit = tools, self._tools(tools)
                yield [unit, *map(self.__getitem__, forms)]

    def replies(self) -> dict[Key, Unit]:
        """Return the units of the replies as they were said, which is mostly how they are shown again."""
        record = self._record
        edited = {call["turn"] for call in record.calls if call.get("host") == "edited"}
        sent = {event["turn"]: event for event in record.messages if event["by"] == "player"}
        replies: dict[Key, Unit] = {}
        for number, event in sent.items():
            if record.is_paper or number in edited or record.turns[number].sent is not None:
                ids = event.get("ids") or [call["id"] for call in calls_of(event["message"])]
                replies[number, "play", 0] = self._of(with_ids(event["message"], ids))
            else:
                replies[number, "play", 0] = self[record.turns[number].whole[0]]
        replies |= {(event["turn"], "summary", 0): self._of(event["message"]) for event in record.summaries}
        answers = [(event["turn"], event["reply"]) for event in record.questions if event["reply"] is not None]
        keys = _keys({"turn": turn, "purpose": "compaction"} for turn, _ in answers)
        return replies | {key: self._of(answer) for key, (_, answer) in zip(keys, answers, strict=True)}

    def _of(self, message: Message) -> Unit:
        written = _written(message)
        if (unit := self._units.get(written)) is None:
            tokens, is_system = self._counter.message(message), message["role"] in ("system", "developer")
            unit = self._units[written] = Unit(len(self._units), tokens, blocks_of(message), is_system)
        return unit

    def _tools(self, tools: Sequence[ToolSpec]) -> Unit:
        written = tools_bytes(tools)
        if (unit := self._units.get(written)) is None:
            unit = self._units[written] = Unit(len(self._units), self._counter.tools(tools), 0, is_system=True)
        return unit


def _written(message: Message) -> Hashable:
    """A key that is equal if the canonical JSON of messages is; for most results it needs no JSON."""
    if message["role"] == "tool" and len(message) == 3 and isinstance(message["content"], str):
        return message["content"], message["tool_call_id"]
    return canonical_json(message)


def _common(first: list[Unit], second: list[Unit]) -> int:
    """How many units at the beginning are the same."""
    length = min(len(first), len(second))
    if first[:length] == second[:length]:
        return length
    return next(compress(count(), map(is_not, first, second)))


def blocks_of(message: Message) -> int:
    """Return how many content blocks a message is: a text, a call, a result and its reasoning are one each."""
    if message["role"] != "assistant":
        return 1
    return max(1, bool(text_of(message)) + len(calls_of(message)) + bool(reasoning_of(message)))
