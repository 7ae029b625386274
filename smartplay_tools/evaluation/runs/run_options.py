"""The options of a run: how its episodes are played, and where its caps are. None of them changes an episode.

`evaluate`, `sweep` and the commands have the same ones, each defined here. A run file has the arguments of `eval` as
TOML:

    games = ["Crafter-v0", "Hanoi3Disk-v0"]
    trials = 10
    run_cost = 20.0

    [[budgets]]
    history = 5

    [[players]]
    name = "openai:qwen3-32b"
    base_url = "http://gpu7:8000/v1"
    concurrency = 16
    price = [0.1, 0.3]

    [[players]]
    name = "rule"

A run file may also set the engine, the tokenizer, the games' options, and every rule (`Rules`), such as
`manual = "pinned"`.

A run file holds no credentials: a key is given by the name of the environment variable that holds it (`api_key_env`).
Its text is kept in the run's manifest.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Self, TypedDict

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from smartplay_tools.episode.config import (
    RULES,
    BatchPolicy,
    BudgetLine,
    FirstObservation,
    ManualMode,
    OfferedTools,
    ProtocolName,
    read_rules,
)
from smartplay_tools.errors import InvalidArgumentError, similar
from smartplay_tools.evaluation.runs.limits import Caps
from smartplay_tools.evaluation.runs.plan import PlannedEpisode
from smartplay_tools.evaluation.runs.players import PlayerConfig, check_no_credentials
from smartplay_tools.providers.prices import Price, check_given
from smartplay_tools.records.rows import Row
from smartplay_tools.types import Budget, CarriedStore, ObservationForm


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
    """How a run is played; the same run can be continued with other options, except for its shard."""

    executor: str | None = None
    """"inline", "processes", "async" or "ray"; if not given, the one that suits each player."""
    workers: int | None = None
    """Episodes at a time."""
    shard: tuple[int, int] | None = None
    """(i, n), to play the i-th of n parts only; `merge` puts them together."""
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
    shard: tuple[int, int] | None
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


class FilePlayer(PlayerConfig):
    """A player of a run file; `base_url` is a separate field, because it is used so often."""

    base_url: str | None = None

    def config(self) -> PlayerConfig:
        """Return the player with its server among its options."""
        facts = self.model_dump(exclude={"base_url"})
        server = {} if self.base_url is None else {"base_url": self.base_url}
        return PlayerConfig(**{**facts, "options": {**server, **self.options}})


class RunFile(BaseModel):
    """The contents of a run file; missing fields are taken from the command line."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    suite: str | None = None
    games: list[str] = Field(default_factory=list)
    players: list[str | FilePlayer] = Field(default_factory=list)
    budgets: list[Budget] = Field(default_factory=list)
    trials: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] | None = None
    out: Path | None = None
    workers: Annotated[int, Field(ge=1)] | None = None
    executor: str | None = None
    run_tokens: int | None = None
    run_cost: float | None = None
    engine: str | None = None
    tokenizer: str | None = None
    options: dict[str, Any] = Field(default_factory=dict)
    rules: dict[str, Any] = Field(default_factory=dict)
    """The rules that the file sets; in the file they are keys beside the others."""

    def configs(self) -> list[PlayerConfig]:
        """Return the players."""
        return [PlayerConfig(name=player) if isinstance(player, str) else player.config() for player in self.players]


def read_run_file(path: Path) -> tuple[RunFile, str]:
    """Return a run file and its text; an invalid file, or one with a credential, raises an `InvalidArgumentError`."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        values = tomllib.loads(text)
    except OSError as error:
        raise InvalidArgumentError(f"{path} cannot be read: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidArgumentError(f"{path} is not TOML: {error}.") from None
    check_no_credentials(str(path), values)
    # A comment is kept in the manifest as well.
    check_no_credentials(str(path), text.splitlines())
    try:
        rules = {name: values.pop(name) for name in RULES if name in values}
        read_rules(rules)
        return RunFile(**values, rules=rules), text
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{path}, {error}") from None
    except ValidationError as error:
        # A player may be a name or a table; of the errors for either, the deepest is the relevant one.
        first = max(error.errors(), key=lambda fault: len(fault["loc"]))
        where = ".".join(str(part) for part in first["loc"] if part not in ("str", "FilePlayer"))
        if first["type"] == "extra_forbidden":
            raise InvalidArgumentError(f"{path}, {where}: {_unknown_field(first['loc'])}") from None
        raise InvalidArgumentError(f"{path}, {where}: {first['msg']}.") from None


def _unknown_field(place: tuple[int | str, ...]) -> str:
    """Return a sentence about a field that does not exist, from its place in the file."""
    models: dict[str, Any] = {"players": FilePlayer, "budgets": Budget}
    model = models.get(str(place[0])) if len(place) > 1 else None
    fields = [*RunFile.model_fields, *RULES] if model is None else [*model.model_fields]
    return f"there is no such field; {similar(place[-1], (name for name in fields if name != 'rules'))}"
