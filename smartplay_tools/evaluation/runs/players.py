"""The players of a run, each with its own options, server and limits.

The options of a player are recorded, so a credential cannot be an option: it is given as the name of an environment
variable, which is read where the player is created.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any
from urllib.parse import parse_qsl, urlsplit

from pydantic import BaseModel, ConfigDict, Field

from smartplay_tools.errors import InvalidArgumentError


class PlayerConfig(BaseModel):
    """A player of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    """A name that `get_player` knows, such as "rule" or "openai:MODEL"."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The player's options, such as `base_url`; they are recorded."""
    api_key_env: str | None = None
    """The environment variable that holds the player's key; not recorded."""
    concurrency: Annotated[int, Field(ge=1)] | None = None
    """The most episodes of this player at a time; None for no further limit than the run's."""
    price: tuple[float, float] | tuple[float, float, float] | None = None
    """US dollars per million tokens of prompts, replies and cached parts of prompts, if they are in no table."""

    @property
    def secrets(self) -> dict[str, str]:
        """Options whose values are in environment variables: option -> variable."""
        return {} if self.api_key_env is None else {"api_key": self.api_key_env}


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
            "OPENAI_API_KEY, for example, or the name of another variable as api_key_env in a run file."
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
    known = (held for name, held in os.environ.items() if SECRET_VARIABLES.search(name))
    return bool(SECRET_VALUES.search(value)) or any(len(held) >= SHORTEST_SECRET and held in value for held in known)


def _has_secret(url: str) -> bool:
    """Whether a URL contains a user's name and password, or a key among its parameters."""
    if "://" not in url:
        return False
    parts = urlsplit(url)
    return parts.password is not None or any(SECRET_NAMES.search(name) for name, _ in parse_qsl(parts.query))
