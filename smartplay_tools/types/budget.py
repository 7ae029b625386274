"""Budgets: what an agent may see and spend, and what happens to its past.

Every field says in its annotation how it reads in tables, messages and pages (`Reads`), and a field that asks for a
strategy for the past says so (`Keeps`). `STRATEGIES`, `Budget.describe` and the fields of older records follow from the
annotations, so a new field cannot be missing in any of them.

`Recorded` is the base class of recorded data. A field that is newer than the first version is left out of a record
while it has the meaning that records had before the field existed.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from smartplay_tools.errors import InvalidArgumentError, similar

NEWER = "newer than the first records, in which it is 0"

NewerCount = Annotated[int, NEWER]
"""A count that older records lack."""


NewerCost = Annotated[float, NEWER]
"""A cost that older records lack."""


class Recorded(BaseModel):
    """Data of a record. A newer field is left out at the value that older records imply, so these stay valid.

    `model_fields` and attributes have all fields.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    later: ClassVar[Mapping[str, Any]] = {}
    """The newer fields, each with the value that a record without it has; the default can be another value.

    Counts that are annotated as `NewerCount` are among them.
    """

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        counts = [name for name, field in cls.model_fields.items() if NEWER in field.metadata]
        cls.later = {**cls.later, **dict.fromkeys(counts, 0)}

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
        return cls.model_validate({**cls.later, **data})


Count = Annotated[int, Field(strict=True, ge=0)]

Cap = Annotated[int, Field(strict=True, ge=1)]

Cost = Annotated[float, Field(gt=0, allow_inf_nan=False)]


BeyondHistory = Literal["drop", "mask"]
"""What happens to a turn older than `history`: it is dropped, or stays with its observations masked."""

BeyondResult = Literal["cut", "offload"]
"""What happens to an observation longer than `result_tokens`: its end is cut, or a tool reads on."""


@dataclass(frozen=True)
class Reads:
    """How a field of a budget reads in tables, messages and pages, as an annotation of the field."""

    words: Callable[[Any], str]
    """Returns a value in words."""


@dataclass(frozen=True)
class Keeps(Reads):
    """The same for a field that asks for a strategy for the past; at the field's default the past is dropped."""

    is_text: bool = False
    """Whether its values are text; the others are numbers."""


def _cap_on(what: str) -> Callable[[Any], str]:
    def words(cap: int | str | None) -> str:
        if isinstance(cap, str):
            return f"{what} {cap}"
        return f"{what} unlimited" if cap is None else f"{what} <= {cap:,}"

    return words


def _cap_or_none(what: str) -> Callable[[Any], str]:
    return lambda cap: f"no {what}" if cap is None else f"{what} <= {cap:,}"


def _number(what: str, without: str) -> Callable[[Any], str]:
    return lambda number: without if number is None else f"{what} {number}"


def _amount(what: str) -> Callable[[Any], str]:
    return lambda cap: f"{what} unlimited" if cap is None else f"{what} <= {cap:,.12g}"


def _choice(**words: str) -> Callable[[Any], str]:
    return words.__getitem__


def _rule(line: str | None) -> str:
    if line is None:
        return "costs without a cache"
    name, _, day = line.partition(",read_on=")
    return f"costs by {name.partition(':input=')[0]} of {day}" if day else f"costs by {line}"


def _spelled_out(line: str) -> str | None:
    """The rule of costs that a line names, in numbers; `none` is no rule."""
    from smartplay_tools.providers.cost_rules import cost_rule

    try:
        return None if line == "none" else str(cost_rule(line))
    except InvalidArgumentError as error:
        raise PydanticCustomError("cost_rule", "{why}", {"why": str(error).removesuffix(".")}) from None


def _custom(strategy: str | None) -> str:
    return "built-in window" if strategy is None else f"strategy {strategy.rpartition('/')[2]}"


class Budget(Recorded):
    """What an agent may see and spend. None means no limit; tokens are those of `smartplay_tools.context.tokens`."""

    history: Annotated[Count | Literal["game"] | None, Reads(_number("history", "history all"))] = "game"
    """Past steps visible in addition to the current observation; "game" is the paper's number for the game."""
    prompt_tokens: Annotated[Cap | None, Reads(_cap_on("prompts"))] = None
    """Cap on every prompt: head, tool schemas, turns and priming."""
    question_tokens: Annotated[Cap | None, Reads(_cap_on("questions"))] = None
    """Cap on the prompt of a question that a compactor asks (`strategy`); by default that of all prompts."""
    reply_tokens: Annotated[Cap | None, Reads(_cap_on("replies"))] = None
    """Cap on every reply."""
    episode_tokens: Annotated[Cap | None, Reads(_cap_on("episode"))] = None
    """Cap on all prompts and replies of an episode together."""
    episode_cost: Annotated[Cost | None, Reads(_amount("costs"))] = None
    """Cap on what all prompts and replies of an episode cost together, by `cost_rule`."""
    cost_rule: Annotated[Annotated[str, AfterValidator(_spelled_out)] | None, Reads(_rule)] = None
    """What a token costs, and what is cached: a rule of `docs/context-cost.md`, PROVIDER:MODEL, or numbers; None: a
    token of a prompt costs 1 and one of a reply 5, and nothing is cached."""
    result_tokens: Annotated[Cap | Literal["auto"] | None, Reads(_cap_on("results"))] = "auto"
    """Cap on one tool result. "auto" is a quarter of what head and tool schemas leave of `prompt_tokens` (a third for
    the manual), at least 32; without `prompt_tokens` there is no cap. A number applies to every result."""
    tool_calls: Annotated[Cap | Literal["game"] | None, Reads(_cap_on("calls"))] = "game"
    """Cap on tool calls; "game" is 4 x rollout + 16, so that an agent that never acts comes to an end."""
    stalled_turns: Annotated[Cap | None, Reads(_cap_on("stalled turns"))] = 10
    """Cap on turns in a row that play no step and show the model nothing new, after which the episode ends. With a
    cap, turns without a step are too old once more than `history` of them follow."""
    slack: Annotated[float, Field(ge=0, le=1), Reads("slack {:g}".format)] = 0.0
    """The share of the window that is dropped at once when it is full, so that the prompt's beginning stays the same
    for many calls and the provider's cache applies. 0 always shows as much as fits."""
    beyond_history: Annotated[BeyondHistory, Keeps(_choice(drop="dropping", mask="masking"), is_text=True)] = "drop"
    """What happens to turns older than `history`: "drop" drops them, "mask" keeps those that fit, with every
    observation older than `history` replaced by a line that says so."""
    notes_tokens: Annotated[Cap | None, Keeps(_cap_or_none("notes"))] = None
    """Cap on the agent's notes, which stay visible when older turns leave; None: there is no tool `take_notes`."""
    summary_tokens: Annotated[Cap | None, Keeps(_cap_or_none("summaries"))] = None
    """Cap on the summary that the agent is asked for when turns leave the window; None: it is not asked."""
    own_words: Annotated[Count | Literal["never"] | None, Keeps(_number("own words", "own words all"))] = None
    """Past steps whose replies keep their words and reasoning; replies of older turns have their calls alone. "never":
    so has the newest one."""
    first_turns: Annotated[Cap | None, Keeps(_number("first turns", "no anchors"))] = None
    """The number of first turns that stay visible when later ones leave, as far as they fit; None: none of them."""
    recall_tokens: Annotated[Cap | None, Keeps(_cap_or_none("recalls"))] = None
    """Cap on an answer of the tool `recall`, which searches observations that have left; None: no such tool."""
    beyond_result: Annotated[BeyondResult, Keeps(_choice(cut="cutting", offload="offloading"), is_text=True)] = "cut"
    """What happens to observations longer than `result_tokens`: "cut" loses their end, "offload" shows their beginning
    and adds the tool `read_result`, which reads on."""
    memory_tokens: Annotated[Cap | None, Keeps(_cap_or_none("memory"))] = None
    """Cap on the files that the agent keeps with the tool `memory`, their paths included; None: no such tool."""
    newest_pictures: Annotated[Cap | None, Keeps(_number("newest pictures", "all pictures"))] = None
    """The number of newest pictures that stay visible, where observations have pictures; None: all of them."""
    strategy: Annotated[Annotated[str, Field(strict=True, min_length=1)] | None, Keeps(_custom, is_text=True)] = None
    """The strategy that chooses the turns of a prompt, or rewrites them: FILE.py:CLASS, or the name of one that an
    installed package declares, with options as in NAME:KEY=VALUE; None: the window chooses them."""

    if not TYPE_CHECKING:  # type checkers know the fields from their annotations

        def __init__(self, **fields: Any) -> None:
            try:
                super().__init__(**fields)
            except ValidationError as error:
                raise InvalidArgumentError(_fault(error)) from error

        __init__.__pydantic_base_init__ = True  # records are validated without it

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


def _fault(error: ValidationError) -> str:
    """Return the first fault of a budget as a sentence."""
    first = error.errors()[0]
    name = first["loc"][0]
    if first["type"] == "extra_forbidden":
        return f"A budget has no field {name!r}; {similar(name, Budget.model_fields)}"
    return f"{name}={first['input']!r} is no limit of a budget: {first['msg'][:1].lower()}{first['msg'][1:]}."


def _reading(name: str) -> Reads:
    readings = [each for each in Budget.model_fields[name].metadata if isinstance(each, Reads)]
    if not readings:
        raise TypeError(f"The field {name} of Budget does not say how it reads; annotate it with `Reads` or `Keeps`.")
    return readings[0]


_READINGS = {name: _reading(name) for name in Budget.model_fields}

_KEEPING = {name: reading for name, reading in _READINGS.items() if isinstance(reading, Keeps)}

STRATEGIES: Mapping[str, Any] = {name: Budget.model_fields[name].default for name in _KEEPING}
"""The fields of a budget that ask for a strategy for the past, and their defaults, under which it is dropped."""

WORDS = tuple(name for name, reading in _KEEPING.items() if reading.is_text)
"""The fields among these whose values are words; those of the others are numbers."""

Budget.later = {**STRATEGIES, "stalled_turns": None, "question_tokens": None, "episode_cost": None, "cost_rule": None}


@functools.lru_cache(1_000, typed=True)
def _in_words(name: str, value: Any) -> str:
    return _READINGS[name].words(value)


def _with_later_fields(data: Any) -> Any:
    return {**Budget.later, **data} if isinstance(data, dict) else data


RecordedBudget = Annotated[Budget, BeforeValidator(_with_later_fields)]
"""A budget as a field of recorded data, in which a field that came later may be missing."""


class ResolvedBudget(Budget):
    """A budget in numbers: "game" and "auto" are resolved for one game and one head. By default there is no limit."""

    history: Count | None = None
    result_tokens: Cap | None = None
    manual_tokens: Cap | None = None
    """Cap on the manual, for which "auto" is more than for other results."""
    tool_calls: Cap | None = None
    stalled_turns: Cap | None = None
