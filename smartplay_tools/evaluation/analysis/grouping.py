"""Cells and conditions: the groups of episodes over which statistics are computed.

A cell is what is repeated over trials: one game, one engine, one player, under one budget and one set of rules. A
condition is everything that is the same for a player in all games ("the paper's history, prompts of at most 4096
tokens"); its cells are listed together, and their capability scores are one player's profile.

The budgets of cells are in numbers, which are resolved for each game. The budget of a condition is what was asked for:
history 50 for the bandit and 5 for Crafter are both "game", the paper's number. If a run has asked for Crafter's 5 in
both ways, its cell belongs to both conditions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from smartplay_tools.context.tokens import DEFAULT_TOKENIZER
from smartplay_tools.episode.config import RULES, USUAL_RULES
from smartplay_tools.games.game_registry import GameSpec
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row
from smartplay_tools.transcript.hashing import canonical_json
from smartplay_tools.types import Budget
from smartplay_tools.types.arguments import canonical_text
from smartplay_tools.types.groups import grouped

USUAL = {**USUAL_RULES, "tokenizer": DEFAULT_TOKENIZER}
"""The defaults of a condition, except its budget."""

_COPIED = ("game", "engine", "player", "player_options", "tokenizer", "options")
"""The fields of a cell that are those of its rows."""

_WRITTEN = (*_COPIED, *RULES, "game_sha256", "strategy_sha256", "budget", "asked")
"""The fields of a row that say what its cell is."""


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
    game_sha256: str | None = None
    """The sha256 of the file of the game; None if it is not in a file."""
    strategy_sha256: str | None = None
    """The sha256 of the file of the budget's strategy; None if it is not in a file."""
    asked: tuple[Budget, ...] = field(default=(), compare=False)
    """The budget as it was asked for, with "game" and "auto"; several if they are the same in numbers."""

    @classmethod
    def of(cls, row: Row) -> Self:
        """Return the cell of a row. A row that does not say what was asked for has asked for its numbers."""
        numbers = {**Budget.later, **row["budget"]}
        asked = row.get("asked", {name: value for name, value in numbers.items() if name in Budget.model_fields})
        return cls(
            **{name: row[name] for name in _COPIED},
            rules={name: row.get(name, USUAL[name]) for name in RULES},
            budget=numbers,
            game_sha256=row.get("game_sha256"),
            strategy_sha256=row.get("strategy_sha256"),
            asked=(Budget.from_record(asked),),
        )

    @property
    def spec(self) -> GameSpec | None:
        """The setting; None if it is not known here, as one in a file that this process has not imported."""
        return GAMES.get(self.game)

    def key(self, *, without: Collection[str] = ()) -> bytes:
        """Return what identifies the cell, without these fields of its budget: equal for equal cells."""
        budget = {name: value for name, value in self.budget.items() if name not in without}
        file = None if "strategy" in without else self.strategy_sha256
        return canonical_json([*(getattr(self, name) for name in _COPIED), self.rules, self.game_sha256, file, budget])


@dataclass(frozen=True)
class Condition:
    """What a player was given in every game of `cells`, of which there is one for each game."""

    player: str
    player_options: Mapping[str, Any]
    rules: Mapping[str, Any]
    tokenizer: str
    budget: Mapping[str, Any]
    """As it was asked for, with "game" and "auto" instead of numbers."""
    variant: str
    """Engine, files of game and strategy, and options, if some game was played with several; otherwise empty."""
    cells: tuple[PlayedCell, ...]

    @property
    def label(self) -> str:
        """What the player was given, in a few words; what is as by default is not mentioned."""
        given = {**self.rules, "tokenizer": self.tokenizer}
        unusual = [f"{name} {value}" for name, value in given.items() if value != USUAL[name]]
        return ", ".join(filter(None, [Budget(**self.budget).describe(), *unusual, self.variant]))

    def label_among(self, others: Iterable[Condition]) -> str:
        """Return the label, with the options in which the player differs from that of its name in other conditions.

        The path of a strategy follows where another one's file has the same name.
        """
        rivals = [other for other in others if other.player == self.player]
        given = differing(self.player_options, (rival.player_options for rival in rivals))
        own = self.budget.get("strategy")
        alike = (rival.budget.get("strategy") for rival in rivals if rival.label == self.label)
        path = [own] if own is not None and any(strategy != own for strategy in alike) else []
        return ", ".join(filter(None, [self.label, *path, *given]))


def by_cell(rows: Iterable[Row]) -> list[tuple[PlayedCell, list[Row]]]:
    """Group rows by cell; cells and rows keep the order of the rows."""
    # The cells and their keys by the facts as they are written: most rows are written as the one before.
    written: dict[str, tuple[bytes, PlayedCell]] = {}

    def key_of(row: Row) -> bytes:
        facts = repr([row.get(name) for name in _WRITTEN])
        if facts not in written:
            cell = PlayedCell.of(row)
            written[facts] = cell.key(), cell
        return written[facts][0]

    groups = grouped(rows, key_of)
    alike = grouped(written.values(), lambda pair: pair[0])
    return [(_merged([cell for _, cell in alike[key]]), members) for key, members in groups.items()]


def _merged(cells: Sequence[PlayedCell]) -> PlayedCell:
    """Equal cells as one, with all that was asked for."""
    return replace(cells[0], asked=tuple(dict.fromkeys(budget for cell in cells for budget in cell.asked)))


def conditions(cells: Iterable[PlayedCell]) -> list[Condition]:
    """Group cells by condition, in the order in which conditions first appear."""
    asked = [(budget, cell) for cell in cells for budget in cell.asked]
    groups = grouped(asked, lambda pair: canonical_json([*_common(pair[1]).values(), pair[0].model_dump()]))
    return [
        Condition(**_common(members[0][1]), budget=vars(members[0][0]), variant=variant, cells=variants)
        for members in groups.values()
        for variant, variants in _variants([cell for _, cell in members])
    ]


def label_in(among: Sequence[Condition], cell: PlayedCell) -> str:
    """Return the label of the first of these conditions that a cell belongs to; empty for the default."""
    return next((condition.label_among(among) for condition in among if cell in condition.cells), "")


def labels(cells: Sequence[PlayedCell]) -> list[str]:
    """Return the label of the condition of each cell, among these; empty for the default."""
    among = conditions(cells)
    return [label_in(among, cell) for cell in cells]


def in_words(options: Mapping[str, Any]) -> list[str]:
    """Return options as the command line takes them: KEY=VALUE, where a value that is not text is JSON."""
    values = ((name, options[name]) for name in sorted(options))
    return [f"{name}={value if isinstance(value, str) else canonical_text(value)}" for name, value in values]


def differing(options: Mapping[str, Any], others: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the options, in words, that are not the same in all of others."""
    rivals = list(map(in_words, others))
    return [words for words in in_words(options) if not all(words in rival for rival in rivals)]


def _common(cell: PlayedCell) -> dict[str, Any]:
    """The fields of a cell that its condition has too."""
    return {name: getattr(cell, name) for name in ("player", "player_options", "rules", "tokenizer")}


def _variants(cells: Sequence[PlayedCell]) -> list[tuple[str, tuple[PlayedCell, ...]]]:
    """Split cells by engine, file and options if a game was played with several, so no game is in a group twice."""
    games = Counter(cell.game for cell in cells)
    kinds = dict.fromkeys(_variant(cell) for cell in cells if games[cell.game] > 1)
    if not kinds:
        return [("", tuple(cells))]
    return [(kind, tuple(c for c in cells if games[c.game] == 1 or _variant(c) == kind)) for kind in kinds]


def _variant(cell: PlayedCell) -> str:
    engine = [] if cell.engine is None else [f"engine {cell.engine}"]
    file = [f"file {sha256[:8]}" for sha256 in (cell.game_sha256, cell.strategy_sha256) if sha256 is not None]
    options = (f"{name}={value}" for name, value in sorted(cell.options.items()))
    return ", ".join([*engine, *file, *options]) or "no options"
