"""The requests of an episode as a provider's cache sees them (`smartplay_tools.costs.cached`), from its record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

from smartplay_tools.context.tokens import TokenCounter, Tokenizer
from smartplay_tools.context.turns import with_ids
from smartplay_tools.costs.cached import Prefixes, Unit, Units, same_and_stable
from smartplay_tools.episode.cells import counter_of
from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.times import read_times, times_file
from smartplay_tools.records.prompts import Rebuilder, sent_prompts
from smartplay_tools.records.record import Record
from smartplay_tools.transcript.events import purpose_of
from smartplay_tools.types import Purpose, Usage
from smartplay_tools.types.messages import calls_of


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
        prefixes = Prefixes(self.ratio, by_purpose=by_purpose)
        for request in self.requests:
            prefixes.add(request.units, request.same, request.purpose)
            prefixes.add_reply(request.answer, request.purpose)
        return prefixes


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
            (same, stable), (tokens, reply) = same_and_stable(prompt, before), _counted(usages[key], ratio)
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


class _Units(Units):
    """The units of a record's prompts."""

    def __init__(self, record: Record, counter: TokenCounter) -> None:
        super().__init__(counter)
        self._record = record

    def prompts(self) -> Iterator[list[Unit]]:
        """Yield the units of every prompt of the record."""
        if self._record.is_paper:
            for sent in sent_prompts(self._record.events):
                yield [self.tools(sent.prompt.tools), *map(self.of, sent.prompt.messages)]
            return
        rebuilder, known = Rebuilder(self._record.events, self._record.turns), None
        for tools, forms in rebuilder.each(rebuilder.parts):
            if tools is not known:
                known, unit = tools, self.tools(tools)
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
                replies[number, "play", 0] = self.of(with_ids(event["message"], ids))
            else:
                replies[number, "play", 0] = self[record.turns[number].whole[0]]
        replies |= {(event["turn"], "summary", 0): self.of(event["message"]) for event in record.summaries}
        answers = [(event["turn"], event["reply"]) for event in record.questions if event["reply"] is not None]
        keys = _keys({"turn": turn, "purpose": "compaction"} for turn, _ in answers)
        return replies | {key: self.of(answer) for key, (_, answer) in zip(keys, answers, strict=True)}
