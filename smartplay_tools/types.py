"""The data types of the package: budgets, tools, calls, results, prompts, replies and players.

Types that are created at every call (`ToolCall`, `ToolResult`, `Prompt`) are dataclasses; types that are validated,
stored and read back (`Budget`, `EpisodeResult`) are pydantic models. Chat messages are dictionaries
(`smartplay_tools.messages`).
"""

from __future__ import annotations

import functools
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final, Literal, Protocol, Self, runtime_checkable

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.messages import Message, copy_of
from smartplay_tools.pictures.picture import NO_PICTURES, Picture

__all__ = [
    "MISTAKES",
    "TOOL_NAMES",
    "AsyncPlayer",
    "BeyondHistory",
    "BeyondResult",
    "Budget",
    "Cap",
    "CarriedStore",
    "Count",
    "EndReason",
    "EpisodeResult",
    "ObservationForm",
    "Player",
    "Progress",
    "Prompt",
    "Purpose",
    "Recorded",
    "RecordedBudget",
    "Reply",
    "ResolvedBudget",
    "SampledTokens",
    "Tokens",
    "ToolCall",
    "ToolResult",
    "ToolSpec",
    "Usage",
    "facts_as_html",
]

TOOL_NAMES = ("observe", "act", "read_manual")
"""The tools that every agent has. There is no tool to reset, to seed or to read the score."""

NOTES_TOOL: Final = "take_notes"
"""The tool that an agent has in addition where the budget has `notes_tokens`."""

RECALL_TOOL: Final = "recall"
"""The tool that an agent has in addition where the budget has `recall_tokens`."""

PAGES_TOOL: Final = "read_result"
"""The tool that an agent has in addition where the budget has `beyond_result="offload"`."""

MEMORY_TOOL: Final = "memory"
"""The tool that an agent has in addition where the budget has `memory_tokens`."""

BeyondHistory = Literal["drop", "mask"]
"""What becomes of a turn that is older than `history`: it is dropped, or stays with its observations masked."""

BeyondResult = Literal["cut", "offload"]
"""What becomes of an observation that is over `result_tokens`: its end is cut, or a tool reads on."""

ObservationForm = Literal["text", "picture", "both"]
"""What an observation is: words, a picture that the game makes of itself, or both."""

CarriedStore = Literal["notes", "memory"]
"""What a trial of a run can leave to the next one: the agent's notes, or the files of its tool `memory`."""

Purpose = Literal["play", "summary"]
"""What a prompt asks for: the next reply of the play, or a summary of the turns that are about to leave."""


class Recorded(BaseModel):
    """Data of a record. Fields that came later are left out at the values of before, so that older records stay valid.

    `model_fields` and attributes have them all.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    later: ClassVar[Mapping[str, Any]] = {}
    """The fields that came later, and what it means in a record that one is missing; a default can be another value."""

    @model_serializer(mode="wrap")
    def _without_what_was_before(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        dumped: dict[str, Any] = serialize(self)
        for name, before in self.later.items():
            value = getattr(self, name)
            if value == before:
                dumped.pop(name, None)
            else:
                dumped.setdefault(name, value)  # a default, where defaults are left out
        return dumped

    @classmethod
    def from_record(cls, data: Mapping[str, Any]) -> Self:
        """Return the data of a record, in which a field that came later may be missing."""
        return cls(**{**cls.later, **data})


Count = Annotated[int, Field(strict=True, ge=0)]
Cap = Annotated[int, Field(strict=True, ge=1)]


STRATEGIES: Mapping[str, Any] = {
    "beyond_history": "drop",
    "notes_tokens": None,
    "summary_tokens": None,
    "own_words": None,
    "first_turns": None,
    "recall_tokens": None,
    "beyond_result": "cut",
    "memory_tokens": None,
    "newest_pictures": None,
    "strategy": None,
}
"""The fields of a budget that say what becomes of the past, and their defaults: it is dropped."""

WORDS = ("beyond_history", "beyond_result", "strategy")
"""Those of them whose values are words; the others are numbers."""


class Budget(Recorded):
    """What an agent may see and spend. None means no limit; tokens are budget tokens (`smartplay_tools.tokens`)."""

    later: ClassVar[Mapping[str, Any]] = {**STRATEGIES, "stalled_turns": None}

    history: Count | Literal["game"] | None = "game"
    """Past steps visible in addition to the current observation; "game" is the paper's number for the game."""
    prompt_tokens: Cap | None = None
    """Cap on every prompt: head, tool schemas, turns and priming."""
    reply_tokens: Cap | None = None
    """Cap on every reply."""
    episode_tokens: Cap | None = None
    """Cap on all prompts and replies of an episode together."""
    result_tokens: Cap | Literal["auto"] | None = "auto"
    """Cap on one tool result. "auto" is a quarter of what head and tool schemas leave of `prompt_tokens` (a third for
    the manual), at least 32; without `prompt_tokens` there is no cap. A number applies to every result."""
    tool_calls: Cap | Literal["game"] | None = "game"
    """Cap on tool calls; "game" is 4 x rollout + 16, so that an agent that never acts comes to an end."""
    stalled_turns: Cap | None = 10
    """Cap on turns in a row that play no step and show the model nothing new, after which the episode ends. With a
    cap, turns without a step are too old once more than `history` of them follow."""
    slack: Annotated[float, Field(ge=0, le=1)] = 0.0
    """The share of the window that is dropped at once when it is full, so that the prompt's beginning stays the same
    for many calls and the provider's cache applies. 0 always shows as much as fits."""
    beyond_history: BeyondHistory = "drop"
    """What becomes of turns older than `history`: "drop" drops them, "mask" keeps those that fit, with every
    observation older than `history` replaced by a line that says so."""
    notes_tokens: Cap | None = None
    """Cap on the agent's notes, which stay visible when older turns leave; None: there is no tool `take_notes`."""
    summary_tokens: Cap | None = None
    """Cap on the summary that the agent is asked for when turns leave the window; None: it is not asked."""
    own_words: Count | None = None
    """Past steps whose replies keep their words and reasoning; replies of older turns have their calls alone."""
    first_turns: Cap | None = None
    """The number of first turns that stay visible when later ones leave, as far as they fit; None: none of them."""
    recall_tokens: Cap | None = None
    """Cap on an answer of the tool `recall`, which searches observations that have left; None: no such tool."""
    beyond_result: BeyondResult = "cut"
    """What becomes of observations over `result_tokens`: "cut" loses their end, "offload" shows their beginning and
    adds the tool `read_result`, which reads on."""
    memory_tokens: Cap | None = None
    """Cap on the files that the agent keeps with the tool `memory`, their paths included; None: no such tool."""
    newest_pictures: Cap | None = None
    """The number of newest pictures that stay visible, where observations have pictures; None: all of them."""
    strategy: Annotated[str, Field(strict=True, min_length=1)] | None = None
    """The strategy that chooses the turns of a prompt: FILE.py:CLASS, or the name of one that an installed package
    declares, with options as in NAME:KEY=VALUE; None: the window chooses them."""

    @property
    def strategies(self) -> tuple[str, ...]:
        """The fields that say what becomes of the past, other than that it is dropped."""
        return tuple(name for name, default in STRATEGIES.items() if getattr(self, name) != default)

    def describe(self, *, beside: Budget | None = None) -> str:
        """Return the budget in words: `history 5, prompts <= 700`. What `beside` has, too, is left out.

        Without `beside` these are the defaults, so the default budget is an empty text.
        """
        beside = beside or Budget()
        differing = (name for name in Budget.model_fields if getattr(self, name) != getattr(beside, name))
        return ", ".join(_in_words(name, getattr(self, name)) for name in differing)

    def words(self) -> dict[str, str]:
        """Return every field in words, the defaults included; tables, messages and pages take them from here."""
        return {name: _in_words(name, getattr(self, name)) for name in Budget.model_fields}

    @classmethod
    def of(cls, **given: Any) -> Self:
        """Return a budget from options, where None means "not given", as in forms, and the word "none" no limit."""
        limits = {name: value for name, value in given.items() if value is not None}
        return cls(**limits | {name: None for name, value in limits.items() if value == "none"})


_CAPPED = {
    "prompt_tokens": "prompts",
    "reply_tokens": "replies",
    "episode_tokens": "episode",
    "result_tokens": "results",
    "tool_calls": "calls",
    "stalled_turns": "stalled turns",
    "notes_tokens": "notes",
    "memory_tokens": "memory",
    "recall_tokens": "recalls",
    "summary_tokens": "summaries",
}
"""What each cap of a budget is a cap on."""


@functools.lru_cache(1_000, typed=True)
def _in_words(name: str, value: Any) -> str:
    match name:
        case "history":
            return f"history {'all' if value is None else value}"
        case "slack":
            return f"slack {value:g}"
        case "beyond_history":
            return "masking" if value == "mask" else "dropping"
        case "beyond_result":
            return "offloading" if value == "offload" else "cutting"
        case "notes_tokens" | "summary_tokens" | "recall_tokens" | "memory_tokens" if value is None:
            return f"no {_CAPPED[name]}"
    if name == "own_words":
        return f"own words {'all' if value is None else value}"
    if name == "first_turns":
        return "no anchors" if value is None else f"first turns {value}"
    if name == "newest_pictures":
        return "all pictures" if value is None else f"newest pictures {value}"
    if name == "strategy":
        return "no strategy of one's own" if value is None else f"strategy {value.rpartition('/')[2]}"
    if isinstance(value, str):
        return f"{_CAPPED[name]} {value}"
    return f"{_CAPPED[name]} unlimited" if value is None else f"{_CAPPED[name]} <= {value:,}"


def _with_later_fields(data: Any) -> Any:
    return {**Budget.later, **data} if isinstance(data, dict) else data


RecordedBudget = Annotated[Budget, BeforeValidator(_with_later_fields)]
"""A budget as a field of recorded data, in which a field that came later may be missing."""


class ResolvedBudget(Budget):
    """A budget in numbers: "game" and "auto" are resolved for one game and one head."""

    history: Count | None
    result_tokens: Cap | None
    manual_tokens: Cap | None
    """Cap on the manual, for which "auto" is more than for other results."""
    tool_calls: Cap | None
    stalled_turns: Cap | None = None


@dataclass(frozen=True, slots=True)
class ToolSpec:
    """A tool as it is described to the model; `parameters` is JSON Schema, of the game's tools one for strict modes."""

    name: str
    description: str
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ToolCall:
    """A call of a tool. `arguments` is what the model sent: JSON text, or an object where the framework parsed it.

    `call_id` is the transport's idempotency key. It is never the model's own id, because models repeat ids.
    """

    name: str
    arguments: Any = None
    call_id: str | None = None


@dataclass(frozen=True, slots=True)
class ToolResult:
    """The answer to a call. The model sees exactly `text` and `picture`; `data` is for the harness and never shown."""

    text: str
    is_error: bool = False
    done: bool = False
    data: Mapping[str, Any] = field(default_factory=dict)
    picture: Picture | None = None
    """The picture of the observation, where the episode's observations are pictures."""


class SampledTokens(Recorded):
    """A reply in the tokens that the model drew, for training on records; no prompt, count or score depends on them.

    Text that is split into tokens again can give others than those that were drawn, for which alone the probabilities
    hold.
    """

    later: ClassVar[Mapping[str, Any]] = {"logprobs": None, "prompt": None}

    reply: tuple[Count, ...]
    """The ids of the reply's tokens, the one that ends it included."""
    logprobs: tuple[Annotated[float, Field(le=0, allow_inf_nan=False)], ...] | None = None
    """The natural logarithm of the probability with which each of them was drawn."""
    prompt: tuple[Count, ...] | None = None
    """The ids of the prompt's tokens. They make a record much longer, because every turn has its whole prompt."""

    @model_validator(mode="after")
    def _has_a_logprob_for_each(self) -> Self:
        if self.logprobs is not None and len(self.logprobs) != len(self.reply):
            raise ValueError(f"there are {len(self.logprobs)} logprobs for {len(self.reply)} tokens")
        return self


MOST_TOKENS = 10**12
"""More tokens than a provider can have counted for one reply."""


class Usage(Recorded):
    """Tokens as a provider reports them.

    `cached`, read from its cache, and `written` to it are parts of `prompt`, `reasoning` is a part of `reply`.
    """

    later: ClassVar[Mapping[str, Any]] = {"written": 0, "written_1h": 0, "cut": 0}

    prompt: int = 0
    reply: int = 0
    cached: int = 0
    written: int = 0
    written_1h: int = 0
    """The part of `written` that is kept for an hour, where a provider tells it apart."""
    reasoning: int = 0
    requests: int = 1
    """The attempts made for one reply, each of which is billed."""
    cut: int = 0
    """Replies that the provider ended at their length, by their `finish_reason`."""

    @classmethod
    def reported(cls, event: Mapping[str, Any]) -> Usage | None:
        """Return the provider's count in a `usage` event; None if it gave none, or numbers that cannot be tokens."""
        usage = None if event["provider"] is None else cls(**event["provider"])
        return usage if usage is not None and usage.is_possible else None

    @property
    def is_possible(self) -> bool:
        """Whether the numbers can be tokens: none is negative or beyond 10^12, and no part is larger than its whole."""
        numbers = [getattr(self, name) for name in Usage.model_fields]
        parts = self.cached + self.written <= self.prompt and self.written_1h <= self.written
        return parts and min(numbers) >= 0 and max(numbers) <= MOST_TOKENS

    def __add__(self, other: Usage) -> Usage:
        return Usage(**{name: getattr(self, name) + getattr(other, name) for name in Usage.model_fields})


class _Messages:
    """The field `messages` of a prompt: a list is the prompt's own, a tuple is copied when it is first read."""

    def __get__(self, prompt: Prompt | None, owner: type[Prompt]) -> list[Message]:
        if prompt is None:
            raise AttributeError("The messages of a prompt have no default.")
        messages = prompt.__dict__["_messages"]
        if isinstance(messages, tuple):
            messages = prompt.__dict__["_messages"] = list(map(copy_of, messages))
        own: list[Message] = messages
        return own

    def __set__(self, prompt: Prompt, messages: Sequence[Message]) -> None:
        prompt.__dict__["_messages"] = messages


@dataclass(frozen=True)
class Prompt:
    """The input of a player: messages in chat form, the tools, and how many tokens the reply may have.

    The prompts of a conversation share its messages, as a tuple, until they are first read: a player that needs only
    the tools does not pay for a long window.
    """

    messages: _Messages = _Messages()
    """The messages, which the player may change."""
    tools: tuple[ToolSpec, ...]  # type: ignore[misc]  # mypy does not see that the descriptor is not a default
    max_tokens: int | None = None
    prefix_messages: int = field(default=0, compare=False)
    """How many messages at the beginning are the same as in the previous prompt: a provider's cache can serve them."""
    purpose: Purpose = "play"
    """What is asked for. A "summary" is sent with `tool_choice`, below, and its reply is not a turn."""
    cache_key: str = field(default="", compare=False)
    """The same for all prompts of an episode, for providers that cache prompts with the same key together."""
    pictures: Mapping[str, Picture] = field(default_factory=lambda: NO_PICTURES, compare=False)
    """The pictures that the messages name, by their sha256."""

    @property
    def asks_for_summary(self) -> bool:
        """Whether a summary of the turns that are about to leave is asked for, and not the next reply of the play."""
        return self.purpose == "summary"

    @property
    def tool_choice(self) -> Literal["auto", "none"]:
        """What a provider is told about tools: a summary is written in words, though the tools are sent with it."""
        return "none" if self.asks_for_summary else "auto"

    def settings(
        self, own: Mapping[str, Any] = MappingProxyType({}), *, cap: str = "max_tokens", no_tools: Any = "none"
    ) -> dict[str, Any]:
        """Return a caller's own settings of a model with those of this prompt.

        Of two caps on the reply the smaller one applies. The tool choice is the caller's, unless tools must not be
        called; one that forbids the model to play is an `InvalidArgumentError`.

        Arguments:
            own: the caller's settings.
            cap: the provider's name of the cap on a reply.
            no_tools: the provider's value of `tool_choice` where tools must not be called.
        """
        settings = dict(own)
        if self.max_tokens is not None:
            settings[cap] = min(self.max_tokens, own.get(cap) or self.max_tokens)
        if self.tool_choice == "none":
            settings["tool_choice"] = no_tools
        elif own.get("tool_choice") in ("none", no_tools):
            raise InvalidArgumentError(
                "With the tool choice `none` the model cannot play; take it out of the settings."
            )
        return settings


@dataclass(frozen=True, slots=True)
class Reply:
    """The output of a player: an assistant message, and the provider's usage if it is known."""

    message: Message
    usage: Usage | None = None
    sampled: SampledTokens | None = None
    """The tokens of which the reply was made, where the player knows them and wants them in the record."""


@runtime_checkable
class Player(Protocol):
    """Anything that answers a prompt: a rule, a model behind an endpoint, a person at a terminal."""

    name: str

    def reply(self, prompt: Prompt) -> Reply:
        """Answer the prompt."""
        ...


@runtime_checkable
class AsyncPlayer(Protocol):
    """A player whose reply is awaited, such as a model behind a network."""

    name: str

    async def areply(self, prompt: Prompt) -> Reply:
        """Answer the prompt."""
        ...


EndReason = Literal[
    "terminated",
    "rollout",
    "tool_calls",
    "episode_tokens",
    "prompt_tokens",
    "no_tool_call",
    "stalled_turns",
    "player_error",
    "game_error",
    "strategy_error",
    "run_budget",
    "host",
    "closed",
]
"""Why an episode is over. `terminated` and `rollout` are the game's own ends; a reason with the name of a budget
means that it is spent; `host` is a limit of the framework that drove the agent (`EpisodeResult.detail` names it)."""


@dataclass(frozen=True, slots=True)
class Progress:
    """The state of an episode, before or after its end."""

    score: float
    normalized_score: float | None
    reward: float
    steps: int
    end_reason: EndReason | None
    """Why it is over; None while it runs."""


class Tokens(Recorded):
    """The tokens of an episode: our count and the provider's."""

    later: ClassVar[Mapping[str, Any]] = {"summary_prompt": 0, "summary_reply": 0}

    prompt: int = 0
    """Sum over all prompts."""
    reply: int = 0
    """Sum over all replies."""
    prefix: int = 0
    """The part of `prompt` that repeats the beginning of the previous prompt: a provider's cache can serve it."""
    overruns: int = 0
    """Replies longer than their cap; they are charged in full."""
    provider: Usage | None = None
    summary_prompt: int = 0
    """The part of `prompt` that asked for summaries."""
    summary_reply: int = 0
    """The part of `reply` that was summaries."""


class EpisodeResult(Recorded):
    """The result of an episode, a row of `results.jsonl`. It contains no times, so equal play gives equal rows."""

    later: ClassVar[Mapping[str, Any]] = dict.fromkeys(
        (
            "cut_summaries",
            "empty_summaries",
            "over_prompts",
            "pages",
            "recalls",
            "refused_memory",
            "refused_notes",
            "summaries",
            "unusable_usages",
        ),
        0,
    )

    game: str
    engine: str | None = None
    seed: int
    score: float
    normalized_score: float | None
    reward: float
    completed: bool
    steps: int
    turns: int
    tool_calls: int
    """Calls answered while the episode ran, mistakes included."""
    illegal_actions: int
    malformed_calls: int
    refused_calls: int
    """Calls refused by the batch policy, calls after the end of the game in the same message, calls in a summary."""
    idle_replies: int
    """Replies without a tool call."""
    fallback_actions: int = 0
    """Answers in which the paper's protocol found no action, so that the first one was played."""
    tokens: Tokens
    cut_results: int
    refused_notes: int = 0
    """Notes that were longer than `notes_tokens`, so that the earlier ones stood."""
    refused_memory: int = 0
    """Calls of `memory` that would have made its files larger than `memory_tokens`, so that nothing changed."""
    recalls: int = 0
    """Answers of `recall`, empty ones included."""
    pages: int = 0
    """Pages of results that were read with `read_result`."""
    summaries: int = 0
    """Summaries that were asked for and answered: one for each time that the window moved."""
    cut_summaries: int = 0
    """Summaries whose end was cut to `summary_tokens`."""
    empty_summaries: int = 0
    """Summaries of which nothing was left to show, so that the earlier one stood."""
    over_prompts: int = 0
    """Prompts of a host that owns the context which were longer than `prompt_tokens`; they were counted, not cut."""
    unusable_usages: int = 0
    """Usages that a provider reported with numbers that cannot be tokens; they count as none."""
    end_reason: EndReason
    error: str | None = None
    """The exception's type and message for an end whose name ends in `_error`; its traceback is in the transcript."""
    detail: str | None = None
    """The host's name for the limit that ended the episode (`host`)."""
    state_hash: str
    context: Literal["window", "host"]
    deviations: dict[str, Any]
    """The differences from the paper's protocol: name -> {"paper": ..., "played": ...}."""
    versions: dict[str, str]

    def _repr_html_(self) -> str:
        human = "" if self.normalized_score is None else f" ({self.normalized_score:.0%} of the human score)"
        names = ("illegal_actions", "malformed_calls", "refused_calls", "idle_replies", "cut_results")
        mistakes = [f"{getattr(self, name)} {name.replace('_', ' ')}" for name in names if getattr(self, name)]
        facts = {
            "score": f"{self.score:g}{human}",
            "end": self.end_reason + (f": {self.error}" if self.error else ""),
            "steps": f"{self.steps} in {self.turns} turns",
            "tokens": f"{self.tokens.prompt:,} in prompts, {self.tokens.reply:,} in replies",
            "mistakes": ", ".join(mistakes) or "none",
            "seed": str(self.seed),
        }
        return facts_as_html(self.game, facts)


MISTAKES = ("illegal_actions", "malformed_calls", "idle_replies", "fallback_actions")
"""The counts of an `EpisodeResult` that are a model's mistakes; the batch policy decides about refused calls."""


def facts_as_html(title: str, facts: Mapping[str, str]) -> str:
    """Return a title and facts as a small table, as a notebook shows objects."""
    rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in facts.items())
    return f"<div><b>{html.escape(title)}</b><table>{rows}</table></div>"
