"""The options of a run: how its episodes are played, and where its caps are. None of them changes an episode.

`evaluate`, `sweep` and the commands have the same ones, each defined here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self, TypedDict

from smartplay_tools.episode.config import (
    BatchPolicy,
    BudgetLine,
    FirstObservation,
    ManualMode,
    OfferedTools,
    ProtocolName,
)
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.plan import PlannedEpisode
from smartplay_tools.providers.prices import Price, check_given
from smartplay_tools.records.rows import Row
from smartplay_tools.types import CarriedStore, ObservationForm


@dataclass(frozen=True)
class RunProgress:
    """The end of an attempt or, without an episode, the start of the run."""

    finished: int
    planned: int
    failed_attempts: int
    """Since this run began."""
    episode: PlannedEpisode | None = None
    row: Row | None = None
    """The episode's row if it is finished."""
    error: str | None = None
    """Why the attempt has no result, if it has none."""


OnProgress = Callable[[RunProgress], None]


@dataclass(frozen=True)
class RunOptions:
    """How a run is played; the same run can be continued with other options."""

    executor: str | None = None
    """"inline", "processes", "async" or "ray"; if not given, the one that suits each player."""
    workers: int | None = None
    """Episodes at a time."""
    run_tokens: int | None = None
    """Cap on the whole run in budget tokens."""
    run_cost: float | None = None
    """Cap on the whole run in US dollars."""
    prices: Mapping[str, Price] | None = None
    """The price of a player's tokens, if `genai-prices` does not have it."""
    on_progress: OnProgress | None = None
    """Called when the run has begun and after every attempt."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InvalidArgumentError(f"workers must be at least 1, not {self.workers}.")
        check_given(self.prices)
        _ = self.caps

    @property
    def caps(self) -> Caps:
        """The caps of the whole run."""
        return Caps(self.run_tokens, self.run_cost)

    @classmethod
    def split(cls, given: Mapping[str, Any]) -> tuple[Self, dict[str, Any]]:
        """Return the options among keywords, and the other keywords, which are rules of the cells (`make_cells`)."""
        own = {field.name for field in fields(cls)}
        return (
            cls(**{name: value for name, value in given.items() if name in own}),
            {name: value for name, value in given.items() if name not in own},
        )


class RunKeywords(TypedDict, total=False):
    """The keywords of `evaluate` and `sweep`: the fields of `RunOptions`, and the rules of all cells."""

    executor: str | None
    workers: int | None
    run_tokens: int | None
    run_cost: float | None
    prices: Mapping[str, Price] | None
    on_progress: OnProgress | None

    engine: str | None
    tokenizer: str | None
    options: Mapping[str, Any] | None
    player_options: Mapping[str, Any] | None
    manual: ManualMode
    batch: BatchPolicy
    protocol: ProtocolName
    observation: ObservationForm
    budget_line: BudgetLine
    first_observation: FirstObservation
    offered_tools: OfferedTools
    carry: CarriedStore | None
    chain: int | None
    wording: str | None
