"""Record: an episode as its record tells it, whether it is finished, was stopped, or is still being played.

What an event means for the episode is written in `Record` alone: how it ended, what it used, what was said and shown.
Only playing (the episode's counters, the turns of a conversation, the driver of a replay) takes events apart, too, and
`smartplay_otel`, which makes spans of one event after another.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, Generic, Literal, Self, TypeVar

from smartplay_tools.context.turns import Turn
from smartplay_tools.episode.config import EpisodeConfig, recorded_facts
from smartplay_tools.errors import SENSELESS, GameValueError, InvalidArgumentError, SmartPlayError, TranscriptError
from smartplay_tools.files.growing_lines import GrowingLines, ends_of
from smartplay_tools.files.lines import parse_json
from smartplay_tools.files.times import read_times
from smartplay_tools.providers.prices import Price
from smartplay_tools.records.prompts import SentPrompt, recorded_turns, sent_prompts
from smartplay_tools.records.spent import RecordCounts, Spent
from smartplay_tools.transcript.events import (
    CallEvent,
    ChoiceEvent,
    Event,
    HeadEvent,
    MessageEvent,
    QuestionEvent,
    ResumeEvent,
    SentEvent,
    SummaryEvent,
    UsageEvent,
    ViewEvent,
    concerns_summary,
)
from smartplay_tools.transcript.file import read_line, read_written
from smartplay_tools.types import EndReason, EpisodeResult, Purpose, SampledTokens
from smartplay_tools.types.messages import Message, text_of

FAILURES = ("player_error", "game_error")
"""Ends of an episode that failed."""

PAUSED: EndReason = "run_budget"
"""The end of an attempt whose next call could have exceeded a cap of the run."""

UNFINISHED = ("closed", PAUSED)
"""Ends of an episode that was stopped from outside and can be continued."""

INTERRUPTED = "interrupted"
"""The end reason of an attempt that was stopped or killed."""

EXCEPTION = "exception"
"""The end reason of an attempt that an exception outside the episode has ended."""

UNANSWERED = "CancelledError: the run stopped while a reply was awaited"
"""The exception event of an attempt that was stopped during a call, which may be charged."""

Outcome = Literal["finished", "failed", "paused", "interrupted"]
"""What an attempt came to. Only a finished episode is a result; the others are continued or played again."""

E_co = TypeVar("E_co", covariant=True)


def has_result(path: Path) -> bool:
    """Return whether the record in a file, if there is one, has the result of its episode: nothing later undoes it.

    A record that a killed process left unreadable has none.
    """
    try:
        return path.exists() and (record := Record.head(path)).start is not None and record.outcome == "finished"
    except TranscriptError:
        return False


class _EventsOf(Generic[E_co]):
    """The events of one kind of a record, in their order."""

    def __init__(self, kind: str) -> None:
        self._kind = kind

    def __get__(self, record: Record, _: object) -> Sequence[E_co]:
        return record._by_kind.get(self._kind, [])


class Record:
    """An episode as its record tells it.

    A record that was opened by `head` or `follow` reads the rest of its file when something needs it.

    Attributes:
        path: the file; None if the record was made from events.
        start: the first event; None if the episode never began, because an exception came before.
        ending: the event that ends the record, `end` or `exception`; None while the episode is played, or if its
            process was killed.
        written: the bytes from which `events` were read.
    """

    def __init__(
        self,
        events: Sequence[Event] | None = None,
        *,
        path: str | Path | None = None,
        prices: Mapping[str, Price] | None = None,
    ) -> None:
        """`prices` are those of the players' models, from which the cost is computed."""
        self.path = None if path is None else Path(path)
        self.start: Event | None = None
        self.ending: Event | None = None
        self.written: bytes | None = None
        self._events = events
        self._prices = prices or {}
        self._lines: GrowingLines | None = None
        for event in events or ():
            self._take(event)

    @classmethod
    def read(cls, path: str | Path, prices: Mapping[str, Price] | None = None, *, checks_fields: bool = True) -> Self:
        """Read a whole record; a file that is not one is a `TranscriptError`.

        Without `checks_fields` an event may have any, as a replay wants it.
        """
        events, written = read_written(path, checks_fields=checks_fields)
        record = cls(events, path=path, prices=prices)
        record.written = written
        return record

    @classmethod
    def head(cls, path: str | Path) -> Self:
        """Read the start and the end of a record only: its configuration, outcome and result."""
        record = cls(path=path)
        try:
            lines = ends_of(path)
        except FileNotFoundError:
            raise TranscriptError(f"There is no file {path}.") from None
        except OSError as error:
            raise TranscriptError(f"{path} cannot be read: {error.strerror}.") from None
        for line in lines:
            if kind_of(line) in ("start", "end", "exception"):
                record._take(read_line(line, path))
        return record

    @classmethod
    def follow(cls, path: str | Path, prices: Mapping[str, Price] | None = None) -> Self:
        """Read how far the episode of a record is and what it has used; `refresh` reads what was added since.

        The file may not exist yet.
        """
        record = cls(path=path, prices=prices)
        record._lines = GrowingLines(path)
        return record.refresh()

    @classmethod
    def readable_totals(cls, path: Path, prices: Mapping[str, Price] | None = None) -> Spent:
        """Return what the lines of a damaged record that can be read say of its use."""
        record = cls(path=path, prices=prices)
        record._lines = GrowingLines(path)
        with suppress(SmartPlayError):
            for line in record._lines.read()[0]:
                with suppress(SmartPlayError, *SENSELESS):
                    record._counts.take(read_line(line, path))
        return record.own_totals

    def refresh(self) -> Self:
        """Read what was added to the file of a followed record, and return the record.

        If the file has been moved, nothing changes.
        """
        assert self._lines is not None
        lines, _ = self._lines.read()
        for line in lines:
            if kind_of(line):
                event = read_line(line, self.path)
                self._take(event)
                self._counts.take(event)
        return self

    def _take(self, event: Event) -> None:
        match event["event"]:
            case "start" if self.start is None:  # an episode begins once; another start is a fault that replay finds
                self.start = event
                self.config  # noqa: B018 - it is checked before anything is read from it
            case "end" | "exception":
                self.ending = event

    @cached_property
    def _counts(self) -> RecordCounts:
        counts = RecordCounts(self._prices)
        for event in self.events if self._lines is None else ():
            counts.take(event)
        return counts

    # Which episode it is, and how it ended.

    @property
    def name(self) -> str:
        """The record's file name without its ending."""
        return "" if self.path is None else self.path.stem

    @property
    def key(self) -> str:
        """The episode's key in the file name: the name without the number of the attempt."""
        return self.name.partition(".")[0]

    @property
    def attempt(self) -> int:
        """The number of the attempt in the file name; 0 for the record of a finished episode."""
        return int(self.name.partition(".")[2] or 0)

    @cached_property
    def config(self) -> EpisodeConfig:
        """The episode's configuration; a record without its start is a `TranscriptError`."""
        return EpisodeConfig.from_event(self._begun)

    @cached_property
    def facts(self) -> dict[str, Any]:
        """The configuration as plain data, defaults included: see `recorded_facts`."""
        return recorded_facts(self._begun, self.config)

    @property
    def _begun(self) -> Event:
        if self.start is None:
            raise TranscriptError(f"{self.called} has no start event: its episode never began.")
        return self.start

    @property
    def game(self) -> str:
        """The setting's id; empty before the first event."""
        return "" if self.start is None else self.config.game

    @property
    def player(self) -> str:
        """The player's name; empty if there is none."""
        return "" if self.start is None else self.config.player or ""

    @property
    def seed(self) -> int | None:
        """The episode's seed; None before the first event."""
        return None if self.start is None else self.config.seed

    @property
    def budget(self) -> dict[str, Any]:
        """The budget in numbers (`ResolvedBudget`) as plain data."""
        budget: dict[str, Any] = self._begun["budget"]
        return budget

    @property
    def versions(self) -> dict[str, str]:
        """The versions that began the episode."""
        return {str(name): str(value) for name, value in self._begun.get("versions", {}).items()}

    @property
    def outcome(self) -> Outcome:
        """What the attempt came to; a record without an end is of one that was interrupted, or is being played."""
        if self.ending is None or self.was_unanswered:
            return "interrupted"
        if self._exception is not None:
            return "failed"
        reason = self.ending["result"]["end_reason"]
        if reason in FAILURES and not (reason == "game_error" and self._has_wrong_value):
            return "failed"
        if reason in UNFINISHED:
            return "paused" if reason == PAUSED else "interrupted"
        return "finished"

    @property
    def end_reason(self) -> str:
        """The end reason of the episode; `INTERRUPTED` or `EXCEPTION` if the attempt ended from outside."""
        if self.outcome == "interrupted":
            return INTERRUPTED
        assert self.ending is not None
        return EXCEPTION if self._exception is not None else str(self.ending["result"]["end_reason"])

    @property
    def error(self) -> str | None:
        """The error that ended the attempt, if there was one."""
        if self.ending is None:
            return None
        error: str | None = self.ending["error"] if self._exception is not None else self.ending["result"]["error"]
        return error

    @property
    def traceback(self) -> str | None:
        """The traceback of the error."""
        return None if self.ending is None else self.ending.get("traceback")

    @property
    def _has_wrong_value(self) -> bool:
        """Whether the game has handed out a value that no record can hold, as it would whenever it is played so."""
        return (self.error or "").partition(": ")[0] == GameValueError.__name__

    @property
    def was_unanswered(self) -> bool:
        """Whether the attempt was stopped during a call to a model."""
        return self._exception is not None and self._exception["error"] == UNANSWERED

    @property
    def is_complete(self) -> bool:
        """Whether the record holds its episode to the end, whatever the end was."""
        return self.ending is not None and self._exception is None

    @property
    def _exception(self) -> Event | None:
        return self.ending if self.ending is not None and self.ending["event"] == "exception" else None

    @property
    def result_data(self) -> dict[str, Any] | None:
        """The result as plain data; None if the episode has not ended."""
        return self.ending["result"] if self.ending is not None and self.is_complete else None

    @cached_property
    def result(self) -> EpisodeResult:
        """The episode's result; an episode that has not ended is a `TranscriptError`."""
        if self.result_data is None:
            raise TranscriptError(f"{self.called} is the record of an episode that is not finished.")
        return EpisodeResult(**self.result_data)

    # What it used.

    @property
    def totals(self) -> Spent:
        """What the episode used, with what the record repeats of an earlier attempt that it continues."""
        return self._counts.whole.spent()

    @property
    def own_totals(self) -> Spent:
        """What this attempt used itself: what it repeats of an earlier attempt was charged there."""
        return self._counts.own.spent()

    @property
    def cost(self) -> float | None:
        """The cost of the episode in US dollars: 0 if no provider reported any tokens, None if a price is not known."""
        return self._counts.whole.spent().cost

    @property
    def question_cost(self) -> float | None:
        """The part of it that a compactor's questions cost."""
        return self._counts.questions.spent().cost

    @property
    def peak_prompt_tokens(self) -> int:
        """The tokens of the episode's largest prompt to play, by our count."""
        return self._counts.whole.peak_prompt_tokens

    @property
    def declares(self) -> bool:
        """Whether its game has declared what an action needs, or which actions break its rules (`TextGame`)."""
        return self._counts.declares

    @property
    def limited_prompts(self) -> int | None:
        """The prompts that lacked a turn or an observation of the past; None where a host made the prompts."""
        return self._counts.play.limited

    @property
    def play_sha256(self) -> str | None:
        """A hash that is equal for episodes with the same prompts and replies; None where a host made the prompts."""
        return self._counts.play.sha256

    @property
    def open_call(self) -> Spent:
        """The call whose reply is not in the record, as unknown use; nothing if it ends without one, or as `end` says.

        Whatever ended an attempt from outside, a killed process or a stopped run, its call may be charged.
        """
        return Spent() if self.is_complete else self._counts.open_call()

    @property
    def steps(self) -> int:
        """The game's steps so far."""
        return self._counts.steps

    @property
    def exists(self) -> bool:
        """Whether the file of a followed record has been there."""
        return self.last_change > 0

    @property
    def silent_seconds(self) -> float:
        """Seconds since the last event of a followed record: the player is thinking, or its process has ended."""
        return max(0.0, time.time() - self.last_change)

    @property
    def last_change(self) -> float:
        """When a followed record was last written, in seconds since the epoch."""
        return 0.0 if self._lines is None else self._lines.changed_at

    # What was said and shown.

    @property
    def events(self) -> Sequence[Event]:
        """All events; of a record that grows, those that it had when they were first asked for."""
        if self._events is None:
            assert self.path is not None
            self._events, self.written = read_written(self.path)
        return self._events

    @cached_property
    def _by_kind(self) -> Mapping[str, list[Any]]:
        events: dict[str, list[Any]] = {}
        for event in self.events:
            events.setdefault(event["event"], []).append(event)
        return events

    heads = _EventsOf[HeadEvent]("head")
    """The first messages of every prompt and the tools: another event where the host has changed its part."""
    views = _EventsOf[ViewEvent]("view")
    """What each prompt showed."""
    messages = _EventsOf[MessageEvent]("message")
    """The replies, and what the host or this library put after them."""
    usages = _EventsOf[UsageEvent]("usage")
    """The tokens of each reply."""
    summaries = _EventsOf[SummaryEvent]("summary")
    """The replies to prompts for a summary."""
    questions = _EventsOf[QuestionEvent]("question")
    """The questions of a compactor, with the replies."""
    choices = _EventsOf[ChoiceEvent]("choice")
    """In the paper's protocol: the actions that answers chose."""
    calls = _EventsOf[CallEvent]("call")
    """The tool calls as they were played, with their answers."""
    sent = _EventsOf[SentEvent]("sent")
    """The prompts of a host that owned the context, as they were counted."""
    resumes = _EventsOf[ResumeEvent]("resume")
    """The times that the episode was continued from this record."""

    @cached_property
    def head_of(self) -> dict[int, HeadEvent]:
        """The head of the prompt of each turn."""
        heads: dict[int, HeadEvent] = {}
        head: Any = None
        for event in self.events:
            if event["event"] == "head":
                head = event
            elif event["event"] == "view":
                heads[event["turn"]] = head
        return heads

    @property
    def is_paper(self) -> bool:
        """Whether the episode was played in the paper's protocol, where every question is its own conversation."""
        return self.config.protocol == "paper"

    @property
    def tools(self) -> list[dict[str, Any]]:
        """The tools as the model was shown them, each a function of chat completions."""
        return [{"type": "function", "function": tool} for tool in self._first_head["tools"]]

    @cached_property
    def turns(self) -> list[Turn]:
        """The turns, with the call ids of the conversation. The paper's protocol has none (`InvalidArgumentError`)."""
        if self.is_paper:
            raise InvalidArgumentError(
                f"{self.called} was played in the paper's protocol, where every question is a conversation of its "
                "own; export it as sft."
            )
        return recorded_turns(self.events)

    @cached_property
    def replies(self) -> dict[int, Message]:
        """The replies by the number of their turn, with the call ids of the conversation."""
        if self.is_paper:
            return self.sent_replies
        return {turn.number: turn.assistant for turn in self.turns}

    @cached_property
    def sent_replies(self) -> dict[int, Message]:
        """The replies by the number of their turn, as they were sent."""
        return {event["turn"]: event["message"] for event in self.messages if event["by"] == "player"}

    @property
    def first_reply(self) -> str:
        """The text of the first reply; empty if there is none."""
        return next(map(text_of, self.sent_replies.values()), "")

    @cached_property
    def sampled(self) -> dict[tuple[int, Purpose, int], SampledTokens]:
        """The sampled tokens of replies, where the player gave them, by turn and by the purpose of the prompt.

        The last part of a key is the place of a question among those of its turn that were answered; 0 for others.
        """
        answered = [event for event in self.questions if event["reply"] is not None]
        replies: Mapping[Purpose, Sequence[Any]]
        replies = {"play": self.messages, "summary": self.summaries, "compaction": answered}
        return {
            (turn, purpose, place): SampledTokens.from_record(event["sampled"])
            for purpose, events in replies.items()
            for turn, group in groupby(events, key=itemgetter("turn"))
            for place, event in enumerate(group)
            if "sampled" in event
        }

    def sent_prompts(self) -> Iterator[SentPrompt]:
        """Yield every prompt that was sent, as rebuilt from the record; those for a summary, too."""
        return sent_prompts(self.events, () if self.is_paper else self.turns)

    @property
    def prompts(self) -> list[SentPrompt]:
        """The prompts of the replies; one that does not have its recorded sha256 is a `TranscriptError`.

        Prompts for a summary are not among them: what they ask for is not a turn.
        """
        return [sent for sent, _ in self.answered if sent.prompt.purpose == "play"]

    @cached_property
    def answered(self) -> list[tuple[SentPrompt, Message]]:
        """Every prompt that was answered, those for a summary too, with its reply.

        A prompt that does not have its recorded sha256 is a `TranscriptError`.
        """
        pairs: list[tuple[SentPrompt, Message]] = []
        for sent, reply in self.with_replies(self.sent_prompts(), self.replies):
            if reply is None:
                continue
            if sent.sha256 != sent.recorded_sha256:
                raise TranscriptError(f"{self.called}: the prompt of turn {sent.turn} is not the one that was sent.")
            pairs.append((sent, reply))
        return pairs

    def with_replies(
        self, prompts: Iterable[SentPrompt], replies: Mapping[int, Message]
    ) -> Iterator[tuple[SentPrompt, Message | None]]:
        """Yield all prompts of the record with their replies, None without one; `replies` are those of the turns."""
        summaries = iter([event["message"] for event in self.summaries])
        answers = iter([reply for event in self.questions if (reply := event["reply"]) is not None])
        for sent in prompts:
            match sent.prompt.purpose:
                case "summary":
                    yield sent, next(summaries, None)
                case "compaction":
                    yield sent, next(answers, None)
                case "play":
                    yield sent, replies.get(sent.turn)

    @property
    def _first_head(self) -> HeadEvent:
        if not self.heads:
            raise TranscriptError(f"{self.called} has no prompts: its episode was played with the host's own context.")
        return self.heads[0]

    @cached_property
    def seconds(self) -> dict[int, float]:
        """How long the player took for each turn, from the prompt to the reply; empty if times were not kept."""
        if self.path is None:
            return {}
        try:
            times = read_times(self.path, len(self.events))
        except TranscriptError:
            return {}
        seconds: dict[int, float] = {}
        asked: int | None = None
        for event, now in zip(self.events, times, strict=True):
            if event["event"] == "view":
                asked = now
            elif event["event"] == "message" and event["by"] == "player" and asked is not None and now is not None:
                seconds[event["turn"]] = (now - asked) / 1e9
        return seconds

    @cached_property
    def usage(self) -> dict[int, UsageEvent]:
        """The `usage` events of the replies by turn."""
        return {event["turn"]: event for event in self.usages if "prompt" in event and not concerns_summary(event)}

    @property
    def called(self) -> str:
        """The record's name in messages."""
        return self.name or "The record"


def kind_of(line: bytes) -> str:
    """Return the kind of the event on a line, "" for no event; a line that this package wrote is not parsed."""
    if line.startswith(KIND):
        return line[len(KIND) : line.find(b'"', len(KIND))].decode("ascii", "replace")
    try:
        event = parse_json(line)
    except (ValueError, RecursionError):
        return ""
    return str(event.get("event", "")) if isinstance(event, dict) else ""


KIND = b'{"event": "'
"""How a line begins: an event is written with its kind first."""
