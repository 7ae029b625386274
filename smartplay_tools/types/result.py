"""The results of calls and of episodes, with the tools that are called and the tokens of replies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from smartplay_tools.types.budget import Count, NewerCost, NewerCount, Recorded
from smartplay_tools.types.pictures import Picture

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

ObservationForm = Literal["text", "picture", "both"]
"""What an observation is: words, a picture that the game makes of itself, or both."""


@dataclass(frozen=True, slots=True)
class ToolSpec:
    """A tool as it is described to the model; `parameters` is JSON Schema, of the game's tools a strict one."""

    name: str
    description: str
    parameters: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Return the tool as plain data, as records and the sha256 of a prompt hold it."""
        return {"name": self.name, "description": self.description, "parameters": self.parameters}


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

    Tokenising the text again can give tokens other than those drawn, and the probabilities hold only for those drawn.
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

    prompt: int = 0
    reply: int = 0
    cached: int | None = None
    """None if the provider does not say; then all tokens of the prompt cost the same."""
    written: NewerCount = 0
    written_1h: NewerCount = 0
    """The part of `written` that is kept for an hour, where a provider reports it separately."""
    reasoning: int = 0
    requests: int = 1
    """The attempts made for one reply, each of which is billed."""
    cut: NewerCount = 0
    """Replies that the provider cut at their length limit, by their `finish_reason`."""
    refused: NewerCount = 0
    """Replies that were refusals, or that a filter of the provider took away."""
    broken_calls: NewerCount = 0
    """Replies whose malformed call the provider kept to itself, as Gemini does."""
    paused: NewerCount = 0
    """Replies in the middle of which the provider paused, as Anthropic does in long turns."""
    managed: NewerCount = 0
    """Replies before which the provider managed the context, as it was asked to, or as it says it has."""
    edits: NewerCount = 0
    """Edits and compactions that it reports."""
    cleared: NewerCount = 0
    """The tokens that these have cleared, as it reports."""

    @classmethod
    def reported(cls, event: Mapping[str, Any]) -> Usage | None:
        """Return the provider's count in a `usage` event; None if it gave none, or numbers that cannot be tokens."""
        usage = None if event["provider"] is None else cls(**event["provider"])
        return usage if usage is not None and usage.is_possible else None

    @property
    def is_possible(self) -> bool:
        """Whether the numbers can be tokens: none is negative or beyond 10^12, and no part is larger than its whole."""
        numbers = [getattr(self, name) or 0 for name in Usage.model_fields]
        parts = (self.cached or 0) + self.written <= self.prompt and self.written_1h <= self.written
        return parts and self.reasoning <= self.reply and min(numbers) >= 0 and max(numbers) <= MOST_TOKENS

    def checked(self, total: int | None) -> Usage:
        """Return the usage with all its parts in their wholes; `total` is the provider's own sum of its tokens.

        OpenAI counts thoughts in the reply. xAI, and Gemini behind gateways, count them beside it, in the total alone,
        and some gateways count the tokens of a cache beside the prompt.
        """
        beside, cache = max(0, (total or 0) - self.prompt - self.reply), (self.cached or 0) + self.written
        if beside and beside != self.reasoning and beside == cache:
            return self.model_copy(update={"prompt": self.prompt + beside})
        thoughts = max(beside, self.reasoning if self.reasoning > self.reply else 0)
        reasoning = self.reasoning or thoughts
        return self.model_copy(update={"reply": self.reply + thoughts, "reasoning": reasoning}) if thoughts else self

    @property
    def has_tokens(self) -> bool:
        """Whether a provider has counted any: what asks it counts its requests even where it reports no tokens."""
        return self.prompt > 0 or self.reply > 0

    def replaced_by(self, reported: Usage | None) -> Usage:
        """Return the usage that a provider reported in place of our count, which this is.

        Without tokens in it, or with numbers that cannot be tokens, its requests and cut replies count, and our tokens.
        """
        if reported is None:
            return self
        if reported.has_tokens and reported.is_possible:
            return reported
        return self.model_copy(
            update={name: getattr(reported, name) for name in ("requests", "cut", *UNUSUAL_ENDS, *MANAGED)}
        )

    def __add__(self, other: Usage) -> Usage:
        """Return the sum; what one of the two does not know is unknown, unless it has no tokens."""
        counts = [name for name in Usage.model_fields if name != "cached"]
        cached = [usage.cached for usage in (self, other) if usage.has_tokens]
        known = [count for count in cached if count is not None]
        total = {name: getattr(self, name) + getattr(other, name) for name in counts}
        return Usage(**total, cached=sum(known) if len(known) == len(cached) else None)


UNUSUAL_ENDS: Mapping[str, str] = {
    "refused": "refused by the model or a filter of its provider",
    "broken_calls": "kept back by the provider for a malformed call",
    "paused": "paused by the provider",
}
"""The counts of a `Usage` that tell why a reply has no calls, in words."""

MANAGED = ("managed", "edits", "cleared")
"""The counts of a `Usage` that tell what the provider did to the context."""

CarriedStore = Literal["notes", "memory"]
"""What a trial of a run can leave to the next one: the agent's notes, or the files of its tool `memory`."""

EndReason = Literal[
    "terminated",
    "rollout",
    "tool_calls",
    "episode_tokens",
    "episode_cost",
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
means that it is spent; `host` is a limit of the framework that drove the agent, or of the model's server, which refuses
a prompt (`EpisodeResult.detail` names it)."""

GAME_ENDS: tuple[EndReason, ...] = ("terminated", "rollout")
"""The game's own ends; every other one is early: a cap, a stall, an error, a host or a person has caused it."""


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

    prompt: int = 0
    """Sum over all prompts."""
    reply: int = 0
    """Sum over all replies."""
    prefix: int = 0
    """The part of `prompt` that repeats the beginning of the previous prompt: a provider's cache can serve it."""
    overruns: int = 0
    """Replies longer than their cap; they are charged in full."""
    provider: Usage | None = None
    summary_prompt: NewerCount = 0
    """The part of `prompt` that asked for summaries."""
    summary_reply: NewerCount = 0
    """The part of `reply` that was summaries."""
    question_prompt: NewerCount = 0
    """The part of `prompt` that was a compactor's questions."""
    question_reply: NewerCount = 0
    """The part of `reply` that answered them."""
    texts: NewerCount = 0
    """The part of `prompt` that custom strategies have written."""


class EpisodeResult(Recorded):
    """The result of an episode, a row of `results.jsonl`. It contains no times, so equal play gives equal rows."""

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
    """Calls refused by the batch policy, calls after the end of the game in the same message, calls in a summary or
    in the answer to a compactor's question."""
    idle_replies: int
    """Replies without a tool call."""
    fallback_actions: int = 0
    """Answers in which the paper's protocol found no action, so that the game's first action was played."""
    tokens: Tokens
    cut_results: int
    refused_notes: NewerCount = 0
    """Notes that were longer than `notes_tokens`, so that the earlier ones stood."""
    refused_memory: NewerCount = 0
    """Calls of `memory` that would have made its files larger than `memory_tokens`, so that nothing changed."""
    recalls: NewerCount = 0
    """Answers of `recall`, empty ones included."""
    pages: NewerCount = 0
    """Pages of results that were read with `read_result`."""
    summaries: NewerCount = 0
    """Summaries that were asked for and answered: one for each time that the window moved."""
    cut_summaries: NewerCount = 0
    """Summaries whose end was cut to `summary_tokens`."""
    empty_summaries: NewerCount = 0
    """Summaries of which nothing was left to show, so that the earlier one stood."""
    over_prompts: NewerCount = 0
    """Prompts over `prompt_tokens` as a host or a compactor made them: a host's were counted, a compactor's cut."""
    over_peak: NewerCount = 0
    """The tokens of the largest of those that a compactor made."""
    rewrites: NewerCount = 0
    """Prompts for which a compactor returned something else than the last time and the new messages."""
    questions: NewerCount = 0
    """Questions that a compactor asked, refused ones included."""
    refused_questions: NewerCount = 0
    """Questions that were not sent, because they were longer than `question_tokens`."""
    blind_prompts: NewerCount = 0
    """Prompts of a compactor in which the newest observation is not visible, and its words stand in no message."""
    spent_cost: NewerCost = 0.0
    """What prompts and replies cost by the budget's `cost_rule`, where it has a cap on that (`episode_cost`)."""
    unusable_usages: NewerCount = 0
    """Usages reported by a provider whose numbers cannot be token counts; they are ignored."""
    end_reason: EndReason
    error: str | None = None
    """The exception's type and message for an end whose name ends in `_error`; its traceback is in the transcript."""
    detail: str | None = None
    """The limit of the host or the server that ended the episode (`host`), or why no call came (`no_tool_call`)."""
    state_hash: str
    context: Literal["window", "host"]
    deviations: dict[str, Any]
    """The differences from the paper's protocol: name -> {"paper": ..., "played": ...}."""
    versions: dict[str, str]


MISTAKES = ("illegal_actions", "malformed_calls", "idle_replies", "fallback_actions")
"""The counts of an `EpisodeResult` that are a model's mistakes; refused calls are not, as the batch policy decides
those."""
