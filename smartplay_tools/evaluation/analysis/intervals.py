"""Means with bootstrap confidence intervals, which are always the same for the same episodes.

Everything that is estimated here is a weighted sum of means: the mean of one cell (one sample, weight 1), or a
capability score (one sample for each setting, weighted by its degree). Episodes are resampled within each sample, never
across settings, and the interval is bias-corrected and accelerated (BCa; Efron, "Better Bootstrap Confidence
Intervals", 1987), because scores of games are skewed and samples are small. It is the interval that
`scipy.stats.bootstrap` returns for the same seed, which a test compares. For means there is less to do, which counts at
ten thousand episodes: samples of the same size share their resamples, and the skewness has a closed form instead of
leaving out every episode once. An interval depends on the values alone: the generator has a fixed seed and the values
are sorted, so neither the workers nor the order of completion can change it.

If the bootstrap cannot estimate an interval, the `note` of the estimate says why.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
RESAMPLES = 10_000
"""Enough that with another seed the ends of an interval change by only a few hundredths of its width."""

SEED = 20_240_417
BLOCK = 200_000
"""Values drawn at once, few enough for a processor's cache, so that ten thousand episodes need little memory."""

DIGITS = 12
"""Digits to which resampled values are rounded (`_bca` says why)."""

Values = NDArray[np.float64]

Sample = tuple[float, ...]
"""Sorted values."""

ONE_EPISODE = "one episode has no interval"
ALL_EQUAL = "all episodes are equal, so the bootstrap sees no spread"


@dataclass(frozen=True)
class MeanEstimate:
    """A mean over episodes with its 95 % interval; `low` and `high` are None if that is unknown."""

    mean: float
    low: float | None
    high: float | None
    episodes: int
    note: str | None = None
    """The reason why the interval is missing or degenerate, if it is."""


def mean_estimate(values: Sequence[float]) -> MeanEstimate:
    """MeanEstimate the mean of a sample, which must not be empty."""
    return mean_estimates([values])[0]


def mean_estimates(samples: Sequence[Sequence[float]]) -> list[MeanEstimate]:
    """MeanEstimate the mean of every sample, each as if it were alone.

    Samples of the same size share the random numbers, whose drawing takes most of the time, so all statistics of a run
    are best computed in one call.
    """
    ordered = [_ordered(sample) for sample in samples]
    known = {sample: _plain_estimate(sample) for sample in ordered}
    sizes: dict[int, list[Sample]] = {}
    for sample, estimate in known.items():
        if estimate.note is None:
            sizes.setdefault(len(sample), []).append(sample)
    for alike in sizes.values():
        for sample, (low, high) in zip(alike, _intervals(alike), strict=True):
            known[sample] = replace(known[sample], low=low, high=high)
    return [known[sample] for sample in ordered]


_REMEMBERED = 4_096
_known_intervals: dict[bytes, tuple[float, float]] = {}
"""The intervals that were asked for before, by a digest of what they follow from: the tables and figures of a report
ask for the same ones again and again, and that of ten thousand episodes takes seconds."""


def _intervals(samples: Sequence[Sample]) -> list[tuple[float, float]]:
    """The intervals of the means of samples of the same size."""
    data = np.array(samples)

    def compute(which: list[int]) -> list[tuple[float, float]]:
        values = data[which]
        scales = np.abs(values).max(axis=1)
        scaled = values / scales[:, None]
        skew = _skew([scaled], np.ones((len(which), 1)))
        return _bca([scaled], lambda means: means[0], skew, scales, values.shape[1])

    return _remembered([_digest(values) for values in data], compute)


def _remembered(
    keys: Sequence[bytes], compute: Callable[[list[int]], list[tuple[float, float]]]
) -> list[tuple[float, float]]:
    """The intervals with these keys; `compute` is asked for those that are not known, by their positions."""
    found = {key: _known_intervals[key] for key in keys if key in _known_intervals}
    unknown = [at for at, key in enumerate(keys) if key not in found]
    if unknown:
        found.update(zip((keys[at] for at in unknown), compute(unknown), strict=True))
        if len(_known_intervals) > _REMEMBERED:
            _known_intervals.clear()
        _known_intervals.update(found)
    return [found[key] for key in keys]


def _digest(*parts: Values) -> bytes:
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(f"{part.shape}".encode())
        digest.update(part.tobytes())
    return digest.digest()


def named_estimates(groups: Iterable[Mapping[str, Sequence[float]]]) -> list[dict[str, MeanEstimate]]:
    """MeanEstimate the named samples of every group in one call; empty samples have no estimate."""
    groups = [{name: values for name, values in group.items() if values} for group in groups]
    found = iter(mean_estimates([values for group in groups for values in group.values()]))
    return [{name: next(found) for name in group} for group in groups]


def weighted_estimates(samples: Sequence[Sequence[float]], weightings: Sequence[Sequence[float]]) -> list[MeanEstimate]:
    """MeanEstimate, for every weighting, the sum of weight x mean over samples that are resampled independently.

    The samples are drawn once for all weightings. A sample of one episode has no spread: if it has
    a weight other than 0, there is no interval.
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
        (interval,) = _intervals([ordered[used[0]]])
        for at in regular:
            low, high = sorted(weightings[at][used[0]] * end for end in interval)
            estimates[at] = replace(estimates[at], low=low, high=high)
        return estimates
    data = [np.array(ordered[at]) for at in used]
    scale = max(np.abs(values).max() for values in data)
    weights = np.array([[weightings[each][at] for at in used] for each in regular])

    def compute(which: list[int]) -> list[tuple[float, float]]:
        chosen = weights[which]

        def total(means: Sequence[Values]) -> Values:
            return chosen @ np.concatenate(means)

        scaled = [values[None, :] / scale for values in data]
        return _bca(scaled, total, _skew(scaled, chosen), np.full(len(which), scale), sum(map(len, data)))

    intervals = _remembered([_digest(row, *data) for row in weights], compute)
    for at, (low, high) in zip(regular, intervals, strict=True):
        estimates[at] = replace(estimates[at], low=low, high=high)
    return estimates


def _ordered(sample: Sequence[float]) -> Sample:
    return tuple(sorted(map(float, sample)))


def _plain_estimate(sample: Sample) -> MeanEstimate:
    """The mean, and the interval if it needs no bootstrap."""
    return _weighted_estimate([sample], [1.0])


def _weighted_estimate(samples: Sequence[Sample], weights: Sequence[float]) -> MeanEstimate:
    """The weighted sum, with its interval only if that needs no bootstrap."""
    total = math.fsum(weight * math.fsum(sample) / len(sample) for sample, weight in zip(samples, weights, strict=True))
    episodes = sum(map(len, samples))
    weighed = [sample for sample, weight in zip(samples, weights, strict=True) if weight]
    if any(len(sample) == 1 for sample in weighed):
        return MeanEstimate(total, None, None, episodes, ONE_EPISODE)
    # Sums of floats differ by rounding: rewards that were added in another order still count as equal.
    rounding = 1e-9 * max(1.0, abs(total))
    if all(sample[-1] - sample[0] <= rounding for sample in weighed):
        return MeanEstimate(total, total, total, episodes, ALL_EQUAL)
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
    data: Sequence[Values], combine: Callable[[Sequence[Values]], Values], skew: Values, scales: Values, size: int
) -> list[tuple[float, float]]:
    """The intervals of the sums that `combine` makes of means, each times its scale; a resample has `size` values.

    `data` has an array [row, value] for every sample, `combine` takes their means as [row, resample] and returns
    [sum, resample]. Scores are discrete, so many resamples tie with the mean, and the correction of bias counts a tie
    half on either side. Sums of the same values in another order differ in their last digits: data come with values up
    to 1, and resampled figures are rounded, so that ties are ties.
    """

    def rounded(means: Sequence[Values]) -> Values:
        return np.round(combine(means), DIGITS)

    drawn = np.concatenate([rounded(means) for means in _resampled_means(data, max(1, BLOCK // size))], axis=1)
    estimate = rounded([_means(values, np.ones((1, values.shape[1]))) for values in data])
    below = ((drawn < estimate).mean(axis=-1) + (drawn <= estimate).mean(axis=-1)) / 2
    found = []
    for row, share, acceleration, scale in zip(drawn, below, skew, scales, strict=True):
        bias = _NORMAL.inv_cdf(share)
        shifted = (bias + _NORMAL.inv_cdf((1 + sign * CONFIDENCE) / 2) for sign in (-1, 1))
        low, high = np.quantile(row, [_NORMAL.cdf(bias + z / (1 - acceleration * z)) for z in shifted])
        found.append((float(scale * low), float(scale * high)))
    return found


_NORMAL = NormalDist()
"""The standard normal distribution, whose functions need no import of SciPy."""


def _resampled_means(data: Sequence[Values], batch: int) -> Iterator[list[Values]]:
    """Yield the means of `RESAMPLES` resamples of every sample, `batch` at a time, as [row, resample].

    The rows of a sample are resampled together. How often each value was drawn is counted, and the means of all rows
    are one product with these counts: a mean of its own for every row and resample takes several times as long.
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
