"""One number for what a window costs: the area under the curve of score against the cap on prompts.

Caps lie on a logarithmic axis, "no cap" at the largest prompt of any episode that had none, and the curve is joined by
straight lines. Scores are relative: 0 is the random player's on the same seeds, 1 that of the player's widest window in
the game. All curves of a player at a game have this one yardstick, so their areas can be compared. At 1 no cap costs
the player anything, and at 0 it plays no better than random under every cap; an area is not clipped to that range.
An episode that ended early counts as the least that its missing steps could have led to (`records.rows.counted_score`).
So does a cap that is too small for one of the compared strategies but not for all, as an episode without a step: all
are measured over one range of caps. Where a game declares no least score, such a cap counts as the random score. The
area varies with the grid of caps by 0.01 to 0.02, so only areas over the same grid are compared.

The interval is a jackknife over seeds: everything of a seed is left out together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smartplay_tools.evaluation.analysis.formats import TextTable, columns, sections
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell
from smartplay_tools.evaluation.analysis.headline import CUT, is_much_cut
from smartplay_tools.evaluation.analysis.intervals import CONFIDENCE, Values, mean_estimate, t_quantile
from smartplay_tools.evaluation.analysis.names import curve_names
from smartplay_tools.evaluation.analysis.pairs import cut_share
from smartplay_tools.evaluation.analysis.windows import family, jointly, width
from smartplay_tools.games.game_registry import Scoring
from smartplay_tools.records.rows import Row, counted_score, grouped, scoring_of

FEWEST_CAPS = 4
RANDOM = "random"


@dataclass(frozen=True)
class Area:
    """The area of one player with one strategy in one game; without one, `reason` says why."""

    game: str
    name: str
    """The player and its strategy, with whatever else tells the curves of the game apart."""
    caps: tuple[int | None, ...]
    """Ascending; None stands for no cap."""
    infeasible: tuple[int, ...]
    """Caps that are too small for this strategy."""
    unplayed: float | None
    """What such a cap counts as; None for the random score."""
    is_cut: bool
    """Whether some caps cut tool results, so that the area is not one of memory alone."""
    seeds: int
    area: float | None = None
    low: float | None = None
    high: float | None = None
    difference: tuple[float, float, float] | None = None
    """To the first strategy of the game, with its interval."""
    together: tuple[float, float, float] | None = None
    """The same with an interval that holds together with those of all other differences (Bonferroni)."""
    reason: str | None = None


_Groups = Sequence[tuple[PlayedCell, list[Row]]]


@dataclass(frozen=True)
class _Curve:
    """The rows of a player and a strategy under every cap, and those of the player's widest windows in the game."""

    name: str
    members: _Groups
    widest: _Groups

    @property
    def cells(self) -> dict[int | None, list[Row]]:
        return {cell.budget["prompt_tokens"]: rows for cell, rows in self.members}

    @property
    def refusal(self) -> str | None:
        """Why the curve has no area, whatever the other curves of the game are."""
        if any(row.get("carry") is not None for _, rows in self.members for row in rows):
            return "trials carry something over, so seeds are not independent"
        if len(self.cells) < len(self.members):
            return "cells under the same cap on prompts differ in their cap on results"
        if len(self.widest) > 1:
            return "several cells have the widest window, so there is no one score that is 1"
        if self.widest[0][0].budget["prompt_tokens"] is not None:
            return "the widest window has a cap on prompts"
        return None

    def scores(self, cap: int | None) -> dict[int, float]:
        return _by_seed(self.cells.get(cap, []))


def areas(rows: Sequence[Row], *, compared: int | None = None) -> list[Area]:
    """Return the areas of all players and strategies that were played under caps on prompts.

    Cells that differ only in their cap are a curve; those of one cap have no entry. `random` has to be among the
    players. `compared` is the number of differences whose intervals hold together; by default all those of these rows.
    """
    groups = by_cell(row for row in rows if row["end_reason"] != "run_budget")
    lines: dict[str, list[_Curve]] = {cell.game: [] for cell, _ in groups}
    families = [
        members
        for members in grouped(groups, lambda group: family(group[0], ("prompt_tokens",))).values()
        if members[0][0].player != RANDOM and len({cell.budget["prompt_tokens"] for cell, _ in members}) > 1
    ]
    cells = [members[0][0] for members in families]
    for cell, name, members in zip(cells, curve_names(cells), families, strict=True):
        lines[cell.game].append(_Curve(name, members, _widest(cell, groups)))
    if compared is None:
        compared = sum(len(curves) - 1 for curves in lines.values() if curves)
    confidence = jointly(compared).confidence
    result: list[Area] = []
    for game, curves in lines.items():
        random = [row for cell, own in groups if (cell.game, cell.player) == (game, RANDOM) for row in own]
        if curves:
            result += _areas_of(game, curves, _by_seed(random), confidence)
    return result


def _widest(beside: PlayedCell, groups: _Groups) -> _Groups:
    """The cells of a player at a game whose window is the widest; several if they differ in something else."""
    own = [group for group in groups if (group[0].game, group[0].player) == (beside.game, beside.player)]
    most = max(width(cell) for cell, _ in own)
    return [group for group in own if width(group[0]) == most]


def _by_seed(rows: Sequence[Row]) -> dict[int, float]:
    return {row["seed"]: counted_score(row) for row in rows}


def unplayed_score(scoring: Scoring | None) -> float | None:
    """Return what an episode that a cap refuses counts as; None where no least score is known."""
    if scoring is None or (scoring.worst_step is None and scoring.score_bounds is None):
        return None
    return scoring.least_score(0, 0)


def _areas_of(game: str, curves: Sequence[_Curve], random: dict[int, float], confidence: float) -> list[Area]:
    caps = sorted({cap for curve in curves for cap in curve.cells if cap is not None})
    grid = (*caps, None)
    peaks = [row.get("peak_prompt_tokens") or 0 for curve in curves for row in curve.cells.get(None, [])]
    lacking = None
    if len(grid) < FEWEST_CAPS:
        lacking = f"fewer than {FEWEST_CAPS} caps, no cap included"
    elif not random:
        lacking = "random was not played"
    elif not all(None in curve.cells for curve in curves):
        lacking = "not every curve was played without a cap on prompts"
    elif not max(peaks, default=0) > caps[-1]:
        lacking = "no prompt without a cap is known to be larger than the largest cap"
    everywhere = [rows for curve in curves for _, rows in (*curve.members, *curve.widest)]
    seeds = sorted(set(random).intersection(*map(_by_seed, everywhere)))
    if lacking is None and len(seeds) < 2:
        lacking = "fewer than two seeds were played everywhere"
    curve_areas: list[Area] = []
    unplayed = unplayed_score(scoring_of(everywhere[0][0]))
    refused = random if unplayed is None else dict.fromkeys(random, unplayed)
    first: tuple[Values, Values] | None = None
    for curve in curves:
        infeasible = tuple(cap for cap in caps if cap not in curve.cells)
        is_cut = any(map(is_much_cut, map(cut_share, curve.cells.values())))
        facts = (game, curve.name, grid, infeasible, unplayed, is_cut, len(seeds))
        if reason := curve.refusal or lacking:
            curve_areas.append(Area(*facts, reason=reason))
            continue
        full_scores = _by_seed(curve.widest[0][1])
        chance, full = (np.array([own[seed] for seed in seeds], dtype=float) for own in (random, full_scores))
        played = [curve.scores(cap) if cap in curve.cells else refused for cap in grid]
        scores = np.array([[own[seed] for own in played] for seed in seeds], dtype=float)
        gain = mean_estimate((full - chance).tolist())
        if gain.low is None or gain.high is None or gain.low <= 0 <= gain.high:
            curve_areas.append(Area(*facts, reason="the widest window is not shown to differ from random"))
            continue
        whole, without = with_jackknife(scores, chance, full, [math.log(cap) for cap in (*caps, max(peaks))])
        difference = together = None
        if first is not None:
            differing = whole - first[0], without - first[1]
            difference, together = interval_of(*differing), interval_of(*differing, confidence)
        first = (whole, without) if first is None else first
        curve_areas.append(Area(*facts, *interval_of(whole, without), difference=difference, together=together))
    return curve_areas


def with_jackknife(scores: Values, chance: Values, full: Values, places: Sequence[float]) -> tuple[Values, Values]:
    """The area of scores [seed, cap], where `chance` is 0 and `full` is 1, and those without each of the seeds."""
    x = np.asarray(places)
    weights = np.zeros(len(x))
    weights[:-1] += np.diff(x) / 2
    weights[1:] += np.diff(x) / 2
    under = scores @ (weights / (x[-1] - x[0]))

    def ratio(*sums: Values) -> Values:
        return (sums[0] - sums[1]) / (sums[2] - sums[1])

    totals = [values.sum() for values in (under, chance, full)]
    left = [total - values for total, values in zip(totals, (under, chance, full), strict=True)]
    return ratio(*totals), ratio(*left)


def interval_of(whole: Values, without: Values, confidence: float = CONFIDENCE) -> tuple[float, float, float]:
    """A figure with its interval, of 95 % by default, from the figures without each of the seeds (jackknife)."""
    n = len(without)
    error = math.sqrt((n - 1) / n * float(((without - without.mean()) ** 2).sum()))
    half = t_quantile((1 - confidence) / 2, n - 1) * error
    return float(whole), float(whole) - half, float(whole) + half


NOTES = (
    "area under score against log of the cap on prompts: 1 is the player's widest window in the game, 0 is random",
    "[ ]: 95 %, jackknife over seeds; +-: to the game's first line; compare areas over the same caps only",
)


def areas_table(areas: Sequence[Area]) -> TextTable:
    """Return the table of areas, with a section for each game."""
    games = grouped(areas, lambda each: each.game)
    caps = {game: ["none" if cap is None else f"{cap:,}" for cap in own[0].caps] for game, own in games.items()}
    rows = sections((f"{game}, caps {', '.join(caps[game])}", map(_row, own)) for game, own in games.items())
    reasons = dict.fromkeys(f"-: {each.reason}" for each in areas if each.reason)
    low = dict.fromkeys(
        f"{each.name}: {', '.join(map(str, each.infeasible))} too small, counted as {_counted_as(each)}"
        for each in areas
        if each.infeasible
    )
    cut = [f"{CUT}: some caps cut tool results"] if any(each.is_cut for each in areas) else []
    headings = columns("player and strategy", "seeds", "area", "+-")
    return TextTable("areas under the curve", headings, rows, (*NOTES, *reasons, *low, *cut))


def _counted_as(each: Area) -> str:
    return "random" if each.unplayed is None else f"{each.unplayed:g}"


def _row(each: Area) -> tuple[str, ...]:
    mark = CUT * each.is_cut
    if each.area is None:
        return f"  {each.name}{mark}", f"{each.seeds}", "-", "-"
    compared = "" if each.difference is None else "{:+.3f} [{:+.3f}, {:+.3f}]".format(*each.difference)
    return f"  {each.name}{mark}", f"{each.seeds}", f"{each.area:.3f} [{each.low:.3f}, {each.high:.3f}]", compared
