"""What a player does when it plays the same world again: the variance within worlds, and how often it succeeds.

A run with `repeats` plays every world several times with other random numbers of the player. The spread within a world
is the player's own, the spread between worlds is the game's. Worlds are the sample: an interval of a mean is that of
the worlds' means (`pairs`), since repeats of one world are not independent, and shares such as pass^k are resampled by
world.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from smartplay_tools.evaluation.analysis.formats import ShownColumn, TextTable, figures_table
from smartplay_tools.evaluation.analysis.grouping import PlayedCell, by_cell, labels
from smartplay_tools.evaluation.analysis.numbers import NOTHING
from smartplay_tools.records.rows import Row, mean_score
from smartplay_tools.statistics.distributions import Values, t_quantile
from smartplay_tools.statistics.intervals import CONFIDENCE, Bounds, mean_estimate
from smartplay_tools.types.groups import grouped

SEED = 20_240_417
RESAMPLES = 2_000

Share = tuple[float, float, float]
"""A figure and the ends of its 95 % interval."""


@dataclass(frozen=True)
class Repeats:
    """A cell whose worlds were played several times."""

    cell: PlayedCell
    label: str
    """A short description of what its player was given; empty for the default."""
    worlds: int
    repeats: int
    """The fewest of any world; further ones are left out, and so are worlds that were played once."""
    left_out: int
    """Episodes that are therefore in none of these figures."""
    within: float
    """The variance of scores within a world."""
    between: float
    """The variance of worlds' true means."""
    icc: Share | None
    """The share of the variance that is between worlds; None without any."""
    noise_floor: float
    """The difference that two runs of this player on these worlds show by chance (95 %)."""
    passes: tuple[tuple[int, Share, Share], ...]
    """k, pass@k (one of k succeeds) and pass^k (all k succeed)."""


def repeated(rows: Sequence[Row]) -> list[Repeats]:
    """Return the figures of all cells that have repeats; those succeed that completed, in cells where any did."""
    groups = by_cell(rows)
    labelled = zip(groups, labels([cell for cell, _ in groups]), strict=True)
    figures = (_repeats(cell, label, members) for (cell, members), label in labelled)
    return [each for each in figures if each is not None]


def _repeats(cell: PlayedCell, label: str, rows: Sequence[Row]) -> Repeats | None:
    worlds = [members for members in grouped(rows, lambda row: row["seed"]).values() if len(members) > 1]
    if len(worlds) < 2:
        return None
    repeats = min(map(len, worlds))
    played = [sorted(members, key=lambda row: row["trial"])[:repeats] for members in worlds]
    scores = np.array([list(map(mean_score, members)) for members in played], dtype=float)
    within, between = map(float, variances(scores))
    successes = [sum(row["completed"] for row in members) for members in played]
    counts = np.array(successes) if any(row["completed"] for row in rows) else None
    share = float(icc(scores))
    return Repeats(
        cell,
        label,
        len(played),
        repeats,
        len(rows) - len(played) * repeats,
        within,
        between,
        None if math.isnan(share) else by_worlds(scores, icc),
        noise_floor(within, len(played), repeats),
        () if counts is None else tuple(_passes(counts, repeats)),
    )


def variances(scores: Values) -> tuple[Values, Values]:
    """Return the variance of [..., world, repeat] within worlds, and that between them."""
    within = scores.var(axis=-1, ddof=1).mean(axis=-1)
    return within, np.maximum(0.0, scores.mean(axis=-1).var(axis=-1, ddof=1) - within / scores.shape[-1])


def icc(scores: Values) -> Values:
    """Return the share of the variance of [..., world, repeat] that is between worlds; NaN without any variance."""
    within, between = variances(scores)
    total = within + between
    return np.divide(between, total, out=np.full_like(total, math.nan), where=total > 0)


def noise_floor(within: float, worlds: int, repeats: int) -> float:
    """Return the paired difference that two runs of one player stay below in 95 of 100 cases."""
    df = worlds * (repeats - 1)
    return t_quantile((1 - CONFIDENCE) / 2, df) * math.sqrt(2 * within / (worlds * repeats))


def pass_at(successes: int, repeats: int, k: int) -> float:
    """The chance that at least one of k of the repeats is among the successes."""
    return 1 - math.comb(repeats - successes, k) / math.comb(repeats, k)


def pass_all(successes: int, repeats: int, k: int) -> float:
    """The chance that all of k of the repeats are among the successes."""
    return math.comb(successes, k) / math.comb(repeats, k)


def _passes(counts: Values, repeats: int) -> list[tuple[int, Share, Share]]:
    rows = []
    for k in sorted({1, 3, repeats} & set(range(1, repeats + 1))):
        at, every = (np.array([chance(int(c), repeats, k) for c in counts]) for chance in (pass_at, pass_all))
        rows.append((k, _chance(at), _chance(every)))
    return rows


def _chance(worlds: Values) -> Share:
    """The mean chance over worlds; where all of them are equal, the interval is what so many cannot exclude."""
    if len(set(worlds.tolist())) > 1:
        return by_worlds(worlds, _mean)
    alike = mean_estimate(worlds.tolist(), Bounds(0, 1))
    assert alike.low is not None
    assert alike.high is not None
    return alike.mean, alike.low, alike.high


def _mean(values: Values) -> Values:
    mean: Values = values.mean(axis=-1)
    return mean


def by_worlds(values: Values, figure: Callable[[Values], Values]) -> Share:
    """A figure of [world, ...] with the 95 % interval of a bootstrap of worlds, each with all of its repeats."""
    worlds = len(values)
    drawn = np.random.default_rng(SEED).integers(worlds, size=(RESAMPLES, worlds))
    # A resample whose worlds are all equal has no share of the variance; that between worlds is 0 there.
    low, high = np.quantile(np.nan_to_num(figure(values[drawn])), [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(figure(values)), float(low), float(high)


NOTES = (
    "sd: of scores, within a world (the player's own) and between worlds; ICC: the share between worlds",
    "floor: a difference of two runs below it is what the player has with itself",
    "pass@k: one of k repeats succeeds; pass^k: all of them",
)


def repeats_table(figures: Sequence[Repeats]) -> TextTable:
    """Return the table of cells with repeats."""
    games = {game: _named(own) for game, own in grouped(figures, lambda each: each.cell.game).items()}
    equal = [each.cell.player for each in figures if not each.within]
    notes = [f"{', '.join(dict.fromkeys(equal))}: all repeats are equal, so more trials say more"] if equal else []
    if left_out := sum(each.left_out for each in figures):
        notes.append(f"{left_out} episodes are left out, of worlds with more repeats than others or with one")
    return figures_table("repeats", "game and player", games, lambda _: FIGURES, (*NOTES, *notes))


def _named(figures: Sequence[Repeats]) -> list[tuple[str, Repeats]]:
    """The figures of a game by their players, with what these were given where a player has several."""
    players = Counter(each.cell.player for each in figures)
    labelled = ((each.label if players[each.cell.player] > 1 else "", each) for each in figures)
    return [(", ".join(filter(None, [each.cell.player, label])), each) for label, each in labelled]


FIGURES: Sequence[ShownColumn[Repeats]] = (
    ("worlds x", lambda each: f"{each.worlds} x {each.repeats}"),
    ("sd within", lambda each: f"{math.sqrt(each.within):.3g}"),
    ("between", lambda each: f"{math.sqrt(each.between):.3g}"),
    ("ICC", lambda each: NOTHING if each.icc is None else f"{each.icc[0]:.2f}"),
    ("floor", lambda each: f"{each.noise_floor:.2g}"),
    ("pass@k", lambda each: " ".join(f"{share[0]:.2f}" for _, share, _ in each.passes) or NOTHING),
    ("pass^k", lambda each: " ".join(f"{share[0]:.2f}" for _, _, share in each.passes) or NOTHING),
)


def as_json(each: Repeats) -> dict[str, Any]:
    """Return the figures of a cell as plain data."""
    shares = {f"{name}{k}": share for k, at, every in each.passes for name, share in (("pass@", at), ("pass^", every))}
    names = ("worlds", "repeats", "left_out", "within", "between", "icc", "noise_floor")
    facts = {name: getattr(each, name) for name in names}
    return {"game": each.cell.game, "player": each.cell.player, "condition": each.label, **facts, **shares}
