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
from statistics import fmean
from types import MappingProxyType
from typing import Any

from smartplay_tools.evaluation.analysis.intervals import MeanEstimate, mean_estimates, weighted_estimates
from smartplay_tools.evaluation.analysis.pairs import normalized_score, sample, score, tokens
from smartplay_tools.evaluation.board.submissions.check import Checked
from smartplay_tools.evaluation.board.submissions.metadata import Submission
from smartplay_tools.evaluation.board.submissions.submitted_plan import by_cell, normalized_scores, total_cost
from smartplay_tools.evaluation.costs.tariffs import Charged
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
    """The bill: US dollars for all episodes; None where it is not known."""
    modelled: float | None
    """US dollars for all episodes under the rule of their model's cache; None where that is not known."""
    costs: tuple[float, ...]
    """What an episode costs under each rule of the board, in uncached tokens; empty where records have no prompts."""
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
        return Budget.from_record(self.asked).describe() or "default budget"


@dataclass(frozen=True)
class Board:
    """A leaderboard."""

    classes: tuple[BudgetClass, ...]
    refused: tuple[tuple[str, Checked], ...]
    """Submissions that are not verified, each with the folder of its report."""
    checked: tuple[tuple[str, Checked], ...]
    """All submissions."""
    rules: tuple[str, ...] = ()
    """The rules of caches under which the board says what an episode costs."""


Games = dict[str, list[Row]]
"""The rows of a submission under one budget, by game."""

Charges = Mapping[str, Charged | None]
"""What the episodes of a submission cost, by key; None for one whose record has no prompts or no usage."""


def make_board(
    checked: Sequence[tuple[str, Checked]],
    *,
    charged: Mapping[str, Charges] = MappingProxyType({}),
    rules: Sequence[str] = (),
) -> Board:
    """Return the board of checked submissions, each given with the folder of its files.

    `charged` has by the same folder what their episodes cost under the named rules.
    """
    groups: dict[tuple[str, str], dict[str, Games]] = {}
    for place, submitted in checked:
        if submitted.verified and submitted.submission is not None:
            for (game, asked), rows in by_cell(submitted.rows).items():
                group = groups.setdefault((submitted.submission.suite or "", asked), {})
                group.setdefault(place, {})[game] = rows
    ordered = sorted(groups.items(), key=lambda item: (item[0][0] == "", item[0][0], _size(item[0][1])))
    submissions = {place: (submitted, charged.get(place, {})) for place, submitted in checked}
    classes = [_budget_class(suite or None, json.loads(asked), group, submissions) for (suite, asked), group in ordered]
    refused = tuple((place, submitted) for place, submitted in checked if not submitted.verified)
    return Board(tuple(classes), refused, tuple(checked), tuple(rules))


def _size(asked: str) -> tuple[float, str]:
    return json.loads(asked).get("prompt_tokens") or math.inf, asked


def _budget_class(
    suite: str | None,
    asked: Mapping[str, Any],
    group: Mapping[str, Games],
    submissions: Mapping[str, tuple[Checked, Charges]],
) -> BudgetClass:
    names = list(dict.fromkeys(name for games in group.values() for name in games))
    common = [name for name in names if all(normalized_scores(games.get(name, ())) for games in group.values())]
    entries = [_entry(place, *submissions[place], games, common) for place, games in group.items()]
    entries.sort(key=lambda entry: (-math.inf if entry.mean is None else entry.mean.mean, entry.place), reverse=True)
    return BudgetClass(asked, suite, tuple(names), tuple(common), tuple(entries))


def _entry(place: str, checked: Checked, charges: Charges, games: Games, common: Sequence[str]) -> Entry:
    assert checked.submission is not None
    samples = [normalized_scores(games[name]) for name in common]
    mean = weighted_estimates(samples, [[1 / len(samples)] * len(samples)])[0] if samples else None
    rows = [row for members in games.values() for row in members]
    charged = [each for row in rows if (each := charges.get(row["key"])) is not None]
    own = [each.own.cost for each in charged if each.own is not None]
    return Entry(
        place=place,
        submission=checked.submission,
        issued=checked.issued is not None,
        mean=mean,
        games={name: _game_score(members) for name, members in games.items()},
        episodes=len(rows),
        tokens=fmean(map(tokens, rows)),
        cost=total_cost(rows),
        modelled=math.fsum(own) if len(own) == len(rows) else None,
        costs=tuple(fmean(charge.cost for charge in each) for each in zip(*(c.charges for c in charged), strict=True)),
        calls=fmean(row["tool_calls"] for row in rows),
        mistakes=fmean(row["illegal_actions"] + row["malformed_calls"] for row in rows),
    )


def _game_score(rows: Sequence[Row]) -> GameScore:
    whole = [sample(rows, normalized_score)] if normalized_scores(rows) else []
    raw, *rest = mean_estimates([sample(rows, score), *whole])
    return GameScore(raw, rest[0] if rest else None)
