"""The events of a transcript as types: one class for each kind, in the order in which they can occur.

A record has two kinds of information. The events about what happened (`start`, `message`, `usage`, `summary`,
`question`, `choice`, `call`, `reveal`, `picture`, `end`) can be replayed on a new game. The events about what was shown
(`head`, `rewrite`, `view`) allow every prompt to be rebuilt exactly. A test compares the table in
`docs/records.md` with these classes.

`event_fault` checks an event once, when its line is read: its fields have the types of its class, so what reads events
need not check them. A value can still be out of place, such as a turn that does not exist; `record_named` reports that
in one sentence, with the number of the event.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NotRequired, Self, get_args, get_type_hints

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from typing_extensions import TypedDict, is_typeddict  # Pydantic needs it on Python 3.11

from smartplay_tools.errors import in_one_line
from smartplay_tools.types import EpisodeResult, Purpose, Tokens, Usage
from smartplay_tools.types.messages import Message
from smartplay_tools.types.sums import MOST

FORMAT = 1
"""The version of the format that is written. A reader refuses records whose format it does not support."""

Event = dict[str, Any]
"""An event in a file: one of the classes below, with its `chain`."""

Count = Annotated[int, Field(ge=0, le=MOST)]
Amount = Annotated[float, Field(ge=-MOST, le=MOST, allow_inf_nan=False)]
Sum = Annotated[float, Field(ge=-(MOST**2), le=MOST**2, allow_inf_nan=False)]
"""What is computed from amounts: the sum of rewards, or a score in human scores."""


class RecordedResult(EpisodeResult):
    """An `EpisodeResult` in a record or a row, where a later version may have added fields."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)

    score: Amount
    normalized_score: Sum | None
    reward: Sum

    @model_validator(mode="after")
    def _has_its_fields(self) -> Self:
        """Require what every version has written: readers of plain data know no defaults of it."""
        for part, kind in ((self, EpisodeResult), (self.tokens, Tokens)):
            if absent := kind.model_fields.keys() - kind.later.keys() - part.model_fields_set:
                raise ValueError(f"there is no {min(absent)}")
        return self


def _result(value: dict[str, Any]) -> dict[str, Any]:
    RecordedResult.model_validate(value, strict=True)
    return value


def _usage(value: dict[str, Any]) -> dict[str, Any]:
    Usage.model_validate(value, strict=True)
    return value


class StartEvent(TypedDict):
    """The episode: the fields of `EpisodeConfig`, and values derived from them."""

    event: Literal["start"]
    format: Any
    config: dict[str, Any]
    """The `EpisodeConfig`, without fields at their defaults."""
    budget: dict[str, Any]
    """The budget in numbers (`ResolvedBudget`)."""
    cut_results: Count
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
    since: NotRequired[Count]
    """Of a head that was changed: the first turn whose prompt has it. Absent in older records."""
    aged_task: NotRequired[str]
    """Where the task ends with the first observation: the task once that is too old."""
    compacts: NotRequired[bool]
    """With a compactor: true. The notes are then a part of the system message, and a manual that was read is not."""
    cut_results: NotRequired[int]
    """In the paper's protocol: how many of manual and first observation were cut."""


class ViewEvent(TypedDict):
    """What a prompt showed: which turns, which results were masked, and the prompt's sha256."""

    event: Literal["view"]
    turn: Count
    """The turn that the prompt asks for."""
    tokens: Count
    max_tokens: Count | None
    prefix_tokens: Count
    shown_steps: Count
    dropped_turns: Count
    turns: NotRequired[list[list[Count]]]
    """Ranges of turns, first and last included; with a compactor those of which the prompt shows messages."""
    masked: NotRequired[list[list[Count]]]
    """[turn, item] of every result whose observation has left the window; not with a budget that has strategies."""
    purpose: NotRequired[Purpose]
    """With strategies: what the prompt asks for. A prompt for a summary has the head of the turn before."""
    oldest: NotRequired[Count]
    """With strategies: observations before this one are masked."""
    notes: NotRequired[Count | None]
    """With strategies: the pinned turn with the notes, of which every observation is masked."""
    pinned: NotRequired[Count | None]
    """With another strategy that pins a turn: that turn, of which every observation is masked."""
    words: NotRequired[Count]
    """With `own_words`: replies of turns older than this step are bare."""
    pictures: NotRequired[Count]
    """With `newest_pictures`: how many of the first pictures of the conversation are left out."""
    anchors: NotRequired[Count]
    """With `first_turns`: how many first turns are pinned; those before the run of newest turns precede the summary."""
    hidden: NotRequired[list[list[Count]]]
    """With a custom strategy: ranges of the turns whose observations it masks."""
    texts: NotRequired[list[Any]]
    """With a custom strategy: its texts, each as [turn, text], a user message before that turn."""
    summary: NotRequired[Count]
    """With strategies: the number of `summary` events so far; the text of the last one is shown."""
    messages: NotRequired[list[Any]]
    """With the purpose "compaction": the messages of the question, in the form of `RewriteEvent.messages`."""
    question: NotRequired[Count]
    """In the paper's protocol: 1 or 2, the step of the current observation, and the first step of the history."""
    step: NotRequired[Count]
    first: NotRequired[Count]
    sha256: str


class MessageEvent(TypedDict):
    """A reply (`by` is "player"), or a message that the host or this library added after it."""

    event: Literal["message"]
    turn: Count
    by: Literal["player", "host", "library"]
    message: Message
    ids: NotRequired[list[str]]
    """The ids of a reply's calls in the conversation, if they differ from those that the model sent."""
    position: NotRequired[Count]
    """Which call of the reply a foreign tool's result answers."""
    sampled: NotRequired[dict[str, Any]]
    """The `SampledTokens` of a reply, where the player gave them."""


class UsageEvent(TypedDict):
    """The tokens of a reply: our count and the provider's. Without a reply, only the provider's."""

    event: Literal["usage"]
    turn: Count
    prompt: NotRequired[Count]
    reply: NotRequired[Count]
    prefix: NotRequired[Count]
    overrun: NotRequired[bool]
    texts: NotRequired[Count]
    """The part of `prompt` that a custom strategy has written."""
    spent: NotRequired[Annotated[float, Field(ge=0, allow_inf_nan=False)]]
    """What the episode has cost so far, where its budget is in money."""
    purpose: NotRequired[Literal["summary", "compaction"]]
    """Present on the usage of a summary or of a question; the turn has its own usage."""
    provider: Annotated[dict[str, Any], AfterValidator(_usage)] | None


class SummaryEvent(TypedDict):
    """The reply to a prompt for a summary, and what is shown of it."""

    event: Literal["summary"]
    turn: Count
    """The turn that the next prompt to play asks for."""
    covers: Count
    """The first turn that has not left the window: the summary replaces those before it."""
    message: Message
    text: str
    """The words that are shown from now on: the reply's, cut to their cap, or the earlier summary's; "" for none."""
    tokens: Count
    """The tokens of the message that shows them."""
    cut: bool
    empty: bool
    """Whether nothing was left to show, so that the earlier summary stands."""
    sampled: NotRequired[dict[str, Any]]
    """The `SampledTokens` of the reply, where the player gave them."""


class RewriteEvent(TypedDict):
    """What a compactor returned for a prompt to play, and what of it was shown."""

    event: Literal["rewrite"]
    turn: Count
    """The turn that the prompt asks for."""
    messages: list[Any] | None
    """What came back: own messages, and [first, last] for a row of messages of the conversation, by their numbers.

    They are numbered from the first message after the system message. Null is what came back last time, and the
    messages since.
    """
    tokens: Count
    """The tokens of the prompt with all that came back."""
    over: bool
    """Whether these are more than `prompt_tokens`, so that the oldest turns left the prompt."""
    shown: list[list[Count]] | None
    """Ranges of places in what came back, first and last included; null if even the newest turn did not fit."""
    task: bool
    """Whether the task stands in front in addition, because no message of a user came first."""
    blind: bool
    """Whether the newest observation is not visible, and its words stand in no message."""


class QuestionEvent(TypedDict):
    """A question of a compactor and its answer."""

    event: Literal["question"]
    turn: Count
    """The turn that the next prompt to play asks for."""
    tokens: Count
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
    turn: Count
    action: str
    fallback: bool


class CallData(TypedDict, total=False):
    """What readers of records use of a result's data; a game may add more."""

    score: Amount
    reward: Amount
    step: Count
    observation_step: Count | None
    state_hash: str
    action: int
    needs: list[int]
    contents: dict[str, str]
    breaks: list[int]
    legal: bool
    manual: bool
    mistake: str | None
    picture: dict[str, Any]


class CallEvent(TypedDict):
    """A tool call and its answer."""

    event: Literal["call"]
    turn: Count
    position: Count
    name: str
    arguments: str
    """The arguments as played: the model's, unless the host changed them."""
    text: str
    is_error: bool
    done: bool
    data: CallData
    """The result's data: `picture`, for example, is the sha256, width and height of the picture shown.

    Where the game declares them, `needs` and `breaks` (`TextGame`) are those before the action, and `action` is its
    number as the game takes it. `contents` are those of needed steps that no earlier action has, or has otherwise.
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
    turn: Count
    """The turn that follows it."""
    tokens: Count
    reply: Count
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
    turn: Count
    """The turn before which it was shown."""
    step: Count


class ResumeEvent(TypedDict):
    """The episode was continued from this record, in another process or later."""

    event: Literal["resume"]
    versions: dict[str, str]


class EndEvent(TypedDict):
    """The `EpisodeResult`, with a traceback if something failed. Nothing follows it."""

    event: Literal["end"]
    result: Annotated[dict[str, Any], AfterValidator(_result)]
    traceback: str | None


class ExceptionEvent(TypedDict):
    """An exception outside of the episode that ended an attempt."""

    event: Literal["exception"]
    error: str
    traceback: str | None


EVENTS: tuple[type, ...] = tuple(
    each for each in [*vars().values()] if is_typeddict(each) and "event" in each.__annotations__
)
"""Every kind of event: the classes above."""


@functools.cache
def _kinds() -> Mapping[str, TypeAdapter[Any]]:
    return {get_args(get_type_hints(each)["event"])[0]: TypeAdapter(each) for each in EVENTS}


def event_fault(value: Event) -> str | None:
    """Return what keeps an event from being one of its kind, None if nothing does; a newer kind is not checked."""
    if (kind := value["event"]) not in _kinds():
        return None
    try:
        _kinds()[kind].validate_python(value, strict=True)
    except ValidationError as error:
        return f"is no valid {kind} event: {in_one_line(error)}"
    return None


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
