"""How often intervals hold the truth: samples are drawn from the scores of 200 recorded episodes of our own players."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import pairs, repeats
from smartplay_tools.evaluation.analysis.decisions import decide
from smartplay_tools.evaluation.analysis.together import jointly
from smartplay_tools.games.specs import GAMES
from smartplay_tools.statistics.distributions import wilson
from smartplay_tools.statistics.intervals import Method, Sample, mean_estimate, mean_estimates, weighted_estimates

WRITTEN = json.loads((Path(__file__).parents[1] / "data" / "population_scores.json").read_text(encoding="utf-8"))
SCORES = {(each["game"], each["player"], each["history"]): np.array(each["scores"], dtype=float) for each in WRITTEN}
"""By game, player and past steps; those of one trial are of the same world."""

BANDIT, RPS, HANOI = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
MESSENGER = "MessengerL1-v0"
REPETITIONS = 2_000


def bounds(game):
    return pairs.bounds_of(pairs.score, GAMES[game])


def is_held(estimate, truth):
    return estimate.low is None or estimate.low - 1e-9 <= truth <= estimate.high + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("game", "player", "history", "n", "least"),
    [
        (BANDIT, "random", 50, 10, 0.94),
        (BANDIT, "rule", 50, 10, 0.8),  # rare total failures
        (BANDIT, "rule", 50, 50, 0.89),
        (RPS, "rule", 50, 20, 0.92),
        (HANOI, "random", 50, 5, 0.94),
        (MESSENGER, "random", 3, 20, 0.93),
        (MESSENGER, "rule", 0, 10, 0.94),
    ],
)
def test_the_interval_of_a_mean(game, player, history, n, least):
    values = SCORES[game, player, history]
    drawn = np.random.default_rng(0).choice(values, size=(REPETITIONS, n)).tolist()
    held = [is_held(mean_estimate(sample, bounds(game)), values.mean()) for sample in drawn]
    assert np.mean(held) >= least


@pytest.mark.parametrize(("n", "share", "held"), [(10, 0.1, 0.927), (20, 0.5, 0.959), (50, 0.98, 0.918)])
def test_the_interval_of_a_share(n, share, held):
    """Computed, not drawn: Wilson's interval of a share near 0 or 1 holds less often than it says."""
    holding = [k for k in range(n + 1) if wilson(k, n, 0.95)[0] <= share <= wilson(k, n, 0.95)[1]]
    chance = sum(math.comb(n, k) * share**k * (1 - share) ** (n - k) for k in holding)
    assert chance == pytest.approx(held, abs=0.004)


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 20])
def test_intervals_that_hold_together(n):
    """Differences of every cell of a game less its rule player's, by world: each by itself, too few hold together."""
    compared = [
        (values - SCORES[game, "rule", widest], bounds(game).of_differences)
        for game, widest in ((BANDIT, 50), (RPS, 50), (HANOI, 50), (MESSENGER, 3))
        for (name, player, _), values in SCORES.items()
        if (name, player) == (game, "random")
    ]

    def all_hold(seed, method):
        worlds = np.random.default_rng(seed).integers(200, size=n)
        samples = [Sample(values[worlds].tolist(), declared, range(n)) for values, declared in compared]
        estimates = mean_estimates(samples, method or jointly(samples, 300))
        return all(is_held(each, values.mean()) for each, (values, _) in zip(estimates, compared, strict=True))

    assert np.mean([all_hold(seed, None) for seed in range(150)]) >= 0.9
    assert np.mean([all_hold(seed, Method(bootstrap=False)) for seed in range(150)]) < 0.88


@pytest.mark.slow
def test_the_populations_are_what_the_players_score(tmp_path):
    budget = sp.Budget(history=3)
    run = sp.evaluate([MESSENGER], ["random", "rule"], budgets=budget, trials=2, out=tmp_path, executor="inline")
    for player in ("random", "rule"):
        played = [row["score"] for row in run.rows if row["player"] == player]
        assert SCORES[MESSENGER, player, 3][:2].tolist() == played


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 50])
def test_a_sum_over_settings(n):
    """A capability score."""
    keys = (BANDIT, "random", 50), (RPS, "rule", 50), (HANOI, "random", 50), (MESSENGER, "random", 3)
    scores = [SCORES[key] for key in keys]
    scales = [1 / (bounds(game).high - bounds(game).low) for game, *_ in keys]
    generator = np.random.default_rng(7)
    truth = sum(scale * values.mean() for scale, values in zip(scales, scores, strict=True))
    held = []
    for _ in range(500):
        samples = [generator.choice(values, size=n).tolist() for values in scores]
        held.append(is_held(*weighted_estimates(samples, [scales]), truth))
    assert np.mean(held) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize("worlds", [10, 50])
def test_repeats(worlds):
    """The mean of worlds, and pass^3, of a player that succeeds more often in some worlds than in others."""
    generator, held = np.random.default_rng(8), []
    for _ in range(REPETITIONS):
        successes = generator.binomial(5, generator.beta(2, 2, size=worlds))
        every = np.array([repeats.pass_all(int(count), 5, 3) for count in successes])
        _, low, high = repeats.by_worlds(every, lambda values: values.mean(axis=-1))
        mean = mean_estimate((successes / 5).tolist(), method=Method(bootstrap=False))
        held.append((low <= 2 * 3 * 4 / (4 * 5 * 6) <= high, mean.low <= 0.5 <= mean.high))
    least = {10: (0.86, 0.93), 50: (0.92, 0.93)}[worlds]
    assert np.all(np.mean(held, axis=0) >= least)


def test_no_episode_leaves_the_declared_bounds():
    for (game, *_), scores in SCORES.items():
        assert bounds(game).hold(tuple(sorted(scores.tolist())))


@pytest.mark.slow
def test_the_words_of_a_comparison_are_seldom_wrong():
    """Two players that score alike are "different", and two that differ by the margin "equivalent", in about 5 %."""
    values, margin = SCORES[HANOI, "random", 50], 0.5
    first, second = np.random.default_rng(0).choice(values, size=(2, REPETITIONS, 20))
    within = bounds(HANOI).of_differences

    def share(word, shift):
        return np.mean([decide(Sample([*each], within), margin).word == word for each in first - second + shift])

    assert share("different", 0) <= 0.065
    assert share("equivalent", margin) <= 0.065
