"""The settings agree with the paper's tables."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import UnknownNameError
from smartplay_tools.games import PAPER_RESULTS, get_spec
from smartplay_tools.games.messenger import rules
from smartplay_tools.games.paper_tables import CAPABILITIES, HUMAN_SCORES, MIN_SCORES, PAPER_SETTINGS, normalize

PLAYED = Path(__file__).parents[1] / "experiments" / "tools-v1"


def test_our_normalisation_turns_one_of_the_papers_tables_into_the_other():
    for row in PAPER_RESULTS:
        for setting in PAPER_SETTINGS:
            ours = normalize(row.raw[setting], HUMAN_SCORES[setting], MIN_SCORES[setting])
            assert ours == pytest.approx(row.normalized[setting], abs=0.0051), (row.player, setting)


def test_a_setting_that_no_human_played_has_no_normalised_score():
    assert sp.GAMES["Hanoi4Disk-v0"].normalize(4) is None
    assert sp.GAMES["Hanoi3Disk-v0"].normalize(3) == 1


def test_the_settings_are_the_papers_table():
    facts = {
        "bandit": (50, 50, 20, 2),
        "rock_paper_scissors": (50, 50, 20, 3),
        "hanoi": (30, 30, 10, 6),
    }
    for spec in sp.GAMES.values():
        if spec.family in facts:
            assert (spec.history, spec.rollout, spec.trials, len(spec.load().actions)) == facts[spec.family]


def test_every_setting_rates_the_nine_capabilities():
    for spec in sp.GAMES.values():
        assert tuple(spec.challenges) == CAPABILITIES
        assert all(1 <= degree <= 4 for degree in spec.challenges.values())


def test_no_recorded_score_leaves_its_bounds():
    files = PLAYED.glob("*/results.jsonl")
    rows = [json.loads(line) for path in files for line in path.read_text(encoding="utf-8").splitlines()]
    assert len({row["game"] for row in rows}) > 5
    for row in rows:
        spec = sp.GAMES[row["game"]]
        low, high = spec.score_bounds or (0, float("inf"))
        assert low <= row["score"] <= high
        assert not spec.two_valued or row["score"] in (low, high)


def test_at_level_3_three_things_can_touch_the_avatar_at_once():
    enemy, decoys, elsewhere = (4, 5), ((5, 4), (4, 4)), (14, 14)
    state = rules.State((enemy, elsewhere, elsewhere, *decoys), ("chaser",) * 5, (4, 4))
    outcome = rules.settle(state, 4, [rules.STAY] * 5)
    assert (outcome.reward, 1) == sp.GAMES["MessengerL3-v0"].score_bounds


def test_an_unknown_game_lists_near_names():
    with pytest.raises(UnknownNameError, match="did you mean Hanoi3Disk-v0"):
        get_spec("Hanoi3Disks-v0")
