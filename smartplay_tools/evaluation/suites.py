"""Suites: games that are evaluated together, by a short name.

The suite "paper" names the seven settings of the paper's result tables; budgets, protocol and trials are the user's.
The suite "tools-v1" is for agents that call tools, and fixes everything that a score depends on except the player:
games, trials, engines, texts, rules and budgets. Two complete runs of it can be compared without looking at their
options. A fixed suite never changes; another choice gets another name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from smartplay_tools.context.prompts.wording import VERSION
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.games.paper_tables import PAPER_SETTINGS
from smartplay_tools.types import Budget

PROMPT_CAPS: tuple[int | None, ...] = (2_000, 8_000, None)
"""The caps on prompts of the suite tools-v1, in budget tokens; None means no cap."""

MOST_CALLS = 500
"""The cap on tool calls of the suite tools-v1. It ends Crafter only, which could go on for 10,000 steps."""


@dataclass(frozen=True)
class Suite:
    """Games, and in a fixed suite everything else that its episodes have in common."""

    name: str
    trials: Mapping[str, int | None]
    """Game -> episodes of every cell; None is the paper's number, which the user may change."""
    budgets: tuple[Budget, ...] = ()
    """The budgets that every game is played under; empty where the user chooses them."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options of the games that have them, fixed where they would otherwise depend on the machine."""
    prompts: str = VERSION
    """The version of the prompts, which a fixed suite keeps."""

    @property
    def games(self) -> tuple[str, ...]:
        """The ids of its settings, in their order."""
        return tuple(self.trials)

    @property
    def is_fixed(self) -> bool:
        """Whether the suite leaves no choice but the player and the seed."""
        return bool(self.budgets)


def _tools_v1() -> Suite:
    trials = dict.fromkeys(PAPER_SETTINGS, 10) | {"Crafter-v0": 5, "MinedojoCreative0-v0": 5}
    budgets = tuple(
        Budget(history=None, prompt_tokens=cap, tool_calls=MOST_CALLS, stalled_turns=None) for cap in PROMPT_CAPS
    )
    return Suite("tools-v1", MappingProxyType(trials), budgets, {"sentences": "grammar"}, prompts="v2")


SUITES: Mapping[str, Suite] = {
    suite.name: suite for suite in (Suite("paper", MappingProxyType(dict.fromkeys(PAPER_SETTINGS))), _tools_v1())
}
"""The suites by name."""


def get_suite(name: str) -> Suite:
    """Return a suite by name; an unknown one is an `InvalidArgumentError`."""
    if name not in SUITES:
        raise InvalidArgumentError(f"There is no suite {name!r}; the suites are {', '.join(SUITES)}.")
    return SUITES[name]


def suite_games(suite: str | None, games: Sequence[str]) -> list[str]:
    """Return the games of a suite and then those that are named; there has to be one."""
    if isinstance(games, str):
        raise InvalidArgumentError(f"The games of a run are a list of ids; write [{games!r}].")
    names = [*(() if suite is None else get_suite(suite).games), *games]
    if not names:
        raise InvalidArgumentError(f"Name games, or a suite ({', '.join(SUITES)}).")
    return names
