"""Means with 95 % confidence intervals, which are always the same for the same episodes.

Which interval a mean has follows from what its measure can be (`Bounds`), never from what a sample happens to look
like; docs/metrics.md has the table, and the slow tests show how often each interval covers the truth.

    declared to be one of two values   Wilson's interval of a share, and Tango's of a difference in pairs
    anything else                      at each end the wider of Student's t and the bootstrap
    all values equal                   what the number of episodes alone can exclude, between the declared bounds
    one value, or all equal unbounded  none; the `note` of the estimate says why

The bootstrap is bias-corrected and accelerated (BCa; Efron, "Better Bootstrap Confidence Intervals", 1987), because
scores of games are skewed, and its level is expanded, because samples are small (Hesterberg, "What Teachers Should Know
about the Bootstrap", 2015). For means there is less to compute than usual, which matters at ten thousand episodes:
samples of the same size share their resamples, and the skewness has a closed form instead of leaving out every episode
once. An interval depends on the values alone: the generator has a fixed seed and the values are sorted, so neither the
workers nor the order of completion can change it.

A share, or the difference of two shares in pairs of episodes, has a distribution that is known but for one number, so
nothing has to be resampled for it.

The module begins with the distributions: Student's t, central and not, chi-squared and the binomial. The standard
library has the normal distribution only, and NumPy draws from the others without having their probabilities. SciPy has
them all, but takes more than 100 MB, which the core does not need otherwise; tests compare these functions with it
(`tests/evaluation/test_intervals.py`) and with statsmodels (`test_oracles.py`). Intervals of shares follow, then means.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from smartplay_tools.records.rows import grouped

__all__ = ["Bounds", "MeanEstimate", "Method", "mean_estimate"]

NORMAL = NormalDist()
"""The standard normal distribution."""


def crossing(falling: Callable[[float], float], low: float, high: float, steps: int = 60) -> float:
    """Return where a falling function passes 0 between `low` and `high`."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if falling(middle) > 0 else (low, middle)
    return (low + high) / 2


def beyond(falling: Callable[[float], float]) -> float:
    """Return a power of 2 at which a falling function is no longer positive."""
    high = 1.0
    while falling(high) > 0:
        high *= 2
    return high


def t_tail(t: float, df: float) -> float:
    """The probability that Student's t with `df` degrees of freedom is above `t`, which is at least 0."""
    return 0.5 * _incomplete_beta(df / 2, 0.5, df / (df + t * t))


@lru_cache(maxsize=4096)
def t_quantile(tail: float, df: float) -> float:
    """The value that Student's t exceeds with probability `tail`, at most 0.5."""

    def excess(t: float) -> float:
        return t_tail(t, df) - tail

    return crossing(excess, 0.0, beyond(excess), 80)


def chi_squared_quantile(probability: float, df: float) -> float:
    """The value below which chi-squared with `df` degrees of freedom is with this probability."""

    def shortfall(x: float) -> float:
        return probability - _incomplete_gamma(df / 2, x / 2)

    return crossing(shortfall, 0.0, beyond(shortfall), 80)


def binomial_at_most(successes: int, n: int, share: float) -> float:
    """The probability of at most this number of successes in `n` trials."""
    if successes < 0 or successes >= n:
        return float(successes >= n)
    return _incomplete_beta(n - successes, successes + 1, 1 - share)


def t_power(effect: float, n: int, alpha: float = 0.05) -> float:
    """The power of the two-sided t test of `n` differences whose mean is `effect` standard deviations.

    The noncentral t is integrated over the ratio of the sample's standard deviation to the population's.
    """
    df, shift = n - 1, effect * math.sqrt(n)
    critical = t_quantile(alpha / 2, df)
    spread = 8 / math.sqrt(2 * df)
    low, high = max(0.0, 1 - spread), 1 + spread
    nodes, weights = _legendre()
    ratios = (low + high) / 2 + (high - low) / 2 * nodes
    logs = (df - 1) * np.log(ratios) - df * ratios * ratios / 2
    density = weights * np.exp(logs - logs.max())
    either = [NORMAL.cdf(shift - critical * r) + NORMAL.cdf(-shift - critical * r) for r in ratios.tolist()]
    return float(density @ np.array(either) / density.sum())


@cache
def _legendre() -> tuple[Values, Values]:
    """Places between -1 and 1, and their weights, with which a smooth function is integrated (Gauss and Legendre)."""
    nodes, weights = np.polynomial.legendre.leggauss(100)
    return nodes, weights


def _incomplete_beta(a: float, b: float, x: float) -> float:
    """The regularised incomplete beta function, by its continued fraction (Lentz)."""
    if x <= 0 or x >= 1:
        return float(x >= 1)
    if x > (a + 1) / (a + b + 2):
        return 1 - _incomplete_beta(b, a, 1 - x)
    logs = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    value, above, below = 1.0, 1.0, 0.0
    for i in range(10_000):
        m = i // 2
        if i == 0:
            term = 1.0
        elif i % 2 == 0:
            term = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        else:
            term = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        below = 1 / (1 + term * below)
        above = 1 + term / above
        value *= above * below
        if abs(1 - above * below) < 1e-15:
            break
    return math.exp(logs) / a * (value - 1)


def _incomplete_gamma(a: float, x: float) -> float:
    """The regularised lower incomplete gamma function, by its series."""
    if x <= 0:
        return 0.0
    term = total = 1 / a
    k = a
    while term > total * 1e-16:
        k += 1
        term *= x / k
        total += term
    return math.exp(a * math.log(x) - x - math.lgamma(a)) * total


def wilson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """The score interval of a share (Wilson 1927): on average it covers as often as it says, near 0 and 1 less."""
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    share, square = successes / n, z * z / n
    middle = (share + square / 2) / (1 + square)
    half = math.sqrt(share * (1 - share) * square + square * square / 4) / (1 + square)
    return 0.0 if successes == 0 else middle - half, 1.0 if successes == n else middle + half


@lru_cache(maxsize=4096)
def clopper_pearson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """The exact interval of a share (Clopper and Pearson 1934): it covers at least as often as it says."""
    tail = (1 - confidence) / 2
    low = crossing(lambda share: tail - 1 + binomial_at_most(successes - 1, n, share), 0, 1)
    high = crossing(lambda share: binomial_at_most(successes, n, share) - tail, 0, 1)
    return 0.0 if successes == 0 else low, 1.0 if successes == n else high


@lru_cache(maxsize=4096)
def tango(first: int, second: int, n: int, confidence: float) -> tuple[float, float]:
    """The score interval of a difference of paired shares (Tango 1998).

    In `first` of the `n` pairs only the first episode succeeded, in `second` only the second one.
    """
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    estimate = (first - second) / n

    def score(difference: float) -> float:
        linear = -first - second + (2 * n - first + second) * difference
        constant = -second * difference * (1 - difference)
        root = math.sqrt(max(0.0, linear * linear - 8 * n * constant))
        variance = n * ((root - linear) / (2 * n) + difference * (1 - difference))
        distance = first - second - n * difference
        if variance > 1e-15:
            return distance / math.sqrt(variance)
        return math.copysign(math.inf, distance) if distance else 0.0

    low = -1.0 if first - second == -n else crossing(lambda difference: score(difference) - z, -1, estimate)
    high = 1.0 if first - second == n else crossing(lambda difference: score(difference) + z, estimate, 1)
    return low, high


CONFIDENCE = 0.95
RESAMPLES = 10_000
"""Enough that with another seed the ends of an interval change by only a few hundredths of its width."""

SEED = 20_240_417
BLOCK = 200_000
"""Values drawn at once, few enough for a processor's cache, so that ten thousand episodes need little memory."""

DIGITS = 12
"""Digits to which resampled values are rounded (`_bca` says why)."""

FEW = 10
"""With fewer episodes than this, tables say that there are few."""

Values = NDArray[np.float64]

Ordered = tuple[float, ...]
"""Sorted values."""

Interval = tuple[float, float]

ONE_EPISODE = "one episode has no interval"
ALL_EQUAL = "all {n} equal; up to {share:.0%} of all episodes may differ"


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
        width = self.high - self.low
        return Bounds(-width, width, self.two_valued, paired=True)

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


@dataclass(frozen=True)
class Method:
    """How intervals are made."""

    confidence: float = CONFIDENCE
    exact: bool = False
    """Clopper and Pearson's interval of a share, which covers at least as often as it says, instead of Wilson's."""
    bootstrap: bool = True
    """Without it, Student's t alone: ten thousand resamples have no quantile far out in the tails."""


USUAL = Method()


@dataclass(frozen=True)
class MeanEstimate:
    """A mean over episodes with its 95 % interval; `low` and `high` are None if that is unknown."""

    mean: float
    low: float | None
    high: float | None
    episodes: int
    note: str | None = None
    """The reason why there is no interval, or that all episodes are equal."""
    all_equal: bool = False
    sd: float | None = field(default=None, compare=False)
    """The standard deviation of the episodes; None for a single episode and for sums."""


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
    return mean_estimates([Sample(values, bounds)], method)[0]


def mean_estimates(samples: Sequence[Sample], method: Method = USUAL) -> list[MeanEstimate]:
    """Estimate the mean of every sample, each as if it were alone.

    Samples of the same size share the random numbers, whose drawing takes most of the time, so all statistics of a run
    are best computed in one call.
    """
    ordered = [(_ordered(sample.values), sample.bounds) for sample in samples]
    estimates = {each: _plain_estimate(*each, method) for each in ordered}
    open_ones = [each for each, estimate in estimates.items() if estimate.low is None and estimate.note is None]
    for alike in grouped(open_ones, lambda each: len(each[0])).values():
        for each, interval in zip(alike, _intervals([values for values, _ in alike], method), strict=True):
            estimates[each] = _with(estimates[each], _within(interval, *each))
    return [estimates[each] for each in ordered]


def _within(interval: Interval, ordered: Ordered, bounds: Bounds | None) -> Interval:
    """An interval cut to what a mean can be."""
    if bounds is None or not bounds.hold(ordered):
        return interval
    return max(interval[0], bounds.low), min(interval[1], bounds.high)


_REMEMBERED = 4_096
_known_intervals: dict[bytes, Interval] = {}
"""The intervals that were asked for before, by a digest of what they follow from: the tables and figures of a report
ask for the same ones again and again, and that of ten thousand episodes takes seconds."""


def _intervals(samples: Sequence[Ordered], method: Method) -> list[Interval]:
    """The intervals of the means of samples of one size: at each end the wider of Student's t and the bootstrap."""
    data = np.array(samples)
    n = data.shape[1]
    half = t_quantile((1 - method.confidence) / 2, n - 1) * data.std(axis=1, ddof=1) / math.sqrt(n)
    means = data.mean(axis=1)
    students = list(zip((means - half).tolist(), (means + half).tolist(), strict=True))
    if not method.bootstrap:
        return students
    drawn = _bootstrapped(data, method.confidence)
    return [(min(t[0], b[0]), max(t[1], b[1])) for t, b in zip(students, drawn, strict=True)]


def _bootstrapped(data: Values, confidence: float) -> list[Interval]:
    """The bootstrap intervals of the means of rows."""
    z = _expanded(data.shape[1], confidence)

    def compute(which: list[int]) -> list[Interval]:
        values = data[which]
        scales = np.abs(values).max(axis=1)
        scaled = values / scales[:, None]
        skew = _skew([scaled], np.ones((len(which), 1)))
        return _bca([scaled], lambda means: means[0], skew, scales, values.shape[1], np.full(len(which), z))

    return _remembered([_digest(values, np.array(z)) for values in data], compute)


def _expanded(n: int, confidence: float) -> float:
    """The normal quantile of the expanded level, with which the bootstrap of `n` normal values is as wide as t."""
    return t_quantile((1 - confidence) / 2, n - 1) * math.sqrt(n / (n - 1))


def _remembered(keys: Sequence[bytes], compute: Callable[[list[int]], list[Interval]]) -> list[Interval]:
    """The intervals with these keys; `compute` returns those that are not known yet, by their positions."""
    intervals = {key: _known_intervals[key] for key in keys if key in _known_intervals}
    missing = [at for at, key in enumerate(keys) if key not in intervals]
    if missing:
        intervals.update(zip((keys[at] for at in missing), compute(missing), strict=True))
        if len(_known_intervals) > _REMEMBERED:
            _known_intervals.clear()
        _known_intervals.update(intervals)
    return [intervals[key] for key in keys]


def _digest(*parts: Values) -> bytes:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(f"{part.shape}".encode())
        digest.update(part.tobytes())
    return digest.digest()


def named_estimates(groups: Iterable[Mapping[str, Sample]], method: Method = USUAL) -> list[dict[str, MeanEstimate]]:
    """Estimate the named samples of every group in one call; empty samples have no estimate."""
    groups = [{name: sample for name, sample in group.items() if sample.values} for group in groups]
    estimates = iter(mean_estimates([sample for group in groups for sample in group.values()], method))
    return [{name: next(estimates) for name in group} for group in groups]


def weighted_estimates(samples: Sequence[Sequence[float]], weightings: Sequence[Sequence[float]]) -> list[MeanEstimate]:
    """Estimate, for every weighting, the sum of weight x mean over samples that are resampled independently.

    The samples are drawn once for all weightings, and the level is expanded as the smallest of them needs. A sample of
    one episode has no spread: if it has a weight other than 0, there is no interval.
    """
    ordered = [_ordered(sample) for sample in samples]
    estimates = [_weighted_estimate(ordered, weights) for weights in weightings]
    regular = [at for at, estimate in enumerate(estimates) if estimate.note is None]
    # A sample with weight 0 in all of the sums is not drawn: it may be a single episode.
    used = [at for at in range(len(samples)) if any(weightings[each][at] for each in regular)]
    if not regular:
        return estimates
    if len(used) == 1:
        # A sum over one sample is a multiple of its mean, whose interval is mostly known.
        (interval,) = _intervals([ordered[used[0]]], USUAL)
        for at in regular:
            low, high = sorted(weightings[at][used[0]] * end for end in interval)
            estimates[at] = replace(estimates[at], low=low, high=high)
        return estimates
    data = [np.array(ordered[at]) for at in used]
    scale = max(np.abs(values).max() for values in data)
    weights = np.array([[weightings[each][at] for at in used] for each in regular])
    smallest = [min(len(values) for values, weight in zip(data, row, strict=True) if weight) for row in weights]
    levels = np.array([_expanded(n, CONFIDENCE) for n in smallest])

    def compute(which: list[int]) -> list[Interval]:
        chosen = weights[which]

        def total(means: Sequence[Values]) -> Values:
            return chosen @ np.concatenate(means)

        scaled = [values[None, :] / scale for values in data]
        return _bca(
            scaled, total, _skew(scaled, chosen), np.full(len(which), scale), sum(map(len, data)), levels[which]
        )

    intervals = _remembered([_digest(row, *data) for row in weights], compute)
    for at, interval in zip(regular, intervals, strict=True):
        estimates[at] = _with(estimates[at], interval)
    return estimates


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
    if estimate.all_equal:
        u, value = equal_share(n, method.confidence), estimate.mean
        return _with(estimate, (value - u * (value - bounds.low), value + u * (bounds.high - value)))
    return estimate


def _with(estimate: MeanEstimate, interval: Interval) -> MeanEstimate:
    return replace(estimate, low=interval[0], high=interval[1])


def _share_interval(ordered: Ordered, bounds: Bounds, method: Method) -> Interval:
    """The interval of a measure that has two values, or of its difference in pairs."""
    n, high, width = len(ordered), ordered.count(bounds.high), bounds.high - bounds.low
    if bounds.paired:
        low, top = tango(high, ordered.count(bounds.low), n, method.confidence)
        return bounds.high * low, bounds.high * top
    low, top = (clopper_pearson if method.exact else wilson)(high, n, method.confidence)
    return bounds.low + width * low, bounds.low + width * top


def _weighted_estimate(samples: Sequence[Ordered], weights: Sequence[float]) -> MeanEstimate:
    """The weighted sum without its interval, and the reason if the bootstrap has none for it."""
    total = math.fsum(weight * math.fsum(sample) / len(sample) for sample, weight in zip(samples, weights, strict=True))
    episodes = sum(map(len, samples))
    weighed = [sample for sample, weight in zip(samples, weights, strict=True) if weight]
    if any(len(sample) == 1 for sample in weighed):
        return MeanEstimate(total, None, None, episodes, ONE_EPISODE)
    # Sums of floats differ by rounding: rewards that were added in another order still count as equal.
    rounding = 1e-9 * max(1.0, abs(total))
    if all(sample[-1] - sample[0] <= rounding for sample in weighed):
        share = equal_share(min(map(len, weighed), default=1))
        return MeanEstimate(total, None, None, episodes, ALL_EQUAL.format(n=episodes, share=share), all_equal=True)
    return MeanEstimate(total, None, None, episodes)


def _skew(samples: Sequence[Values], weights: Values) -> Values:
    """The acceleration of every weighted sum of means: a sixth of the skewness of its sampling distribution.

    `weights` is [sum, sample]; a sample is [row, value], with one row for all sums or one for each.
    """
    apart = [values - values.mean(axis=-1, keepdims=True) for values in samples]
    moments = [
        sum(weights[:, at] ** power * (d**power).sum(axis=-1) / d.shape[-1] ** power for at, d in enumerate(apart))
        for power in (2, 3)
    ]
    skew: Values = moments[1] / moments[0] ** 1.5 / 6
    return skew


def _bca(
    data: Sequence[Values],
    combine: Callable[[Sequence[Values]], Values],
    skew: Values,
    scales: Values,
    size: int,
    levels: Values,
) -> list[Interval]:
    """The intervals of the sums that `combine` makes of means, each times its scale; a resample has `size` values.

    `data` has an array [row, value] for every sample, `combine` takes their means as [row, resample] and returns
    [sum, resample]; `levels` are the normal quantiles of the sums' levels. Scores are discrete, so many resamples tie
    with the mean, and the correction of bias counts a tie half on either side. Sums of the same values in another order
    differ in their last digits: data come with values up to 1, and resampled figures are rounded, so that ties are
    ties.
    """

    def rounded(means: Sequence[Values]) -> Values:
        return np.round(combine(means), DIGITS)

    drawn = np.concatenate([rounded(means) for means in _resampled_means(data, max(1, BLOCK // size))], axis=1)
    drawn.sort(axis=1)
    estimate = rounded([_means(values, np.ones((1, values.shape[1]))) for values in data])
    intervals = []
    for row, mean, acceleration, scale, level in zip(drawn, estimate[:, 0], skew, scales, levels, strict=True):
        below, up_to = (int(np.searchsorted(row, mean, side)) for side in ("left", "right"))
        bias = NORMAL.inv_cdf((below / row.size + up_to / row.size) / 2)
        low, high = (_quantile(row, _corrected(bias, bias + away, acceleration)) for away in (-level, level))
        intervals.append((float(scale * low), float(scale * high)))
    return intervals


def _quantile(ordered: Values, share: float) -> np.float64:
    """The linearly interpolated quantile of sorted values: equal to that of `numpy.quantile`, which takes longer."""
    at = share * (ordered.size - 1)
    first = min(int(at), ordered.size - 1)
    low, high = ordered[first], ordered[min(first + 1, ordered.size - 1)]
    part = at - first
    quantile: np.float64 = low + (high - low) * part if part < 0.5 else high - (high - low) * (1 - part)
    return quantile


def _corrected(bias: float, shifted: float, acceleration: float) -> float:
    """The share of resamples below an end of a BCa interval."""
    room = 1 - acceleration * shifted
    return NORMAL.cdf(bias + shifted / room) if room > 0 else float(shifted > 0)


def _resampled_means(data: Sequence[Values], batch: int) -> Iterator[list[Values]]:
    """Yield the means of `RESAMPLES` resamples of every sample, `batch` at a time, as [row, resample].

    The rows of a sample are resampled together. How often each value was drawn is counted, and the means of all rows
    are one product with these counts: a separate mean for every row and resample takes several times as long.
    """
    rng = np.random.default_rng(SEED)
    for first in range(0, RESAMPLES, batch):
        resamples = min(batch, RESAMPLES - first)
        means = []
        for values in data:
            n = values.shape[1]
            drawn = rng.integers(n, size=(resamples, n)) + n * np.arange(resamples)[:, None]
            counts = np.bincount(drawn.ravel(), minlength=resamples * n).reshape(resamples, n)
            means.append(_means(values, counts.astype(float)))
        yield means


def _means(values: Values, counts: Values) -> Values:
    """The means of [row, value] in which each value occurs as often as [resample, value] says, as [row, resample]."""
    means: Values = values @ counts.T / values.shape[1]
    return means
