"""How often intervals hold the truth, by simulation: the page's figures, and what has no table there."""

from __future__ import annotations

import numpy as np
import pytest

from smartplay_tools.evaluation.analysis import pairs, repeats
from smartplay_tools.games.specs import GAMES
from smartplay_tools.statistics import intervals
from smartplay_tools.statistics.intervals import weighted_estimates
from tests.evaluation import populations, simulations
from tests.evaluation.populations import BANDIT, HANOI, MESSENGER, RPS
from tests.evaluation.simulated_tables import agrees, published
from tests.evaluation.simulations import REPETITIONS


@pytest.mark.slow
@pytest.mark.parametrize("name", [*simulations.intervals()][::6])
def test_the_page_says_how_often_an_interval_holds(name):
    """Of every sixth row; `python -m tests.evaluation.simulated_tables` makes them all, which takes minutes."""
    assert agrees("coverage", name, simulations.coverage(*simulations.intervals()[name]))


@pytest.mark.slow
def test_the_page_says_how_often_intervals_hold_together():
    figures, pages = simulations.joint(repetitions=150), published("together")
    assert figures.keys() == pages.keys()
    assert all(agrees("together", name, own, near=0.08) for name, own in figures.items())
    assert all(min(own) >= 0.92 for name, own in pages.items() if "max-T" in name)


@pytest.mark.slow
@pytest.mark.parametrize("history", [3, 50])
def test_populations_are_what_the_players_score(tmp_path, history):
    recorded = populations.scores()
    for cell, played in populations.play(tmp_path, history, trials=2, executor="inline").items():
        assert recorded[cell][:2].tolist() == played


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 50])
def test_a_sum_over_settings(n):
    """A capability score."""
    keys = (BANDIT, "random", 50), (RPS, "rule", 50), (HANOI, "random", 50), (MESSENGER, "random", 3)
    scores = [populations.scores()[key] for key in keys]
    scales = [1 / (populations.bounds(game).high - populations.bounds(game).low) for game, *_ in keys]
    generator, held = np.random.default_rng(7), []
    truth = sum(scale * values.mean() for scale, values in zip(scales, scores, strict=True))
    for _ in range(500):
        samples = [generator.choice(values, size=n).tolist() for values in scores]
        (estimate,) = weighted_estimates(samples, [scales])
        held.append(estimate.low is None or estimate.low <= truth <= estimate.high)
    assert np.mean(held) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize("worlds", [10, 50])
def test_repeats(worlds):
    """The mean of worlds, and pass^3, of a player that succeeds more often in some worlds than in others."""
    generator, held = np.random.default_rng(8), []
    for _ in range(REPETITIONS):
        chances = generator.beta(2, 2, size=worlds)
        successes = generator.binomial(5, chances)
        every = np.array([repeats.pass_all(int(count), 5, 3) for count in successes])
        _, low, high = repeats.by_worlds(every, lambda values: values.mean(axis=-1))
        mean = intervals.mean_estimate((successes / 5).tolist(), method=intervals.Method(bootstrap=False))
        held.append((low <= 2 * 3 * 4 / (4 * 5 * 6) <= high, mean.low <= 0.5 <= mean.high))
    least = {10: (0.86, 0.93), 50: (0.92, 0.93)}[worlds]
    assert np.all(np.mean(held, axis=0) >= least)


@pytest.mark.slow
def test_no_episode_leaves_the_declared_bounds():
    for (game, *_), scores in populations.scores().items():
        assert populations.bounds(game).hold(tuple(sorted(scores.tolist())))
        assert pairs.bounds_of(pairs.score, GAMES[game]) == populations.bounds(game)
