"""Means with 95 % confidence intervals, which are always the same for the same episodes.

Which interval a mean has follows from what its measure can be (`Bounds`), never from what a sample happens to look
like; docs/metrics.md has the table, and the slow tests show how often each interval covers the truth.

    declared to be one of two values   Wilson's interval of a share, and Tango's of a difference in pairs
    anything else                      at each end the wider of Student's t and the bootstrap
    all values equal                   what the number of episodes alone can exclude, between the declared bounds
    one value, or all equal unbounded  none; the `note` of the estimate says why

The bootstrap is bias-corrected and accelerated (BCa; Efron, "Better Bootstrap Confidence Intervals", 1987), because
scores of games are skewed, and its level is expanded, because samples are small (Hesterberg, "What Teachers Should Know
about the Bootstrap", 2015). Nothing is drawn for it: the distribution of the mean of a resample is computed from its
characteristic function, the product of those of the values that are drawn, so an interval is that of infinitely many
resamples and depends on the values alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.statistics.distributions import NORMAL, Values, t_quantile, tango, wilson

__all__ = ["Bounds", "MeanEstimate", "Method", "mean_estimate"]

CONFIDENCE = 0.95

POINTS = 2048
"""Places at which the bootstrap's distribution is computed."""

CELLS = 64
"""Places in a standard deviation, so that they reach to 16 of them on either side."""

STRIDE = 32
"""Frequencies between two coarse ones, of which a characteristic function is composed."""

FEW = 10
"""With fewer episodes than this, tables say that there are few."""

Ordered = tuple[float, ...]
"""Sorted values."""

Interval = tuple[float, float]

ONE_EPISODE = "one episode has no interval"
ALL_EQUAL = "all {n} equal; up to {percent:.2g}% of all episodes may differ"


@dataclass(frozen=True)
class Bounds:
    """What a measure can be: from `low` to `high`."""

    low: float
    high: float
    two_valued: bool = False
    """Whether every value is one of the two; a difference can also be 0."""
    paired: bool = False
    """Whether it is a difference between the two episodes of a pair."""

    @property
    def of_differences(self) -> Bounds:
        """What the difference of two such values can be."""
        return self.less(self)

    def less(self, other: Bounds) -> Bounds:
        """What such a value less one within `other` can be."""
        is_two_valued = self.two_valued and other.two_valued
        return Bounds(self.low - other.high, self.high - other.low, is_two_valued, paired=True)

    def hold(self, ordered: Ordered) -> bool:
        """Whether sorted values are as declared; a declaration that one of them contradicts does not count."""
        if ordered[0] < self.low or ordered[-1] > self.high:
            return False
        allowed = {self.low, self.high} | ({0.0} if self.paired else set())
        return not self.two_valued or allowed.issuperset(ordered)


@dataclass(frozen=True)
class Sample:
    """The values of a measure, and what they can be, if that is declared."""

    values: Sequence[float]
    bounds: Bounds | None = None
    units: Sequence[int] = ()
    """The world or chain of each value."""


@dataclass(frozen=True)
class Method:
    """How intervals are made."""

    confidence: float = CONFIDENCE
    bootstrap: bool = True
    """Without it, Student's t alone, as for intervals that hold together."""


USUAL = Method()


@dataclass(frozen=True)
class MeanEstimate:
    """A mean over episodes with its 95 % interval; `low` and `high` are None if that is unknown."""

    mean: float
    low: float | None
    high: float | None
    episodes: int
    note: str | None = None
    """The reason why there is no interval."""
    all_equal: bool = False
    sd: float | None = field(default=None, compare=False)
    """The standard deviation of the episodes; None for a single episode and for sums."""

    @property
    def sign_p(self) -> float | None:
        """The p value of the sign test of a difference that is the same in all pairs, and not 0; otherwise None."""
        return float(2.0 ** (1 - self.episodes)) if self.all_equal and not self.is_zero else None

    @property
    def is_zero(self) -> bool:
        """Whether every value is 0, but for rounding."""
        return self.all_equal and abs(self.mean) < 1e-9


def with_ends(name: str, estimate: MeanEstimate | None) -> dict[str, float | None]:
    """Return a mean and the ends of its interval under the names that flat rows have for them."""
    if estimate is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: estimate.mean, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def equal_share(n: int, confidence: float = CONFIDENCE) -> float:
    """Return how many of all episodes may differ, at most, if `n` of them are equal."""
    return 1.0 - float((1 - confidence) ** (1 / n))


def mean_estimate(values: Sequence[float], bounds: Bounds | None = None, method: Method = USUAL) -> MeanEstimate:
    """Estimate the mean of a sample, which must not be empty."""
    ordered = _ordered(values)
    estimate = _plain_estimate(ordered, bounds, method)
    if estimate.low is not None or estimate.note is not None:
        return estimate
    return _with(estimate, _within(_interval(ordered, method), ordered, bounds))


def mean_estimates(samples: Sequence[Sample], method: Method = USUAL) -> list[MeanEstimate]:
    """Estimate the mean of every sample, each as if it were alone."""
    return [mean_estimate(sample.values, sample.bounds, method) for sample in samples]


def _within(interval: Interval, ordered: Ordered, bounds: Bounds | None) -> Interval:
    """An interval cut to what a mean can be."""
    if bounds is None or not bounds.hold(ordered):
        return interval
    return max(interval[0], bounds.low), min(interval[1], bounds.high)


def named_estimates(samples: Mapping[str, Sample], method: Method = USUAL) -> dict[str, MeanEstimate]:
    """Estimate the mean of every named sample that is not empty."""
    return {name: mean_estimate(each.values, each.bounds, method) for name, each in samples.items() if each.values}


def weighted_estimates(samples: Sequence[Sequence[float]], weightings: Sequence[Sequence[float]]) -> list[MeanEstimate]:
    """Estimate, for every weighting, the sum of weight x mean over samples that are resampled independently.

    The level is expanded as the smallest of the samples needs. A sample of one episode has no spread: if it has a
    weight other than 0, there is no interval.
    """
    ordered = [_ordered(sample) for sample in samples]
    return [_weighed(ordered, weights) for weights in weightings]


def _weighed(samples: Sequence[Ordered], weights: Sequence[float]) -> MeanEstimate:
    estimate = _weighted_estimate(samples, weights)
    if estimate.note is not None:
        return estimate
    used = tuple((sample, float(weight)) for sample, weight in zip(samples, weights, strict=True) if weight)
    if len(used) == 1:
        ((sample, weight),) = used
        low, high = sorted(weight * end for end in _interval(sample, USUAL))
        return _with(estimate, (low, high))
    return _with(estimate, _bootstrapped(used, _expanded(min(len(sample) for sample, _ in used), CONFIDENCE)))


def _ordered(sample: Sequence[float]) -> Ordered:
    return tuple(sorted(map(float, sample)))


def _plain_estimate(ordered: Ordered, bounds: Bounds | None, method: Method) -> MeanEstimate:
    """The mean, and the interval if its ends have a formula."""
    estimate, n = _weighted_estimate([ordered], [1.0]), len(ordered)
    if n > 1:
        estimate = replace(estimate, sd=float(np.std(ordered, ddof=1)))
    if estimate.note == ONE_EPISODE or bounds is None or not bounds.hold(ordered):
        return estimate
    if bounds.two_valued:
        return _with(estimate, _share_interval(ordered, bounds, method))
    if estimate.all_equal and bounds.high < math.inf:
        u, value = equal_share(n, method.confidence), estimate.mean
        return _with(estimate, (value - u * (value - bounds.low), value + u * (bounds.high - value)))
    return estimate


def _with(estimate: MeanEstimate, interval: Interval) -> MeanEstimate:
    return replace(estimate, low=interval[0], high=interval[1], note=None)


def _share_interval(ordered: Ordered, bounds: Bounds, method: Method) -> Interval:
    """The interval of a measure that has two values, or of its difference in pairs."""
    n, high, width = len(ordered), ordered.count(bounds.high), bounds.high - bounds.low
    if bounds.paired:
        low, top = tango(high, ordered.count(bounds.low), n, method.confidence)
        return bounds.high * low, bounds.high * top
    low, top = wilson(high, n, method.confidence)
    return bounds.low + width * low, bounds.low + width * top


def _weighted_estimate(samples: Sequence[Ordered], weights: Sequence[float]) -> MeanEstimate:
    """The weighted sum without its interval, and the reason if the bootstrap has none for it."""
    total = math.fsum(weight * math.fsum(sample) / len(sample) for sample, weight in zip(samples, weights, strict=True))
    episodes = sum(map(len, samples))
    weighed = [sample for sample, weight in zip(samples, weights, strict=True) if weight]
    if any(len(sample) == 1 for sample in weighed):
        return MeanEstimate(total, None, None, episodes, ONE_EPISODE)
    if all(map(is_constant, weighed)):
        share = equal_share(min(map(len, weighed), default=1))
        return MeanEstimate(
            total, None, None, episodes, ALL_EQUAL.format(n=episodes, percent=100 * share), all_equal=True
        )
    return MeanEstimate(total, None, None, episodes)


def is_constant(values: Sequence[float]) -> bool:
    """Return whether values are equal; they may differ by rounding, as rewards that were added in another order do."""
    least, most = min(values), max(values)
    return most - least <= 1e-9 * max(1.0, abs(most))


def _interval(ordered: Ordered, method: Method) -> Interval:
    """The interval of the mean of a sample: at each end the wider of Student's t and the bootstrap."""
    n, mean = len(ordered), math.fsum(ordered) / len(ordered)
    half = t_quantile((1 - method.confidence) / 2, n - 1) * float(np.std(ordered, ddof=1)) / math.sqrt(n)
    if not method.bootstrap:
        return mean - half, mean + half
    low, high = _bootstrapped(((ordered, 1.0),), _expanded(n, method.confidence))
    return min(low, mean - half), max(high, mean + half)


def _expanded(n: int, confidence: float) -> float:
    """The normal quantile of the expanded level, with which the bootstrap of `n` normal values is as wide as t."""
    return t_quantile((1 - confidence) / 2, n - 1) * math.sqrt(n / (n - 1))


@lru_cache(4_096)
def _bootstrapped(weighed: tuple[tuple[Ordered, float], ...], level: float) -> Interval:
    """The BCa interval of the sum of weight x mean over samples with their weights, each resampled by itself.

    `level` is the normal quantile of its level. Scores are discrete, so many resamples tie with the mean: a value of
    the sum is spread over two cells or so, which counts a tie half on either side of the mean.
    """
    apart = [weight * (np.array(sample) - np.mean(sample)) / len(sample) for sample, weight in weighed]
    sd = math.sqrt(sum(float(values @ values) for values in apart))
    frequencies = 2 * np.pi * np.arange(POINTS // 2 + 1) / POINTS
    product = np.exp(-(frequencies**2) / 2).astype(complex)
    for values in apart:
        product *= _characteristic(values * (CELLS / sd)) ** len(values)
    density = np.roll(np.fft.irfft(product, POINTS), POINTS // 2)
    shares = np.maximum.accumulate(np.cumsum(density) - density / 2)
    places = (np.arange(POINTS) - POINTS // 2) * sd / CELLS
    bias = NORMAL.inv_cdf(float(shares[POINTS // 2]))
    acceleration = sum(float((values**3).sum()) for values in apart) / sd**3 / 6
    total = sum(weight * math.fsum(sample) / len(sample) for sample, weight in weighed)
    extremes = [sorted((weight * sample[0], weight * sample[-1])) for sample, weight in weighed]
    least, most = sum(low for low, _ in extremes), sum(high for _, high in extremes)
    ends = (np.interp(_corrected(bias, bias + away, acceleration), shares, places) for away in (-level, level))
    low, high = (min(max(total + float(end), least), most) for end in ends)
    return low, high


def _characteristic(values: Values) -> NDArray[np.complex128]:
    """The mean of exp(-i x frequency x value) at the frequencies of `POINTS` places; each is a product of two."""
    angles = -2j * np.pi / POINTS * values[:, None]
    coarse = np.exp(angles * STRIDE * np.arange(POINTS // 2 // STRIDE + 1))
    fine = np.exp(angles * np.arange(STRIDE))
    means = np.einsum("vc,vf->cf", coarse, fine).ravel() / len(values)
    characteristic: NDArray[np.complex128] = means[: POINTS // 2 + 1]
    return characteristic


def _corrected(bias: float, shifted: float, acceleration: float) -> float:
    """The share of resamples below an end of a BCa interval."""
    room = 1 - acceleration * shifted
    return NORMAL.cdf(bias + shifted / room) if room > 0 else float(shifted > 0)
