"""The players of a run, each with its own options, server and limits.

The options of a player are recorded, so a credential cannot be an option: it is given as the name of an environment
variable, which is read where the player is created.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias
from urllib.parse import parse_qsl, urlsplit

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.errors import InvalidArgumentError, name_of
from smartplay_tools.evaluation.runs.agents import Agent, AgentFunction, FunctionAgent, is_agent
from smartplay_tools.players.player_registry import takes_seed
from smartplay_tools.registry import is_in_file, read_file
from smartplay_tools.types import AsyncPlayer, Player

PlayerFactory: TypeAlias = Callable[..., Player | AsyncPlayer]
"""Makes a player from `seed`, the seed of its random draws, and the player's options, all keyword arguments. Worker
processes import it by name, so it must be importable there."""


class PlayerConfig(BaseModel):
    """A player of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    name: str
    """A name that `get_player` knows, such as "rule" or "openai:MODEL", or the name of what `factory` makes."""
    factory: PlayerFactory | None = None
    """Makes the player in place of `get_player`; not recorded."""
    agent: Agent | None = None
    """Plays the episodes in place of the package's own loop; not recorded."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The player's options, such as `base_url`; they are recorded."""
    api_key_env: str | None = None
    """The environment variable that holds the player's key; not recorded."""
    concurrency: Annotated[int, Field(ge=1)] | None = None
    """The most episodes of this player at a time; None for no further limit than the run's."""

    if not TYPE_CHECKING:  # type checkers know the fields

        def __init__(self, *unnamed: Any, **fields: Any) -> None:
            if unnamed:
                raise InvalidArgumentError('Name the fields of a PlayerConfig, as in PlayerConfig(name="rule").')
            super().__init__(**fields)

    def secret_values(self) -> dict[str, str]:
        """Return the options whose values are in environment variables."""
        if self.api_key_env is None:
            return {}
        if not os.environ.get(self.api_key_env):
            raise InvalidArgumentError(
                f"The api_key of {self.name} is taken from the variable {self.api_key_env}, which is not set."
            )
        return {"api_key": os.environ[self.api_key_env]}


Players: TypeAlias = Sequence[str | PlayerConfig] | Mapping[str, PlayerFactory | AgentFunction]
"""The players of a run: names, configs, or names with functions that make the players, or with agents."""


def read_players(players: Players) -> list[PlayerConfig]:
    """Return the players of a run as configs."""
    if isinstance(players, Mapping):
        return [_config_of(name, function) for name, function in players.items()]
    if isinstance(players, str):
        raise InvalidArgumentError(f"The players of a run are a list of names; write [{players!r}].")
    return [player if isinstance(player, PlayerConfig) else player_named(player) for player in players]


def _config_of(name: str, function: PlayerFactory | AgentFunction) -> PlayerConfig:
    if is_agent(function):
        return PlayerConfig(name=name, agent=FunctionAgent(function))
    if not isinstance(function, type) and not takes_seed(function):
        raise InvalidArgumentError(
            f"The function of {name!r} takes no `seed`, as one that makes a player does; the only argument of an agent "
            "is `session` or `episode`."
        )
    return PlayerConfig(name=name, factory=function)


def player_named(name: str) -> PlayerConfig:
    """Return a player by its name, which may be that of an agent: `FILE.py:FUNCTION`."""
    if not isinstance(name, str):
        raise InvalidArgumentError(
            f"{name_of(name)} is not the name of a player; a run takes classes and functions with a name for each: "
            f'{{"p": {name_of(name)}}}.'
        )
    if is_in_file(name):
        function = read_file(name).value
        if is_agent(function):
            return PlayerConfig(name=name, agent=FunctionAgent(function))
    return PlayerConfig(name=name)


def check_prices(priced: Iterable[str], players: Iterable[str]) -> None:
    """Raise an `InvalidArgumentError` if a price is that of no player of the run."""
    names = dict.fromkeys(players)
    if others := ", ".join(name for name in priced if name not in names):
        raise InvalidArgumentError(
            f"The run has no player {others} that could have a price; it has {', '.join(names)}."
        )


SECRET_NAMES = re.compile(
    r"(api|access|auth|bearer|secret|private|refresh)[-_]?(key|token)|^(x-)?(key|token)$|authorization|cookie|passw|secret",
    re.IGNORECASE,
)
"""Names of options, headers and parameters that hold a credential."""

SECRET_VARIABLES = re.compile(r"(key|token|secret|password|passwd|credentials?)$", re.IGNORECASE)
"""Names of environment variables that hold a credential."""

SECRET_VALUES = re.compile(
    r"\b(sk|pk|rk|hf|gsk|xai|ghp|AIza)[-_]?[A-Za-z0-9_-]{16,}|^\s*(bearer|basic)\s+\S+", re.IGNORECASE
)
"""Patterns of well-known credentials."""

SHORTEST_SECRET = 8
"""The least length at which the value of an environment variable is recognised as a credential."""


def check_no_credentials(name: str, value: Any) -> None:
    """Raise an `InvalidArgumentError` if options, headers or URLs contain a credential, which would be recorded."""
    for where in _credentials(name, value):
        raise InvalidArgumentError(
            f"{where} looks like a credential, and its value would be recorded; give it in the environment: "
            "OPENAI_API_KEY, for example, or the name of another variable as api_key_env of a PlayerConfig."
        )


def _credentials(where: str, value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            if SECRET_NAMES.search(str(name)) and part and not str(name).endswith("_env"):
                yield f"{where}.{name}"
            yield from _credentials(f"{where}.{name}", part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _credentials(where, part)
    elif isinstance(value, str) and (_is_secret(value) or _has_secret(value)):
        yield where


def _is_secret(value: str) -> bool:
    secrets = (held for name, held in os.environ.items() if SECRET_VARIABLES.search(name))
    return bool(SECRET_VALUES.search(value)) or any(len(held) >= SHORTEST_SECRET and held in value for held in secrets)


def _has_secret(url: str) -> bool:
    """Whether a URL contains a user's name and password, or a key among its parameters."""
    if "://" not in url:
        return False
    parts = urlsplit(url)
    return parts.password is not None or any(SECRET_NAMES.search(name) for name, _ in parse_qsl(parts.query))
