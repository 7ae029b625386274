"""The comparison of runs or sweeps with each other, episode by episode.

A **side** is a player under one condition in one run. Episodes of two sides with the same game, seed and trial are a
pair; they play the same world, so differences between worlds cancel out (`pairs`). Each side is compared with its
counterpart in the first run: the side of the same player under the same condition (another version), or else the only
one under the same condition (another player), or else the only one of the same player (another budget), or else the
only side of that run. Within the first run, and if none of these exists, sides are compared with the first run's first
side. `reference` names a player to compare with instead.

Wins, ties and losses count pairs by score. Differences have 95 % intervals, each by itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.grouping import Condition, PlayedCell, by_cell, conditions
from smartplay_tools.evaluation.analysis.intervals import MeanEstimate, named_estimates, weighted_estimates
from smartplay_tools.evaluation.analysis.pairs import MEASURES, normalized_score, score, values
from smartplay_tools.records.rows import Row

PairKey = tuple[int, int]
"""Seed and trial; the game is the same on both sides."""


@dataclass(frozen=True)
class Side:
    """A player under one condition in one run."""

    run: str
    player: str
    label: str
    """A short description of the condition; empty for the default."""


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


@dataclass(frozen=True)
class Overall:
    """The comparison of one side with its reference over all games."""

    side: Side
    reference: Side
    games: tuple[str, ...]
    """The games that have pairs with a normalised score."""
    difference: MeanEstimate | None
    """Of normalised scores: the mean over `games` of the mean over pairs. None if there is no such game."""
    wins: int
    ties: int
    losses: int


@dataclass(frozen=True)
class Comparison:
    """The result of comparing several runs."""

    runs: tuple[str, ...]
    references: tuple[tuple[str, Side, Mapping[str, MeanEstimate]], ...]
    """Game, side and means of every reference."""
    pairings: tuple[Pairing, ...]
    """Game by game, in the order of the runs."""
    overall: tuple[Overall, ...]
    versions: Mapping[str, Mapping[str, str]]
    """Differing versions of programs: name -> run -> version, or several versions separated by commas."""


def compare(runs: Mapping[str, Sequence[Row]], *, reference: str | None = None) -> Comparison:
    """Compare runs, given as name -> rows, with the first of them.

    `reference` is the name of a player of the first run with which everything is compared.
    """
    sides = _sides(runs)
    if reference is not None and not any(side.player == reference for side in sides if side.run == next(iter(runs))):
        known = dict.fromkeys(side.player for side in sides if side.run == next(iter(runs)))
        raise InvalidArgumentError(f"{next(iter(runs))} has no player {reference!r}; it has {', '.join(known)}.")
    counterparts = {side: _counterpart(side, list(sides), reference) for side in sides}
    matches = [
        (game, side, counterpart)
        for game in dict.fromkeys(game for games in sides.values() for game in games)
        for side, counterpart in counterparts.items()
        if counterpart is not None and game in sides[side] and game in sides[counterpart]
    ]
    if not matches:
        raise InvalidArgumentError("There is nothing to compare: no two players or runs have a game in common.")
    pairings = _pairings(sides, matches)
    return Comparison(
        runs=tuple(runs),
        references=tuple(_references(sides, matches)),
        pairings=pairings,
        overall=tuple(_overall(sides, pairings)),
        versions=_versions(runs),
    )


Sides = Mapping[Side, Mapping[str, Sequence[Row]]]
"""The rows of every side by game."""


def _sides(runs: Mapping[str, Sequence[Row]]) -> dict[Side, dict[str, list[Row]]]:
    """The sides of all runs. Conditions are determined over all runs, so that they mean the same in each."""
    groups = {run: by_cell(row for row in rows if row["end_reason"] != "run_budget") for run, rows in runs.items()}
    cells: list[PlayedCell] = []
    for members in groups.values():
        cells += [cell for cell, _ in members if cell not in cells]
    sides: dict[Side, dict[str, list[Row]]] = {}
    known = conditions(cells)
    for run, members in groups.items():
        for condition in known:
            played = {cell.game: rows for cell, rows in members if cell in condition.cells}
            if played:
                sides.setdefault(_side(run, condition), {}).update(played)
    return sides


def _side(run: str, condition: Condition) -> Side:
    options = [f"{name}={value}" for name, value in sorted(condition.player_options.items())]
    return Side(run, condition.player, ", ".join(filter(None, [condition.label, *options])))


def _counterpart(side: Side, sides: Sequence[Side], reference: str | None) -> Side | None:
    """The side that a side is compared with; None for a reference."""
    first = [other for other in sides if other.run == sides[0].run]
    if reference is not None:
        first = [other for other in first if other.player == reference]
        if side in first:
            return None
    elif side.run == sides[0].run:
        # The first run is compared with itself if there is no other.
        alone = all(other.run == side.run for other in sides)
        return first[0] if alone and side != first[0] else None
    same_condition = [other for other in first if other.label == side.label]
    candidates = (
        [other for other in same_condition if other.player == side.player],
        same_condition,
        [other for other in first if other.player == side.player],
    )
    return next((found[0] for found in candidates if len(found) == 1), first[0])


def _keyed(rows: Sequence[Row]) -> dict[PairKey, Row]:
    return {(row["seed"], row["trial"]): row for row in rows}


def _pairs(rows: Sequence[Row], others: Sequence[Row]) -> list[tuple[Row, Row]]:
    counterparts = _keyed(others)
    return [(row, counterparts[key]) for key, row in _keyed(rows).items() if key in counterparts]


def _pairings(sides: Sides, matches: Sequence[tuple[str, Side, Side]]) -> tuple[Pairing, ...]:
    paired = [_pairs(sides[side][game], sides[other][game]) for game, side, other in matches]
    means = named_estimates(_measured(sides[side][game]) for game, side, _ in matches)
    differences = named_estimates(map(_differences, paired))
    found = []
    for (game, side, other), pairs, mean, difference in zip(matches, paired, means, differences, strict=True):
        signs = Counter(_sign(score(row) - score(counterpart)) for row, counterpart in pairs)
        unpaired = len(sides[side][game]) + len(sides[other][game]) - 2 * len(pairs)
        found.append(Pairing(game, side, other, len(pairs), unpaired, mean, difference, signs[1], signs[0], signs[-1]))
    return tuple(found)


def _sign(difference: float) -> int:
    return (difference > 0) - (difference < 0)


def _measured(rows: Sequence[Row]) -> dict[str, list[float]]:
    return {name: values(rows, measure) for name, measure in MEASURES.items()}


def _differences(pairs: Sequence[tuple[Row, Row]]) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for name, measure in MEASURES.items():
        measured = ((measure(row), measure(counterpart)) for row, counterpart in pairs)
        found[name] = [one - other for one, other in measured if one is not None and other is not None]
    return found


def _references(
    sides: Sides, matches: Sequence[tuple[str, Side, Side]]
) -> Iterator[tuple[str, Side, Mapping[str, MeanEstimate]]]:
    used = list(dict.fromkeys((game, reference) for game, _, reference in matches))
    means = named_estimates(_measured(sides[side][game]) for game, side in used)
    for (game, side), estimates in zip(used, means, strict=True):
        yield game, side, estimates


def _overall(sides: Sides, pairings: Sequence[Pairing]) -> Iterator[Overall]:
    for side, reference in dict.fromkeys((each.side, each.reference) for each in pairings):
        own = [each for each in pairings if (each.side, each.reference) == (side, reference)]
        samples: dict[str, list[float]] = {}
        for each in own:
            pairs = _pairs(sides[side][each.game], sides[reference][each.game])
            measured = ((normalized_score(row), normalized_score(other)) for row, other in pairs)
            found = [one - other for one, other in measured if one is not None and other is not None]
            if found:
                samples[each.game] = found
        weights = [[1 / len(samples)] * len(samples)] if samples else []
        difference = next(iter(weighted_estimates(list(samples.values()), weights)), None)
        sums = (sum(getattr(each, name) for each in own) for name in ("wins", "ties", "losses"))
        yield Overall(side, reference, tuple(samples), difference, *sums)


def _versions(runs: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, str]]:
    played: dict[str, dict[str, set[str]]] = {}
    for run, rows in runs.items():
        for row in rows:
            for name, version in {"prompts": row["prompts"], **row["versions"]}.items():
                played.setdefault(name, {}).setdefault(run, set()).add(str(version))
    found = {
        name: {run: ", ".join(sorted(versions)) for run, versions in by_run.items()} for name, by_run in played.items()
    }
    return {name: by_run for name, by_run in found.items() if len(set(by_run.values())) > 1}


def as_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return a flat row for every pairing: sides, number of pairs, means, differences with their intervals."""
    rows = []
    means = {(game, side): found for game, side, found in comparison.references}
    for each in comparison.pairings:
        row: dict[str, Any] = {"game": each.game}
        for name, side in (("", each.side), ("reference_", each.reference)):
            row |= {f"{name}run": side.run, f"{name}player": side.player, f"{name}label": side.label}
        row |= {name: getattr(each, name) for name in ("pairs", "unpaired", "wins", "ties", "losses")}
        for measure in MEASURES:
            own, other = each.means.get(measure), means[each.game, each.reference].get(measure)
            difference = each.differences.get(measure)
            row |= {measure: own and own.mean, f"reference_{measure}": other and other.mean}
            row[f"{measure}_difference"] = difference and difference.mean
            row[f"{measure}_difference_low"] = difference and difference.low
            row[f"{measure}_difference_high"] = difference and difference.high
        rows.append(row)
    return rows
