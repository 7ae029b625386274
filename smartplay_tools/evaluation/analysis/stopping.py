"""Stopping a comparison when it is decided, without more errors than a comparison of fixed length has.

Looking at an interval after every pair, and stopping when it excludes 0, errs far more often than the interval says.
Two tests by betting are valid at any time instead (aGRAPA; Waudby-Smith and Ramdas, "Estimating Means of Bounded Random
Variables by Betting", 2024): before each pair, capital is staked against a mean, guided by the earlier pairs; if the
mean is the true one, the capital ever grows twentyfold in at most one of 20 runs. That holds for all independent
differences between known bounds, rare failures included. The price is more pairs: with a cap below about 50, a
comparison of fixed length decides more often.

Pairs count in the order of the plan, not of completion: long episodes, which end last, score differently.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.episode.config import CellConfig
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, columns, sections
from smartplay_tools.evaluation.analysis.pairs import bounds_of, score
from smartplay_tools.evaluation.run_folder.folder import Manifest
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.distributions import Values
from smartplay_tools.statistics.intervals import Bounds
from smartplay_tools.types.groups import grouped

MOST_STAKED = 0.9
"""The share of the capital that a pair can cost at most."""

PRIOR_VARIANCE = 0.02
GRID = 401
"""Means among which the interval is searched."""

CLIP = 2
"""Human scores to which differences are clipped where a game has no bounds."""


Places = NDArray[np.intp]


@dataclass(frozen=True)
class Evidence:
    """What the pairs have shown so far."""

    word: Literal["different", "equivalent", "undecided"]
    pairs: int
    """Those that were used: up to the decision, or all."""
    mean: float
    low: float
    high: float
    """The ends of the 95 % confidence sequence, which holds at any time."""


def judge(differences: Sequence[float], bounds: Bounds, margin: float, comparisons: int = 1) -> Evidence:
    """Judge differences, at least one, in their order; `comparisons` share the error rate of 5 %."""
    values = np.asarray(differences, dtype=float)
    first = [int(at) for at in decided_at(values, bounds, margin, comparisons)]
    used = min(*first, len(values) - 1) + 1
    word: Any = "undecided" if min(first) == len(values) else ("different", "equivalent")[first[1] < first[0]]
    width = bounds.high - bounds.low
    x = (values[:used] - bounds.low) / width
    grid = np.linspace(0, 1, GRID)[1:-1]
    capital = np.maximum(_log_capital(x, grid).max(axis=-1), _log_capital(1 - x, 1 - grid).max(axis=-1))
    mean, kept = float(x.mean()), grid[capital < math.log(40 * comparisons)].tolist()
    low, high = min([mean, *kept]) - 1 / (GRID - 1), max([mean, *kept]) + 1 / (GRID - 1)
    low, high = (float(bounds.low + width * min(1.0, max(0.0, end))) for end in (low, high))
    return Evidence(word, used, mean=float(bounds.low + width * mean), low=low, high=high)


def decided_at(differences: Values, bounds: Bounds, margin: float, comparisons: int = 1) -> tuple[Places, Places]:
    """The place of the pair from which on "different", and from which on "equivalent", is shown, or their number.

    `differences` are those of one comparison, or of many, as [comparison, pair].
    """
    width = bounds.high - bounds.low
    x = (differences - bounds.low) / width
    zero, inside, outside = ((value - bounds.low) / width for value in (0, -margin, margin))
    up, down = _log_capital(x, [zero, inside]), _log_capital(1 - x, [1 - zero, 1 - outside])
    differ = np.maximum(up[..., 0, :], down[..., 0, :]) >= math.log(40 * comparisons)
    above, below = (
        np.maximum.accumulate(capital[..., 1, :], axis=-1) >= math.log(20 * comparisons) for capital in (up, down)
    )
    return _first(differ), _first(above & below)


def _first(reached: NDArray[np.bool_]) -> Places:
    """The place of the first value that is true along the last axis; its length where none is."""
    places: Places = np.where(reached.any(axis=-1), reached.argmax(axis=-1), reached.shape[-1])
    return places


def _log_capital(x: Values, against: Sequence[float] | Values) -> Values:
    """The logarithm of the capital after each of [..., value], staked against true means of at most those.

    It is [..., mean, value].
    """
    x = x[..., None, :]
    means = np.clip(np.asarray(against, dtype=float), 1e-12, 1)[:, None]
    counts = np.arange(1, x.shape[-1] + 1)
    average = (means + np.cumsum(x, axis=-1)) / (counts + 1)
    variance = (PRIOR_VARIANCE + np.cumsum((x - average) ** 2, axis=-1)) / (counts + 1)
    # A stake depends on the values before it.
    before = np.broadcast_to(means, (*average.shape[:-1], 1))
    average = np.concatenate([before, average[..., :-1]], axis=-1)
    variance = np.concatenate([np.full_like(before, PRIOR_VARIANCE), variance[..., :-1]], axis=-1)
    stakes = np.clip((average - means) / (variance + (average - means) ** 2), 0, MOST_STAKED / means)
    capital: Values = np.cumsum(np.log1p(stakes * (x - means)), axis=-1)
    capital[..., means[:, 0] <= 1e-12, :] = math.inf  # no mean is below the bound
    return capital


@dataclass(frozen=True)
class Decision:
    """A cell compared with the first one of its game."""

    game: str
    place: int
    """The number of the cell in the plan."""
    reference: int
    planned: int
    """Pairs."""
    finished: int
    """Pairs that both sides have played, those after the decision included."""
    clipped: int
    """Pairs among those used whose difference was clipped."""
    margin: float
    stop: Evidence | None
    """None without a pair."""

    @property
    def is_decided(self) -> bool:
        """Whether no more pairs are needed."""
        return self.stop is not None and self.stop.word != "undecided"


class Comparisons:
    """The comparisons of a run that stops when they are decided: every cell with the first one of its game."""

    def __init__(self, manifest: Manifest) -> None:
        assert manifest.until is not None
        self._until, self._cells = manifest.until, manifest.cells
        self._keys: dict[int, dict[int, str]] = {}
        for episode in manifest.episodes:
            self._keys.setdefault(episode.cell, {})[episode.trial] = episode.key
        first: dict[str, int] = {}
        self._pairs = [
            (place, first[cell.game])
            for place, cell in enumerate(self._cells)
            if first.setdefault(cell.game, place) != place
        ]
        if not self._pairs:
            raise InvalidArgumentError("There is nothing to decide: name two players or budgets for a game.")
        games = dict.fromkeys(self._cells[place].game for place, _ in self._pairs)
        self._bounds = {game: self._bounds_of(game) for game in games}
        self._margins = {game: self._margin_of(game) for game in games}

    def decisions(self, rows: Mapping[str, Row]) -> list[Decision]:
        """Judge every comparison from the rows of the finished episodes, by key."""
        return [self._decision(place, reference, rows) for place, reference in self._pairs]

    def undecided(self, rows: Mapping[str, Row]) -> set[int]:
        """Return the places of the cells whose episodes are still needed."""
        open_ones = [each for each in self.decisions(rows) if not each.is_decided]
        alone = set(range(len(self._cells))) - {place for pair in self._pairs for place in pair}
        return alone | {place for each in open_ones for place in (each.place, each.reference)}

    def _decision(self, place: int, reference: int, rows: Mapping[str, Row]) -> Decision:
        game = self._cells[place].game
        keys, others = self._keys[place], self._keys[reference]
        trials = sorted(keys.keys() & others.keys())
        done = [keys[trial] in rows and others[trial] in rows for trial in trials]
        # A pair that is not finished yet holds up those after it.
        in_order = trials[: done.index(False)] if False in done else trials
        raw = [score(rows[keys[trial]]) - score(rows[others[trial]]) for trial in in_order]
        bounds, margin = self._bounds[game], self._margins[game]
        if self._until.by == "wins":
            raw = [float(np.sign(value)) for value in raw]
        kept = [min(max(value, bounds.low), bounds.high) for value in raw]
        stop = judge(kept, bounds, margin, len(self._pairs)) if kept else None
        used = 0 if stop is None else stop.pairs
        clipped = sum(value != limited for value, limited in zip(raw[:used], kept, strict=False))
        return Decision(game, place, reference, len(trials), sum(done), clipped, margin, stop)

    def _bounds_of(self, game: str) -> Bounds:
        if self._until.by == "wins":
            return Bounds(-1, 1)
        spec = GAMES[game]  # never a file: the name is from rows and manifests
        if (bounds := bounds_of(score, spec)) is not None and self._until.clip is None:
            return bounds.of_differences
        clip = self._until.clip
        if clip is None and spec.human_score is not None and spec.min_score is not None:
            clip = CLIP * (spec.human_score - spec.min_score)
        if clip is None:
            raise InvalidArgumentError(
                f"{game} declares no bounds of its scores and has no human score; give --clip, or --by wins."
            )
        return Bounds(-clip, clip)

    def _margin_of(self, game: str) -> float:
        margin = Margin.parse(self._until.margin)
        if self._until.by == "wins" and margin.of_human:
            raise InvalidArgumentError("With --by wins the margin is a share of the pairs, such as 0.2.")
        return margin.points(game)


NOTES = (
    "[ ]: 95 % confidence sequence, which holds whenever one looks; used: pairs in the order of the plan",
    "a word is wrong in at most 5 % of such runs, all comparisons together",
)


def decisions_table(decisions: Sequence[Decision], cells: Sequence[CellConfig]) -> TextTable:
    """Return the table of a run that stops when it is decided."""
    rows = sections(
        (
            f"{game}, against {_name(cells[own[0].reference])}, margin {own[0].margin:g}",
            [(f"  {_name(cells[each.place])}", *_figures(each)) for each in own],
        )
        for game, own in grouped(decisions, lambda each: each.game).items()
    )
    headings = (*columns("", "used", "finished", "planned", "+-"), Column("word", words=True))
    clipped = sum(each.clipped for each in decisions)
    notes = [f"{clipped} differences were clipped, so +- is the mean of clipped differences"] if clipped else []
    return TextTable("until decided", headings, rows, (*NOTES, *notes))


def _name(cell: CellConfig) -> str:
    return ", ".join(filter(None, (cell.player, cell.describe())))


def _figures(each: Decision) -> tuple[str, ...]:
    stop = each.stop
    if stop is None:
        return "0", f"{each.finished}", f"{each.planned}", "-", "undecided"
    difference = f"{stop.mean:+.3g} [{stop.low:+.3g}, {stop.high:+.3g}]"
    return f"{stop.pairs}", f"{each.finished}", f"{each.planned}", difference, stop.word
