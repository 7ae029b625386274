"""Budgets: what an agent may see and spend, what becomes of its past, and how each field reads in words.

The base class of recorded data, which leaves out newer fields where older versions meant the same.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer


class Recorded(BaseModel):
    """Data of a record. A newer field is left out at the value that older records imply, so these stay valid.

    `model_fields` and attributes have all fields.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    later: ClassVar[Mapping[str, Any]] = {}
    """The newer fields, each with the value that a record without it has; the default can be another value."""

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
        """Return the data of a record, in which newer fields may be missing."""
        return cls(**{**cls.later, **data})


Count = Annotated[int, Field(strict=True, ge=0)]

Cap = Annotated[int, Field(strict=True, ge=1)]


BeyondHistory = Literal["drop", "mask"]
"""What becomes of a turn that is older than `history`: it is dropped, or stays with its observations masked."""

BeyondResult = Literal["cut", "offload"]
"""What becomes of an observation that is over `result_tokens`: its end is cut, or a tool reads on."""

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
"""The fields of a budget that say what becomes of the past, and their defaults, under which it is dropped."""

WORDS = ("beyond_history", "beyond_result", "strategy")
"""The fields among these whose values are words; those of the others are numbers."""


class Budget(Recorded):
    """What an agent may see and spend. None means no limit; tokens are those of `smartplay_tools.context.tokens`."""

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
        """The names of the fields that keep some of the past, instead of dropping it."""
        return tuple(name for name, default in STRATEGIES.items() if getattr(self, name) != default)

    def describe(self, *, beside: Budget | None = None) -> str:
        """Return the budget in words: `history 5, prompts <= 700`, without the fields that are equal in `beside`.

        By default `beside` is the default budget, whose own text is empty.
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
        return "built-in window" if value is None else f"strategy {value.rpartition('/')[2]}"
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
