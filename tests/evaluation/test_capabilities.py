"""Capability scores: the paper's formula, and what is left out."""

from __future__ import annotations

import dataclasses

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.capabilities import capability_scores
from smartplay_tools.games import PAPER_RESULTS
from smartplay_tools.games.paper_tables import CAPABILITIES, PAPER_SETTINGS

BANDIT, RPS, HANOI = "BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"


def by_name(normalized):
    return {score.capability: score for score in capability_scores(normalized).scores}


def test_a_score_is_the_mean_weighted_by_degrees():
    """Reasoning: 1 at the bandit, 3 at Hanoi; understanding the odds: 3 and 1."""
    scores = by_name({BANDIT: [0.4, 0.6], HANOI: [1.0, 1.0]})
    assert tuple(scores) == CAPABILITIES
    assert scores["reasoning"].estimate.mean == pytest.approx((1 * 0.5 + 3 * 1) / 4)
    assert scores["understanding the odds"].estimate.mean == pytest.approx((3 * 0.5 + 1 * 1) / 4)


def test_a_human_scores_one_everywhere():
    human = {game: [PAPER_RESULTS[0].normalized[game]] * 2 for game in PAPER_SETTINGS}
    assert all(s.estimate.mean == pytest.approx(1) for s in capability_scores(human).scores)


def test_settings_without_a_normalised_score_are_left_out_and_named():
    capabilities = capability_scores({HANOI: [0.5, 1.0], "Hanoi4Disk-v0": [None, None]})
    assert capabilities.left_out == ("Hanoi4Disk-v0",)
    assert capabilities.settings == (HANOI,)
    assert capabilities.scores == capability_scores({HANOI: [0.5, 1.0]}).scores


def test_without_any_normalised_score_all_are_missing_with_a_reason():
    capabilities = capability_scores({"Hanoi4Disk-v0": [None]})
    assert all(score.estimate is None and "normalised" in score.reason for score in capabilities.scores)


def test_the_interval_draws_episodes_within_each_setting():
    """Two settings far apart, each without spread: their mean shows none, so that it has no interval."""
    score = by_name({BANDIT: [0.0, 0.0], HANOI: [1.0, 1.0]})["reasoning"].estimate
    assert (score.low, score.mean, score.all_equal, score.episodes) == (None, 0.75, True, 4)
    spread = by_name({BANDIT: [0.0, 0.0], HANOI: [0.0, 1.0]})["reasoning"].estimate
    assert (spread.low, spread.high) == (0, 0.75)


def test_a_setting_from_elsewhere_counts_if_it_is_rated():
    unrated = sp.register(dataclasses.replace(sp.GAMES[HANOI], id="Unrated-v0", challenges={}))
    alone = capability_scores({BANDIT: [0.4, 0.6]})
    assert capability_scores({BANDIT: [0.4, 0.6], unrated.id: [1.0, 1.0]}).left_out == ("Unrated-v0",)
    assert capability_scores({BANDIT: [0.4, 0.6], unrated.id: [1.0, 1.0]}).scores == alone.scores
    rated = sp.register(dataclasses.replace(unrated, challenges=sp.GAMES[HANOI].challenges))
    assert capability_scores({BANDIT: [0.4, 0.6], rated.id: [1.0, 1.0]}).scores != alone.scores
