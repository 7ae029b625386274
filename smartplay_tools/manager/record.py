"""The record of a context manager: every prompt word for word, what it left out, and what a provider has counted.

There is a file of JSON Lines for each thread, in the folder that the caller has named; its events are chained as those
of an episode's record. A message, a list of tools and a system prompt are written once and then named by number, so
that a file grows with the conversation. Nothing else of a request is in it: no key, no header, no setting of the model.

    start    the version, the manager's settings
    part     a message, or what stands beside the messages: tools, system prompt, output schema
    prompt   by number: what was given, what was shown; what was changed and dropped; tokens, cap, sha256
    refusal  the tokens of parts that did not fit
    usage    the tokens that a provider has reported for a prompt

A record may come from a stranger: reading it opens no tokenizer, no file and no address that it names.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter
from typing_extensions import TypedDict

from smartplay_tools.context.tokens import PRIMING
from smartplay_tools.context.view import numbers_in, ranges_of
from smartplay_tools.errors import SENSELESS, TranscriptError, in_one_line
from smartplay_tools.files.lines import complete_lines, parse_json
from smartplay_tools.transcript.hashing import canonical_json, chained_lines

FORMAT = "context-manager-1"

CHANGES = ("dropped", "masked", "trimmed", "elided", "cut", "repaired", "rewritten", "uncertain")
"""What a prompt says of messages, by their numbers in the list that was given."""


Count = Annotated[int, Field(ge=0, le=2**53)]
Ranges = list[Annotated[list[Count], Field(min_length=2, max_length=2)]]


class PromptEvent(TypedDict):
    """What the record says of a prompt."""

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True)  # type: ignore[misc]  # pydantic's way

    kind: Literal["prompt"]
    number: Count
    given: Ranges
    """The parts that the conversation consisted of."""
    shown: Ranges
    """The parts that were sent."""
    costs: list[Count]
    """The tokens of each of these."""
    beside: dict[str, Count]
    form: Literal["chat", "responses", "anthropic"]
    made: Count
    tokens: Count
    cap: Count | None
    parts: dict[Literal["tools", "head", "summary", "pinned", "turns"], Count]
    prefix_tokens: Count
    sha256: str
    dropped: NotRequired[Ranges]
    masked: NotRequired[Ranges]
    trimmed: NotRequired[Ranges]
    elided: NotRequired[Ranges]
    cut: NotRequired[Ranges]
    repaired: NotRequired[Ranges]
    rewritten: NotRequired[Ranges]
    uncertain: NotRequired[Ranges]


_PROMPT = TypeAdapter(PromptEvent)
_PARTS = TypeAdapter(dict[str, Count])
_COUNT = TypeAdapter(Count)


@dataclass(frozen=True)
class RecordedPrompt:
    """A prompt of a record, rebuilt."""

    number: int
    messages: Sequence[Mapping[str, Any]]
    """As they were sent."""
    sent_parts: Sequence[int]
    """The numbers of these among the parts of the record; equal ones have the same."""
    beside: Mapping[str, Any]
    """Tools, system prompt and output schema, as they were sent."""
    given: Sequence[Mapping[str, Any]]
    """The whole conversation, of which it was made."""
    given_parts: Sequence[int]
    """The numbers of its messages."""
    facts: PromptEvent
    """The event."""
    reported: int | None = None
    """The tokens of the prompt that the provider has reported; None, too, where it has managed the context itself."""
    managed: bool = False
    """Whether it has."""

    def changed(self, change: str) -> list[int]:
        """Return the numbers of the messages that were `dropped`, `masked` and so on, in what was given."""
        found: Any = self.facts.get(change)
        return [*numbers_in(found or ())]

    @property
    def is_over(self) -> bool:
        """Whether the provider counted more tokens than the cap."""
        cap = self.facts["cap"]
        return cap is not None and self.reported is not None and self.reported > cap

    @property
    def sha256(self) -> str:
        """The digest of what it shows, computed again."""
        return digest(self.messages, self.beside)


@dataclass(frozen=True)
class RecordedThread:
    """What the record of a thread says."""

    path: Path
    settings: Mapping[str, Any]
    """Those of the manager that began it."""
    prompts: Sequence[RecordedPrompt] = ()
    refusals: Sequence[Mapping[str, int]] = ()
    """For each prompt that did not fit, its tokens by part."""
    parts: Sequence[Any] = ()
    """Messages, and what stood beside them, by their numbers."""
    digests: Sequence[str] = ()
    """The sha256 of each of these, as it is recorded."""

    @cached_property
    def differing(self) -> Sequence[int]:
        """The numbers of the prompts that, or whose conversations, rebuilt are not what their digests say."""
        pairs = enumerate(zip(self.parts, self.digests, strict=True))
        changed = {number for number, (part, recorded) in pairs if _sha256(part) != recorded}
        return [
            prompt.number
            for prompt in self.prompts
            if prompt.sha256 != prompt.facts["sha256"] or not changed.isdisjoint(prompt.given_parts)
        ]


@dataclass
class ThreadRecord:
    """The file of one thread, which is continued if it exists."""

    path: Path
    settings: Mapping[str, Any]
    _numbers: dict[str, int] = field(default_factory=dict, init=False)
    """The number of each part, by its digest."""
    _prompts: int = field(default=0, init=False)
    _latest: tuple[Any, ...] = field(default=(), init=False)
    """What the latest prompt was made of, its parts and their tokens."""
    _chain: str = field(default="", init=False)
    _size: int = field(default=0, init=False)
    """The bytes of the file."""

    def __post_init__(self) -> None:
        """Open the file; what another process has written of the thread is taken over."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o600)  # it holds what an agent has read
            with os.fdopen(handle, "r+b") as file:
                lines = b"".join(complete_lines(file.read()))
                file.truncate(len(lines))
        except OSError as error:
            raise TranscriptError(f"{self.path} cannot be written: {error.strerror}.") from None
        self._size = len(lines)
        latest: dict[str, Any] | None = None
        for event in _events(self.path, lines):
            self._chain = event["chain"]
            if event["kind"] == "part":
                self._numbers[event["sha256"]] = event["number"]
            elif event["kind"] == "prompt":
                self._prompts = event["number"] + 1
                latest = event
        if latest is not None:
            sent = [*numbers_in(latest["shown"])]
            self._latest = [*numbers_in(latest["given"])], sent, latest["beside"]
        if not lines:
            self._write({"kind": "start", "format": FORMAT, "settings": dict(self.settings)})

    def prompt(
        self,
        given: Sequence[Mapping[str, Any]],
        shown: Sequence[Mapping[str, Any]],
        tokens: Sequence[int],
        beside: Mapping[str, Any],
        facts: Mapping[str, Any],
    ) -> int:
        """Write a prompt and return its number; the same prompt asked for again is written once.

        Arguments:
            given: the whole list, as plain data.
            shown: the messages of the prompt.
            tokens: the tokens of each of these.
            beside: what is sent beside the messages.
            facts: what became of the messages that were given, and the sum of tokens by part.
        """
        events: list[dict[str, Any]] = []
        told = {name: value for name, value in beside.items() if value}
        values = [*given, *shown, *told.values()]
        digests = [*map(_sha256, values)]  # before any has a number: one that is no JSON leaves nothing behind
        parts = [self._part(value, sha256, events) for value, sha256 in zip(values, digests, strict=True)]
        numbers, sent = parts[: len(given)], parts[len(given) : len(given) + len(shown)]
        stored = dict(zip(told, parts[len(given) + len(shown) :], strict=True))
        now = numbers, sent, stored
        if self._latest[:3] == now:
            return self._prompts - 1
        prefix = 0
        if self._latest and self._latest[2] == stored:
            prefix = facts["tokens"] - sum(tokens) - PRIMING  # what is beside the messages comes first
            pairs = zip(sent, self._latest[1], tokens, strict=False)
            for one, other, size in pairs:
                if one != other:
                    break
                prefix += size
        event = {"kind": "prompt", "number": self._prompts, "given": ranges_of(numbers), "shown": ranges_of(sent)}
        event |= {"costs": list(tokens), "beside": stored, **facts, "prefix_tokens": prefix}
        self._write(*events, {**event, "sha256": digest(shown, beside)})
        self._latest = now
        self._prompts += 1
        return self._prompts - 1

    def refusal(self, parts: Mapping[str, int], cap: int | None) -> None:
        """Write that what cannot be left out did not fit."""
        self._write({"kind": "refusal", "parts": dict(parts), "cap": cap})

    def usage(self, number: int, tokens: int, *, managed: bool = False) -> None:
        """Write how many tokens a provider has counted in a prompt, and whether it managed the context itself."""
        self._write({"kind": "usage", "prompt": number, "tokens": tokens} | ({"managed": True} if managed else {}))

    def _part(self, value: Any, sha256: str, events: list[dict[str, Any]]) -> int:
        if sha256 not in self._numbers:
            self._numbers[sha256] = len(self._numbers)
            events.append({"kind": "part", "number": self._numbers[sha256], "sha256": sha256, "part": value})
        return self._numbers[sha256]

    def _write(self, *events: Mapping[str, Any]) -> None:
        lines, self._chain = chained_lines(events, self._chain)
        try:
            with self.path.open("ab") as file:
                if file.tell() != self._size:
                    raise TranscriptError(f"{self.path} is written by another program, too; name another thread.")
                file.write(lines)
        except OSError as error:
            raise TranscriptError(f"{self.path} can no longer be written: {error.strerror}.") from error
        self._size += len(lines)


def digest(messages: Sequence[Mapping[str, Any]], beside: Mapping[str, Any]) -> str:
    """Return the sha256 of a prompt: its messages and what is beside them, in canonical JSON, as hex."""
    sent = {"messages": list(messages), **{name: value for name, value in beside.items() if value}}
    return _sha256(sent)


def _sha256(value: Any) -> str:
    return hashlib.sha256(canonical_json(value)).hexdigest()


def is_thread_record(path: Path) -> bool:
    """Whether a file begins as the record of a context manager."""
    try:
        with path.open("rb") as file:
            return b'"format": "%b"' % FORMAT.encode() in file.readline(1_000)
    except OSError:
        return False


def read_thread(path: str | Path) -> RecordedThread:
    """Return what a record says, its prompts rebuilt; a file that is none, or was changed, is a `TranscriptError`."""
    path = Path(path)
    try:
        lines = b"".join(complete_lines(path.read_bytes()))
    except OSError as error:
        raise TranscriptError(f"{path} cannot be read: {error.strerror}.") from None
    parts: list[Any] = []
    digests: list[str] = []
    prompts: list[RecordedPrompt] = []
    refusals: list[Mapping[str, int]] = []
    settings: Mapping[str, Any] = {}
    try:
        for event in _events(path, lines):
            match event["kind"]:
                case "start":
                    settings = dict(event["settings"])
                case "part" if event["number"] == len(parts):
                    parts.append(event["part"])
                    digests.append(event["sha256"])
                case "prompt":
                    prompts.append(_prompt(event, parts, len(prompts)))
                case "usage":
                    at = _COUNT.validate_python(event["prompt"])
                    reported = _COUNT.validate_python(event["tokens"], strict=True)
                    managed = event.get("managed") is True
                    prompts[at] = replace(prompts[at], reported=None if managed else reported, managed=managed)
                case "refusal":
                    refusals.append(_PARTS.validate_python(event["parts"], strict=True))
    except SENSELESS as error:
        if isinstance(error, TranscriptError):
            raise
        raise TranscriptError(f"{path} is not the record of a context manager: {in_one_line(error)}.") from None
    if not settings:
        raise TranscriptError(f"{path} has no event of a context manager.")
    return RecordedThread(path, settings, prompts, refusals, parts, digests)


def _prompt(event: Any, parts: Sequence[Any], number: int) -> RecordedPrompt:
    """A prompt out of its event and the parts before it; a `ValueError` if these do not belong together."""
    facts = _PROMPT.validate_python({name: value for name, value in event.items() if name != "chain"})
    given, sent = _numbers(facts["given"], len(parts)), _numbers(facts["shown"], len(parts))
    messages = [parts[each] for each in (*given, *sent)]
    for change in CHANGES:
        found = _numbers(facts.get(change), len(given))
        if any(one >= other for one, other in pairwise(found)):
            raise ValueError(f"the numbers of the messages {change} have no order")
    if not all(isinstance(each, Mapping) for each in messages) or len(sent) != len(facts["costs"]):
        raise ValueError("the numbers of a prompt are not those of its messages")
    beside = {name: parts[at] for name, at in facts["beside"].items()}
    return RecordedPrompt(number, messages[len(given) :], sent, beside, messages[: len(given)], given, facts)


def _numbers(found: Any, count: int) -> list[int]:
    """The numbers of ranges, all of which are less than a count; none without ranges."""
    if any(first > last or last >= count for first, last in found or ()):
        raise ValueError("the numbers of a prompt are not those of its messages")
    return [*numbers_in(found or ())]


def _events(path: Path, lines: bytes) -> Iterator[dict[str, Any]]:
    """The events of a file, each checked against its chain."""
    chain = ""
    for at, line in enumerate(lines.splitlines(keepends=True)):
        try:
            event = parse_json(line)
            own = {name: value for name, value in event.items() if name != "chain"}
            expected, chain = chained_lines([own], chain)
        except SENSELESS:
            expected = b""
        if expected != line or (at == 0 and event.get("format") != FORMAT):
            raise TranscriptError(f"{path}, line {at + 1}: not the record of a context manager, or changed since.")
        yield event
