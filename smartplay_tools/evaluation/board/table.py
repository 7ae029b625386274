"""The table of a board: submissions under each budget, the highest mean first.

A budget class is what was asked for in the budget, so nothing that was played under different caps is ranked together.
Within a class the mean is over the games that all of its submissions played and that have a normalised score, each game
counting alike; its interval draws episodes again within each game.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.evaluation.analysis.intervals import MeanEstimate, mean_estimates, weighted_estimates
from smartplay_tools.evaluation.board.submissions.check import Checked
from smartplay_tools.evaluation.board.submissions.metadata import Submission
from smartplay_tools.records.rows import Row
from smartplay_tools.types import Budget


@dataclass(frozen=True)
class GameScore:
    """The score of one game."""

    score: MeanEstimate
    normalized: MeanEstimate | None


@dataclass(frozen=True)
class Entry:
    """A submission under one budget."""

    place: str
    """The folder of its files in the site."""
    submission: Submission
    issued: bool
    """Whether the board issued the seed of its run."""
    mean: MeanEstimate | None
    """The mean of the normalised scores; None where no game has one."""
    games: Mapping[str, GameScore]
    episodes: int
    tokens: float
    """Budget tokens of an episode, prompts and replies, on average."""
    cost: float | None
    """US dollars for all episodes; None where it is not known."""
    calls: float
    mistakes: float
    """Illegal actions and malformed calls of an episode, on average."""


@dataclass(frozen=True)
class BudgetClass:
    """All submissions under one budget."""

    asked: Mapping[str, Any]
    suite: str | None
    games: tuple[str, ...]
    ranked_games: tuple[str, ...]
    """The games in the mean."""
    entries: tuple[Entry, ...]

    @property
    def name(self) -> str:
        """The budget in words."""
        return Budget(**self.asked).describe() or "default budget"


@dataclass(frozen=True)
class Board:
    """A leaderboard."""

    classes: tuple[BudgetClass, ...]
    refused: tuple[tuple[str, Checked], ...]
    """Submissions that are not verified, each with the folder of its report."""
    checked: tuple[tuple[str, Checked], ...]
    """All submissions."""


def make_board(checked: Sequence[tuple[str, Checked]]) -> Board:
    """Return the board of checked submissions, each given with the folder of its files."""
    groups: dict[tuple[str, str], list[tuple[str, Checked, list[Row]]]] = {}
    for place, one in checked:
        if one.verified and one.submission is not None:
            for asked, rows in _by_budget(one.rows).items():
                groups.setdefault((one.submission.suite or "", asked), []).append((place, one, rows))
    ordered = sorted(groups.items(), key=lambda item: (item[0][0] == "", item[0][0], _size(item[0][1])))
    classes = [_budget_class(suite or None, json.loads(asked), members) for (suite, asked), members in ordered]
    refused = tuple((place, one) for place, one in checked if not one.verified)
    return Board(tuple(classes), refused, tuple(checked))


def _by_budget(rows: Sequence[Row]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(json.dumps(row["asked"], sort_keys=True), []).append(row)
    return found


def _size(asked: str) -> tuple[float, str]:
    return json.loads(asked).get("prompt_tokens") or math.inf, asked


def _budget_class(
    suite: str | None, asked: Mapping[str, Any], members: Sequence[tuple[str, Checked, list[Row]]]
) -> BudgetClass:
    games = list(dict.fromkeys(row["game"] for _, _, rows in members for row in rows))
    common = [game for game in games if all(_normalized(rows, game) for _, _, rows in members)]
    entries = [_entry(place, one, rows, common) for place, one, rows in members]
    entries.sort(key=lambda entry: (-math.inf if entry.mean is None else entry.mean.mean, entry.place), reverse=True)
    return BudgetClass(asked, suite, tuple(games), tuple(common), tuple(entries))


def _normalized(rows: Sequence[Row], game: str) -> list[float]:
    values = [row["normalized_score"] for row in rows if row["game"] == game]
    return [] if None in values else values


def _entry(place: str, one: Checked, rows: Sequence[Row], common: Sequence[str]) -> Entry:
    assert one.submission is not None
    by_game: dict[str, list[Row]] = {}
    for row in rows:
        by_game.setdefault(row["game"], []).append(row)
    samples = [_normalized(rows, game) for game in common]
    mean = weighted_estimates(samples, [[1 / len(samples)] * len(samples)])[0] if samples else None
    costs = [row["cost"] for row in rows]
    return Entry(
        place=place,
        submission=one.submission,
        issued=one.issued is not None,
        mean=mean,
        games={game: _game_score(members) for game, members in by_game.items()},
        episodes=len(rows),
        tokens=_mean([row["tokens"]["prompt"] + row["tokens"]["reply"] for row in rows]),
        cost=None if None in costs else math.fsum(costs),
        calls=_mean([row["tool_calls"] for row in rows]),
        mistakes=_mean([row["illegal_actions"] + row["malformed_calls"] for row in rows]),
    )


def _game_score(rows: Sequence[Row]) -> GameScore:
    normalized = [row["normalized_score"] for row in rows]
    samples = [[row["score"] for row in rows], *([] if None in normalized else [normalized])]
    score, *rest = mean_estimates(samples)
    return GameScore(score, rest[0] if rest else None)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
