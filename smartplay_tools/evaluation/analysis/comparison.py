"""The comparison of runs or sweeps with each other, episode by episode.

A **side** is a player under one condition in one run. Episodes of two sides with the same game, seed and trial are a
pair; they play the same world, so differences between worlds cancel out (`pairs`). Each side is compared with its
counterpart in the first run: the side of the same player under the same condition (another version), or else the only
one under the same condition (another player), or else the only one of the same player (another budget), or else the
only side of that run. Within the first run, a side is compared with the widest window of its player, as in the table of
a sweep, and that one with the first player's. If none of these exists, sides are compared with the first run's first
side. `reference` names a player to compare with instead.

Wins, ties and losses count pairs by score. Differences have 95 % intervals, each by itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.beside import ends_of
from smartplay_tools.evaluation.analysis.decisions import Margin, Verdict, decide
from smartplay_tools.evaluation.analysis.grouping import by_cell, conditions
from smartplay_tools.evaluation.analysis.pairs import (
    MEASURES,
    are_identical,
    difference_samples,
    pairs,
    samples,
    score,
)
from smartplay_tools.evaluation.analysis.windows import width
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate, named_estimates, with_ends

__all__ = ["Comparison", "Pairing", "Side", "compare"]


@dataclass(frozen=True)
class Side:
    """A player under one condition in one run."""

    run: str
    player: str
    label: str
    """A short description of the condition; empty for the default."""
    width: tuple[float, ...] = field(default=(), compare=False, repr=False)
    """How wide its window is, in the first of its games (`windows.width`)."""


@dataclass(frozen=True)
class Pairing:
    """The comparison of one side with its reference in one game; differences are this side less the reference."""

    game: str
    side: Side
    reference: Side
    pairs: int
    unpaired: int
    """Episodes of either side without a counterpart, which are not compared."""
    means: Mapping[str, MeanEstimate]
    """Of this side, over all of its episodes, by the names of `pairs.MEASURES`."""
    differences: Mapping[str, MeanEstimate]
    """Over the pairs; measures that no pair has are missing."""
    wins: int
    """Pairs in which this side scored more."""
    ties: int
    losses: int
    is_identical: bool
    """Whether every prompt and reply is equal on both sides."""
    ends: Mapping[str, int] = field(default_factory=dict)
    """How many of this side's episodes ended before their game did, by the reason."""
    reference_ends: Mapping[str, int] = field(default_factory=dict)
    """The same of the reference."""
    verdict: Verdict | None = None
    """What the pairs show within a margin, if there is one."""


@dataclass(frozen=True)
class Comparison:
    """The result of comparing several runs."""

    runs: tuple[str, ...]
    references: tuple[tuple[str, Side, Mapping[str, MeanEstimate]], ...]
    """Game, side and means of every reference."""
    pairings: tuple[Pairing, ...]
    """Game by game, in the order of the runs."""
    versions: Mapping[str, Mapping[str, str]]
    """Differing versions of programs: name -> run -> version, or several versions separated by commas."""
    uncompared: int = 0
    """Episodes of games, and of sides, that are in no pairing."""

    @property
    def is_judged(self) -> bool:
        """Whether there is a margin, and a pairing with pairs that it judges."""
        return any(each.verdict for each in self.pairings)


def compare(
    runs: Mapping[str, Sequence[Row]],
    *,
    reference: str | None = None,
    margin: Margin | None = None,
) -> Comparison:
    """Compare runs, given as name -> rows, with the first of them.

    `reference` is the name of a player of the first run with which everything is compared. With a margin, every pairing
    has a verdict.
    """
    sides = _sides(runs)
    if reference is not None and not any(side.player == reference for side in sides if side.run == next(iter(runs))):
        players = dict.fromkeys(side.player for side in sides if side.run == next(iter(runs)))
        raise InvalidArgumentError(f"{next(iter(runs))} has no player {reference!r}; it has {', '.join(players)}.")
    counterparts = {side: _counterpart(side, [*sides], reference, next(iter(runs))) for side in sides}
    matches = [
        (game, side, counterpart)
        for game in dict.fromkeys(game for games in sides.values() for game in games)
        for side, counterpart in counterparts.items()
        if counterpart is not None and game in sides[side] and game in sides[counterpart]
    ]
    if not matches:
        raise InvalidArgumentError("There is nothing to compare: no two players or runs have a game in common.")
    pairings = tuple(_pairing(sides, match, margin) for match in matches)
    used = dict.fromkeys((game, reference) for game, _, reference in matches)
    return Comparison(
        runs=tuple(runs),
        references=tuple((game, side, named_estimates(samples(sides[side][game]))) for game, side in used),
        pairings=pairings,
        versions=_versions(runs),
        uncompared=_uncompared(sides, matches),
    )


Sides = Mapping[Side, Mapping[str, Sequence[Row]]]
"""The rows of every side by game."""


def _sides(runs: Mapping[str, Sequence[Row]]) -> dict[Side, dict[str, list[Row]]]:
    """The sides of all runs. Conditions are determined over all runs, so that they mean the same in each."""
    finished = {run: [row for row in rows if row["end_reason"] != "run_budget"] for run, rows in runs.items()}
    all_conditions = conditions(cell for cell, _ in by_cell(chain.from_iterable(finished.values())))
    sides: dict[Side, dict[str, list[Row]]] = {}
    for run, rows in finished.items():
        groups = by_cell(rows)
        for condition in all_conditions:
            played = {cell.game: members for cell, members in groups if cell in condition.cells}
            if played:
                label = condition.label_among(all_conditions)
                side = Side(run, condition.player, label, width(condition.cells[0].budget))
                sides.setdefault(side, {}).update(played)
    return sides


def _counterpart(side: Side, sides: Sequence[Side], reference: str | None, first_run: str) -> Side | None:
    """The side, among these, that a side is compared with; None for a reference, or without one in the first run."""
    first = [other for other in sides if other.run == first_run]
    if not first:
        return None
    if reference is not None:
        first = [other for other in first if other.player == reference]
        if side in first or not first:
            return None
    elif side.run == first_run:
        # The first run is compared with itself if there is no other.
        alone = all(other.run == side.run for other in sides)
        nearest = (other for other in (_widest(side, first), _widest(first[0], first)) if other != side)
        return next(nearest, None) if alone else None
    same_condition = [other for other in first if other.label == side.label]
    candidates = (
        [other for other in same_condition if other.player == side.player],
        same_condition,
        [other for other in first if other.player == side.player],
    )
    return next((alike[0] for alike in candidates if len(alike) == 1), first[0])


def _widest(side: Side, sides: Sequence[Side]) -> Side:
    """The side of the same player with the widest window; the first, where several are as wide."""
    return max((other for other in sides if other.player == side.player), key=lambda other: other.width)


def _pairing(sides: Sides, match: tuple[str, Side, Side], margin: Margin | None) -> Pairing:
    game, side, other = match
    rows, counterparts = sides[side][game], sides[other][game]
    own = pairs(rows, counterparts)
    drawn, is_identical = difference_samples(own), are_identical(own)
    signs = Counter(_sign(score(row) - score(counterpart)) for row, counterpart in own)
    difference, verdict = named_estimates(drawn), None
    if margin is not None and own:
        verdict = decide(drawn["score"], margin.points(game), difference["score"])
        verdict = replace(verdict, word="identical", mde=None) if is_identical else verdict
    return Pairing(
        game,
        side,
        other,
        pairs=len(own),
        unpaired=len(rows) + len(counterparts) - 2 * len(own),
        means=named_estimates(samples(rows)),
        differences=difference,
        wins=signs[1],
        ties=signs[0],
        losses=signs[-1],
        is_identical=is_identical,
        ends=ends_of(rows),
        reference_ends=ends_of(counterparts),
        verdict=verdict,
    )


def _uncompared(sides: Sides, matches: Sequence[tuple[str, Side, Side]]) -> int:
    """How many episodes are in no match. A cell can be of several sides, since conditions may overlap."""
    compared = {(game, side) for game, *both in matches for side in both}
    keys = {
        (game, side): {(side.run, game, row["key"]) for row in rows}
        for side, games in sides.items()
        for game, rows in games.items()
    }
    return len(set().union(*keys.values()) - set().union(*(keys[place] for place in compared)))


def _sign(difference: float) -> int:
    return (difference > 0) - (difference < 0)


def _versions(runs: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, str]]:
    played: dict[str, dict[str, set[str]]] = {}
    for run, rows in runs.items():
        for row in rows:
            for name, version in {"prompts": row["prompts"], **row["versions"]}.items():
                played.setdefault(name, {}).setdefault(run, set()).add(str(version))
    texts = {
        name: {run: ", ".join(sorted(versions)) for run, versions in by_run.items()} for name, by_run in played.items()
    }
    return {name: by_run for name, by_run in texts.items() if len(set(by_run.values())) > 1}


def as_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return a flat row for every pairing: sides, number of pairs, means, differences with their intervals."""
    rows = []
    means = {(game, side): estimates for game, side, estimates in comparison.references}
    for each in comparison.pairings:
        row: dict[str, Any] = {"game": each.game}
        for name, side in (("", each.side), ("reference_", each.reference)):
            row |= {f"{name}run": side.run, f"{name}player": side.player, f"{name}label": side.label}
        row |= {name: getattr(each, name) for name in ("pairs", "unpaired", "wins", "ties", "losses")}
        for measure in MEASURES:
            own, other = each.means.get(measure), means[each.game, each.reference].get(measure)
            row |= {measure: own and own.mean, f"reference_{measure}": other and other.mean}
            row |= with_ends(f"{measure}_difference", each.differences.get(measure))
        row |= {"identical": each.is_identical, "ended_early": sum(each.ends.values())}
        row |= {"reference_ended_early": sum(each.reference_ends.values())}
        if comparison.is_judged:
            names = {"verdict": "word", "margin": "margin", "mde": "mde"}
            row |= {name: each.verdict and getattr(each.verdict, own) for name, own in names.items()}
        rows.append(row)
    return rows
