"""Cells and conditions: the groups of episodes over which statistics are computed.

A cell is what is repeated over trials: one game, one engine, one player, under one budget and one set of rules. A
condition is everything that is the same for a player in all games ("the paper's history, prompts of at most 4096
tokens"); its cells are listed together, and their capability scores are one player's profile.

Rows contain budgets in numbers, resolved for each game, so a condition has to be inferred: history 50 for the bandit
and 5 for Crafter are both "game", the paper's number. If the same run has a history of 5 for other games too, Crafter's
5 is that number; if the run has both, Crafter's cell belongs to both conditions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import Any

from smartplay_tools.context.tokens import DEFAULT_TOKENIZER
from smartplay_tools.episode.budgets import SMALLEST_AUTO_CAP, resolve
from smartplay_tools.episode.config import RULES, USUAL_RULES
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.games.specs import get_spec
from smartplay_tools.records.rows import Row
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import canonical_text

_COMMON = ("player", "player_options", "rules", "tokenizer")
WORDS = ("history", "tool_calls")
"""The fields of a budget for which "game" means a different number in every game."""

CAPS = tuple(name for name in Budget.model_fields if name not in (*WORDS, "result_tokens"))
"""The fields that are the same in every game."""

USUAL = {**USUAL_RULES, "tokenizer": DEFAULT_TOKENIZER}
"""The defaults of a condition, except its budget."""


@dataclass(frozen=True)
class PlayedCell:
    """What all episodes of a cell have in common: a planned cell as its rows describe it, the budget in numbers."""

    game: str
    engine: str | None
    player: str
    player_options: Mapping[str, Any]
    rules: Mapping[str, Any]
    """The fields of `Rules`."""
    budget: Mapping[str, Any]
    """Resolved, in numbers."""
    tokenizer: str
    options: Mapping[str, Any]

    @property
    def spec(self) -> GameSpec:
        """The setting."""
        return get_spec(self.game)


@dataclass(frozen=True)
class Condition:
    """What a player was given in every game of `cells`, of which there is one for each game."""

    player: str
    player_options: Mapping[str, Any]
    rules: Mapping[str, Any]
    tokenizer: str
    budget: Mapping[str, Any]
    """The budget as it may have been given, with "game" and "auto" instead of numbers."""
    variant: str
    """Engine and options, if some game was played with several; otherwise empty."""
    cells: tuple[PlayedCell, ...]

    @property
    def label(self) -> str:
        """What the player was given, in a few words; what is as by default is not mentioned."""
        given = {**self.rules, "tokenizer": self.tokenizer}
        unusual = [f"{name} {value}" for name, value in given.items() if value != USUAL[name]]
        return ", ".join(filter(None, [*unusual, Budget(**self.budget).describe(), self.variant]))

    def label_among(self, others: Iterable[Condition]) -> str:
        """Return the label, with the options in which the player differs from that of its name in other conditions."""
        rivals = (other.player_options for other in others if other.player == self.player)
        return ", ".join(filter(None, [self.label, *differing(self.player_options, rivals)]))


def in_words(options: Mapping[str, Any]) -> list[str]:
    """Return options as the command line takes them: KEY=VALUE, where a value that is not text is JSON."""
    values = ((name, options[name]) for name in sorted(options))
    return [f"{name}={value if isinstance(value, str) else canonical_text(value)}" for name, value in values]


def differing(options: Mapping[str, Any], others: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the options, in words, that are not the same in all of others."""
    rivals = list(map(in_words, others))
    return [words for words in in_words(options) if not all(words in rival for rival in rivals)]


def _facts(row: Row) -> dict[str, Any]:
    """The fields of the cell of a row."""
    return {
        **{name: row[name] for name in _COPIED},
        "budget": {**Budget.later, **row["budget"]},
        "rules": {name: row.get(name, USUAL[name]) for name in RULES},
    }


_COPIED = tuple(field.name for field in fields(PlayedCell) if field.name not in ("rules", "budget"))
"""The fields of a cell that are those of its rows."""

_WRITTEN = (*_COPIED, *RULES, "budget")
"""The fields of a row that say what its cell is."""


def by_cell(rows: Iterable[Row]) -> list[tuple[PlayedCell, list[Row]]]:
    """Group rows by cell; cells and rows keep the order of the rows."""
    groups: dict[bytes, tuple[PlayedCell, list[Row]]] = {}
    # The rows of each cell by its facts as they are written: most rows are written as the one before.
    alike: dict[str, list[Row]] = {}
    for row in rows:
        written = repr([row.get(name) for name in _WRITTEN])
        if written not in alike:
            facts = _facts(row)
            alike[written] = groups.setdefault(canonical_json(facts), (PlayedCell(**facts), []))[1]
        alike[written].append(row)
    return list(groups.values())


def conditions(cells: Sequence[PlayedCell]) -> list[Condition]:
    """Group cells by condition, in the order in which conditions first appear."""
    asked = {word: _AskedField(word, cells) for word in WORDS}
    groups: dict[bytes, tuple[dict[str, Any], list[PlayedCell]]] = {}
    for cell in cells:
        for values in product(*(asked[word].readings(cell) for word in WORDS)):
            budget = {**dict(zip(WORDS, values, strict=True)), **_caps(cell.budget)}
            common = {name: getattr(cell, name) for name in _COMMON} | {"budget": budget}
            groups.setdefault(canonical_json(common), (common, []))[1].append(cell)
    return [
        Condition(**common, variant=variant, cells=members)
        for common, mixed in groups.values()
        for variant, members in _variants(mixed)
    ]


def labels(cells: Sequence[PlayedCell]) -> list[str]:
    """Return the label of the condition of each cell, among these; empty for the default."""
    among = conditions(cells)
    return [next(condition.label_among(among) for condition in among if cell in condition.cells) for cell in cells]


class _AskedField:
    """What a run may have asked for in a field of the budget, inferred from the numbers of all its cells."""

    def __init__(self, field: str, cells: Sequence[PlayedCell]) -> None:
        self._field = field
        self._numbers = {self._value(cell) for cell in cells if self._value(cell) != self._of_game(cell)}
        self._word = any(self._value(cell) not in self._numbers for cell in cells)

    def readings(self, cell: PlayedCell) -> list[Any]:
        """The number, if it was given for any game; "game", if it is the paper's and the run used the word."""
        value = self._value(cell)
        number = [value] if value in self._numbers else []
        return [*number, *(["game"] if self._word and value == self._of_game(cell) else [])]

    def _value(self, cell: PlayedCell) -> Any:
        return cell.budget[self._field]

    def _of_game(self, cell: PlayedCell) -> Any:
        return getattr(resolve(Budget(), cell.spec, 0), self._field)


def _caps(budget: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that are the same in every game; the cap on results is "auto" if it may have been."""
    results, prompts = budget["result_tokens"], budget["prompt_tokens"]
    # "auto" gives the manual a cap of its own, unless both are the smallest; without a cap on prompts it gives none.
    auto = results != budget["manual_tokens"] or results == (None if prompts is None else SMALLEST_AUTO_CAP)
    return {**{name: budget[name] for name in CAPS}, "result_tokens": "auto" if auto else results}


def _variants(cells: Sequence[PlayedCell]) -> list[tuple[str, tuple[PlayedCell, ...]]]:
    """Split cells by engine and options if a game was played with several, so that no game is in a group twice."""
    games = Counter(cell.game for cell in cells)
    kinds = dict.fromkeys(_variant(cell) for cell in cells if games[cell.game] > 1)
    if not kinds:
        return [("", tuple(cells))]
    return [(kind, tuple(c for c in cells if games[c.game] == 1 or _variant(c) == kind)) for kind in kinds]


def _variant(cell: PlayedCell) -> str:
    engine = [] if cell.engine is None else [f"engine {cell.engine}"]
    return ", ".join([*engine, *(f"{name}={value}" for name, value in sorted(cell.options.items()))]) or "no options"
