"""The events of a transcript as types: one class for each kind, in the order in which they can occur.

A record has two kinds of information. The events about what happened (`start`, `message`, `usage`, `summary`,
`question`, `choice`, `call`, `reveal`, `picture`, `end`) can be replayed on a new game. The events about what was shown
(`head`, `rewrite`, `view`) allow every prompt to be rebuilt exactly. A test compares the table in
`docs/architecture.md` with these classes.

`ErrorLocation` reports an error in a record in one sentence, with the number of the event.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Any, Literal, NotRequired, Self, TypedDict

from smartplay_tools.errors import TranscriptError, in_one_line
from smartplay_tools.types import Purpose
from smartplay_tools.types.messages import Message

FORMAT = 1
"""The version of the format that is written. A reader refuses records whose format it does not support."""

Event = dict[str, Any]
"""An event in a file: one of the classes below, with its `chain`."""


class StartEvent(TypedDict):
    """The episode: the fields of `EpisodeConfig`, and values derived from them."""

    event: Literal["start"]
    format: int
    config: dict[str, Any]
    """The `EpisodeConfig`, without fields at their defaults."""
    budget: dict[str, Any]
    """The budget in numbers (`ResolvedBudget`)."""
    cut_results: int
    """1 if the manual was pinned and cut to its cap, else 0."""
    versions: dict[str, str]
    pictures: NotRequired[Literal["pixels"]]
    """With pictures as observations: what their sha256 are of (`Picture.sha256`). Absent in records that were written
    before there was this field, whose sha256 are of PNG files."""
    scoring: NotRequired[dict[str, Any]]
    """What scores can be in a setting beyond the benchmark (`Scoring`): a reader need not know its game."""
    carried: NotRequired[dict[str, Any]]
    """What it takes over from the trial before it: the digest of its `record`, `result`, `notes` or `files`."""


class HeadEvent(TypedDict):
    """The first messages of every prompt, and the tool schemas; another one where the host has changed its part."""

    event: Literal["head"]
    messages: list[Message]
    tools: list[dict[str, Any]]
    observation: NotRequired[str]
    """In the paper's protocol: the observation of the reset, cut to its cap."""
    compacts: NotRequired[bool]
    """With a compactor: true. The notes are then a part of the system message, and a manual that was read is not."""
    cut_results: NotRequired[int]
    """In the paper's protocol: how many of manual and first observation were cut."""


class ViewEvent(TypedDict):
    """What a prompt showed: which turns, which results were masked, and the prompt's sha256."""

    event: Literal["view"]
    turn: int
    """The turn that the prompt asks for."""
    tokens: int
    max_tokens: int | None
    prefix_tokens: int
    shown_steps: int
    dropped_turns: int
    turns: NotRequired[list[list[int]]]
    """Ranges of turns, first and last included; with a compactor those of which the prompt shows messages."""
    masked: NotRequired[list[list[int]]]
    """[turn, item] of every result whose observation has left the window; not with a budget that has strategies."""
    purpose: NotRequired[Purpose]
    """With strategies: what the prompt asks for. A prompt for a summary has the head of the turn before."""
    oldest: NotRequired[int]
    """With strategies: observations before this one are masked."""
    notes: NotRequired[int | None]
    """With strategies: the pinned turn with the notes, of which every observation is masked."""
    words: NotRequired[int]
    """With `own_words`: replies of turns older than this step are bare."""
    pictures: NotRequired[int]
    """With `newest_pictures`: how many of the first pictures of the conversation are left out."""
    anchors: NotRequired[int]
    """With `first_turns`: how many first turns are pinned; those before the run of newest turns precede the summary."""
    hidden: NotRequired[list[list[int]]]
    """With a custom strategy: ranges of the turns whose observations it masks."""
    texts: NotRequired[list[Any]]
    """With a custom strategy: its texts, each as [turn, text], a user message before that turn."""
    summary: NotRequired[int]
    """With strategies: the number of `summary` events so far; the text of the last one is shown."""
    messages: NotRequired[list[Any]]
    """With the purpose "compaction": the messages of the question, in the form of `RewriteEvent.messages`."""
    question: NotRequired[int]
    """In the paper's protocol: 1 or 2, the step of the current observation, and the first step of the history."""
    step: NotRequired[int]
    first: NotRequired[int]
    sha256: str


class MessageEvent(TypedDict):
    """A reply (`by` is "player"), or a message that the host or this library added after it."""

    event: Literal["message"]
    turn: int
    by: Literal["player", "host", "library"]
    message: Message
    ids: NotRequired[list[str]]
    """The ids of a reply's calls in the conversation, if they differ from those that the model sent."""
    position: NotRequired[int]
    """Which call of the reply a foreign tool's result answers."""
    sampled: NotRequired[dict[str, Any]]
    """The `SampledTokens` of a reply, where the player gave them."""


class UsageEvent(TypedDict):
    """The tokens of a reply: our count and the provider's. Without a reply, only the provider's."""

    event: Literal["usage"]
    turn: int
    prompt: NotRequired[int]
    reply: NotRequired[int]
    prefix: NotRequired[int]
    overrun: NotRequired[bool]
    texts: NotRequired[int]
    """The part of `prompt` that a custom strategy has written."""
    purpose: NotRequired[Literal["summary", "compaction"]]
    """Present on the usage of a summary or of a question; the turn has its own usage."""
    provider: dict[str, Any] | None


class SummaryEvent(TypedDict):
    """The reply to a prompt for a summary, and what is shown of it."""

    event: Literal["summary"]
    turn: int
    """The turn that the next prompt to play asks for."""
    covers: int
    """The first turn that has not left the window: the summary replaces those before it."""
    message: Message
    text: str
    """The words that are shown from now on: the reply's, cut to their cap, or the earlier summary's; "" for none."""
    tokens: int
    """The tokens of the message that shows them."""
    cut: bool
    empty: bool
    """Whether nothing was left to show, so that the earlier summary stands."""
    sampled: NotRequired[dict[str, Any]]
    """The `SampledTokens` of the reply, where the player gave them."""


class RewriteEvent(TypedDict):
    """What a compactor returned for a prompt to play, and what of it was shown."""

    event: Literal["rewrite"]
    turn: int
    """The turn that the prompt asks for."""
    messages: list[Any] | None
    """What came back: own messages, and [first, last] for a row of messages of the conversation, by their numbers.

    They are numbered from the first message after the system message. Null is what came back last time, and the
    messages since.
    """
    tokens: int
    """The tokens of the prompt with all that came back."""
    over: bool
    """Whether these are more than `prompt_tokens`, so that the oldest turns left the prompt."""
    shown: list[list[int]] | None
    """Ranges of places in what came back, first and last included; null if even the newest turn did not fit."""
    task: bool
    """Whether the task stands in front in addition, because no message of a user came first."""
    blind: bool
    """Whether the newest observation is not visible, and its words stand in no message."""


class QuestionEvent(TypedDict):
    """A question of a compactor and its answer."""

    event: Literal["question"]
    turn: int
    """The turn that the next prompt to play asks for."""
    tokens: int
    """The tokens of its prompt."""
    reply: Message | None
    """Null if the question was longer than its cap, and so not sent."""
    messages: NotRequired[list[Any]]
    """If it was not sent: its messages, in the form of `RewriteEvent.messages`. Those of others are in their view."""
    sampled: NotRequired[dict[str, Any]]
    """The `SampledTokens` of the reply, where the player gave them."""


class ChoiceEvent(TypedDict):
    """In the paper's protocol: the action that an answer chose, or fell back to."""

    event: Literal["choice"]
    turn: int
    action: str
    fallback: bool


class CallEvent(TypedDict):
    """A tool call and its answer."""

    event: Literal["call"]
    turn: int
    position: int
    name: str
    arguments: str
    """The arguments as played: the model's, unless the host changed them."""
    text: str
    is_error: bool
    done: bool
    data: dict[str, Any]
    """The result's data: `picture`, for example, is the sha256, width and height of the picture shown.

    Where the game declares them, `needs` and `breaks` (`TextGame`) are those before the action, and `action` is its
    number as the game takes it.
    """
    cut: bool
    """Whether the answer was cut to its cap."""
    host: NotRequired[Literal["edited", "refused"]]
    """What the host did to the call before it was played: it changed the arguments, or answered in the game's place."""
    refusal: NotRequired[str]
    """What the host said in place of an answer, before it was cut to its cap."""
    call_id: NotRequired[str]
    """The idempotency key that the transport sent, if any."""


class SentEvent(TypedDict):
    """A prompt that a host with its own context sent to its model, and the reply, as counted here."""

    event: Literal["sent"]
    turn: int
    """The turn that follows it."""
    tokens: int
    reply: int
    """The tokens of the reply."""
    over: bool
    """Whether the prompt is longer than `prompt_tokens`, which is measured here and not enforced."""
    sha256: str


class RevealEvent(TypedDict):
    """A privileged player was given the game itself."""

    event: Literal["reveal"]


class PictureEvent(TypedDict):
    """The player was shown a picture of the game, which no prompt has."""

    event: Literal["picture"]
    turn: int
    """The turn before which it was shown."""
    step: int


class ResumeEvent(TypedDict):
    """The episode was continued from this record, in another process or later."""

    event: Literal["resume"]
    versions: dict[str, str]


class EndEvent(TypedDict):
    """The `EpisodeResult`, with a traceback if something failed. Nothing follows it."""

    event: Literal["end"]
    result: dict[str, Any]
    traceback: str | None


class ExceptionEvent(TypedDict):
    """An exception outside of the episode that ended an attempt."""

    event: Literal["exception"]
    error: str
    traceback: str | None


EVENTS: tuple[type, ...] = (
    StartEvent,
    HeadEvent,
    ViewEvent,
    MessageEvent,
    UsageEvent,
    SummaryEvent,
    RewriteEvent,
    QuestionEvent,
    ChoiceEvent,
    CallEvent,
    SentEvent,
    RevealEvent,
    PictureEvent,
    ResumeEvent,
    EndEvent,
    ExceptionEvent,
)
"""Every kind of event."""


def concerns_summary(event: Mapping[str, object]) -> bool:
    """Whether a `view` event is of a prompt that asks for words, or a `usage` event of the reply to one.

    They are a summary, or the answer to a compactor's question (`purpose_of`).
    """
    return purpose_of(event) != "play"


def purpose_of(event: Mapping[str, Any]) -> Purpose:
    """Return what the prompt of a `view` or `usage` event asked for."""
    purpose: Purpose = event.get("purpose", "play")
    return purpose


def compares_pictures(start: Mapping[str, Any]) -> bool:
    """Whether the pictures of a record can be compared with those that a replay makes; `start` is its start event.

    The bytes of PNG files, of which older records hold the sha256, are not made again.
    """
    return start["config"].get("observation", "text") == "text" or start.get("pictures") == "pixels"


SENSELESS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    StopIteration,
    TypeError,
    ValueError,
)
"""The exceptions that Python raises if events do not have the structure of their kinds, or come in another order."""


class ErrorLocation:
    """Turn an exception about the event that is looked at into a `TranscriptError` that names it.

    `with ErrorLocation() as at: for at.number, at.event in enumerate(events, start=1): ...`
    """

    number: int
    event: Event

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, TranscriptError) or not isinstance(error, SENSELESS):
            return
        where = f"event {self.number} ({self.event.get('event')})"
        if isinstance(error, KeyError):
            raise TranscriptError(f"The record cannot be replayed: {where} has no field {error}.") from error
        what = in_one_line(error) or "out of place"
        raise TranscriptError(f"The record cannot be replayed: {where}: {what.rstrip('.')}.") from error
