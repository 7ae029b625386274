"""Simulations of intervals and words, from which the tables of docs/metrics.md are made (`simulated_tables`).

Each figure is a share of samples, 10,000 in the page and 2,000 in the tests, that are drawn with replacement from the
scores of 200 episodes of our own players (`populations`), or from a worst case. The mean of the 200 is the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from smartplay_tools.evaluation.analysis.decisions import decide
from smartplay_tools.evaluation.analysis.together import jointly
from smartplay_tools.statistics.distributions import Values
from smartplay_tools.statistics.intervals import Bounds, Method, Sample, mean_estimate, mean_estimates
from tests.evaluation.populations import BANDIT, HANOI, MESSENGER, RPS, bounds, scores, shuffled_differences, tilted

REPETITIONS = 2_000
SIZES = (5, 10, 20, 50)

USUAL, EXACT = Method(), Method(exact=True)
SHARE = Bounds(0, 1, two_valued=True)


@dataclass(frozen=True)
class Population:
    """What samples are drawn from."""

    values: Values
    bounds: Bounds | None


def draw(population: Population, n: int, seed: int, weights: Values | None = None) -> Values:
    """Samples of `n`, as [sample, value]."""
    return np.random.default_rng(seed).choice(population.values, size=(REPETITIONS, n), p=weights)


def estimated(samples: Values, declared: Bounds | None, method: Method) -> Values:
    """The intervals of samples, as [sample, end]; what has no interval is NaN."""
    estimates = (mean_estimate(values, declared, method) for values in samples.tolist())
    return np.array([(each.low, each.high) for each in estimates], dtype=float)


def holds(ends: Values, truth: float) -> Values:
    """Which intervals hold the truth; none at all holds everything."""
    return ~((ends[:, 0] > truth + 1e-9) | (ends[:, 1] < truth - 1e-9))


def coverage(population: Population, method: Method = USUAL) -> tuple[float, ...]:
    """The share of samples of each size whose interval holds the population's mean."""
    truth = float(population.values.mean())
    return tuple(
        float(holds(estimated(draw(population, n, 0), population.bounds, method), truth).mean()) for n in SIZES
    )


# Populations.


def cell(game: str, player: str, history: int) -> Population:
    """The scores of a player."""
    return Population(scores()[game, player, history], bounds(game))


def paired(game: str, first: tuple[str, int], second: tuple[str, int]) -> Population:
    """The differences of two players, world by world."""
    own = scores()
    return Population(own[(game, *first)] - own[(game, *second)], bounds(game).of_differences)


def share(chance: float) -> Population:
    """Successes with this probability."""
    return Population((np.arange(200) < round(200 * chance)).astype(float), SHARE)


def shares(first: float, second: float) -> Population:
    """Differences of successes: the first alone succeeds with one probability, and the second with the other."""
    counts = [round(200 * first), round(200 * second)]
    return Population(np.repeat([1.0, -1.0, 0.0], [*counts, 200 - sum(counts)]), SHARE.of_differences)


def intervals() -> Mapping[str, tuple[Population, Method]]:
    """The cases of the table of intervals."""
    usual = {
        "bandit, `random`": cell(BANDIT, "random", 50),
        "bandit, `rule` with 10 past steps": cell(BANDIT, "rule", 10),
        "bandit, `rule` with 50: rare total failures": cell(BANDIT, "rule", 50),
        "Rock Paper Scissors, `rule`": cell(RPS, "rule", 50),
        "Hanoi, `random`": cell(HANOI, "random", 50),
        "MESSENGER level 1, `random`": cell(MESSENGER, "random", 3),
        "MESSENGER level 1, `rule` without a past": cell(MESSENGER, "rule", 0),
        "one of 200 scores -1, the others 1": Population(np.repeat([1.0, -1.0], [199, 1]), Bounds(-1, 1)),
        "bandit, `rule` less `random`": paired(BANDIT, ("rule", 50), ("random", 50)),
        "bandit, 10 past steps less 50": paired(BANDIT, ("rule", 10), ("rule", 50)),
        "Rock Paper Scissors, 10 past steps less 50": paired(RPS, ("rule", 10), ("rule", 50)),
        "MESSENGER level 1, no past less 3 steps": paired(MESSENGER, ("rule", 0), ("rule", 3)),
    }
    cases = {name: (population, USUAL) for name, population in usual.items()}
    for chance in (0.02, 0.1, 0.5, 0.98):
        cases[f"share {chance:g}, Wilson"] = share(chance), USUAL
    for chance in (0.02, 0.1, 0.5, 0.98):
        cases[f"share {chance:g}, Clopper and Pearson"] = share(chance), EXACT
    for wins, losses in ((0.0, 0.02), (0.02, 0.02), (0.3, 0.1), (0.5, 0.5), (0.0, 0.98)):
        cases[f"pairs won {wins:g}, lost {losses:g}, Tango"] = shares(wins, losses), USUAL
    return cases


# Intervals that hold together.

JOINT_SIZES = (5, 10, 20)


def families() -> Mapping[str, list[tuple[Values, Bounds]]]:
    """Differences that are compared together: every cell less its game's last one, by world."""
    regular, all_cells = [], []
    for game, last in ((BANDIT, 50), (RPS, 50), (HANOI, 50), (MESSENGER, 3)):
        own = {key[1:]: values for key, values in scores().items() if key[0] == game}
        for key, values in own.items():
            if key != ("rule", last):
                compared = (values - own["rule", last], bounds(game).of_differences)
                all_cells.append(compared)
                if key[0] == "random":
                    regular.append(compared)
    return {"`random` less `rule`": regular, "these and `rule` with another window": all_cells}


def held_together(compared: Sequence[tuple[Values, Bounds]], n: int, seed: int, method: Method | None) -> bool:
    """Whether all intervals of a sample of worlds hold; without a method, at the level of max-T."""
    worlds = np.random.default_rng(seed).integers(200, size=n)
    samples = [Sample(values[worlds].tolist(), declared, range(n)) for values, declared in compared]
    ends = [(each.low, each.high) for each in mean_estimates(samples, method or jointly(samples, 300))]
    truths = np.array([values.mean() for values, _ in compared])
    return bool(np.all(holds(np.array(ends, dtype=float), truths)))


def joint(repetitions: int | None = None) -> Mapping[str, tuple[float, ...]]:
    """How often all intervals of a sweep hold, each by itself and together by max-T."""
    figures = {}
    for name, compared in families().items():
        for words, method in (("each of 95 %", Method(bootstrap=False)), ("by max-T", None)):
            figures[f"{name}: {len(compared)} intervals, {words}"] = tuple(
                float(np.mean([held_together(compared, n, seed, method) for seed in range(repetitions or REPETITIONS)]))
                for n in JOINT_SIZES
            )
    return figures


# Words.

ALIKE = {
    "Hanoi, `random`": ((HANOI, "random", 50), 0.5),
    "MESSENGER level 1, `random`": ((MESSENGER, "random", 3), 0.4),
    "Rock Paper Scissors, `random`": ((RPS, "random", 50), 5.0),
    "bandit, `random`": ((BANDIT, "random", 50), 3.0),
    "bandit, `rule`: rare total failures": ((BANDIT, "rule", 50), 3.0),
}
"""Players that are compared with themselves in other worlds, and a margin."""

WORD_SIZES = (10, 20, 50)


def against_itself(key: tuple[str, str, int]) -> Population:
    """The differences of two players that score alike."""
    return Population(shuffled_differences(scores()[key]), bounds(key[0]).of_differences)


def wrong_words(population: Population, margin: float, n: int) -> tuple[float, float]:
    """How often players that score alike are "different", and those that differ by the margin "equivalent"."""

    def words(truth: float) -> list[str]:
        drawn = draw(population, n, 0, tilted(population.values, truth)).tolist()
        return [decide(Sample(each, population.bounds), margin).word for each in drawn]

    different = np.mean([word.startswith("different") for word in words(0)])
    equivalent = np.mean([word in ("equivalent", "different, but less") for word in words(margin)])
    return float(different), float(equivalent)


def words() -> Mapping[str, tuple[float, ...]]:
    """The errors of the words, for every number of pairs."""
    return {
        name: tuple(error for n in WORD_SIZES for error in wrong_words(against_itself(key), margin, n))
        for name, (key, margin) in ALIKE.items()
    }
