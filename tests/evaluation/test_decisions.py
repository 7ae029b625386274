"""What a comparison shows, in one word; the difference it would have seen; and how often both are wrong."""

from __future__ import annotations

import json

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.decisions import Margin, decide, mde
from smartplay_tools.statistics.intervals import Bounds, Sample
from tests.evaluation.command import run
from tests.evaluation.window_rows import row

SMALL = Sample([0.5, -0.5] * 50)


def words(values, margin, bounds=None):
    return decide(Sample(values, bounds), margin).word


def test_the_words():
    assert words([3.0, 5.0] * 10, 2) == "different"
    assert words(SMALL.values, 0.2) == "equivalent"
    assert words(SMALL.values, 0.05) == "undecided"
    assert words([0.2, 0.3] * 20, 2) == "different, but less"


def test_what_is_undecided_has_the_difference_that_would_have_been_seen():
    assert decide(SMALL, 0.05).mde == pytest.approx(0.142, abs=0.001)


def test_equal_pairs_are_equivalent_only_within_what_their_number_excludes():
    """Twenty ties of scores between -1 and 1 exclude a mean difference of 0.28 or more."""
    bounds = Bounds(-1, 1).of_differences
    assert words([0.0] * 20, 0.2, bounds) == "undecided"
    assert words([0.0] * 20, 0.3, bounds) == "equivalent"
    assert words([0.0] * 20, 100) == "undecided"  # no bounds are declared


def test_a_margin_is_in_points_or_in_human_scores():
    assert Margin.parse("0.5").points("Hanoi3Disk-v0") == 0.5
    assert Margin.parse("0.1h").points("MessengerL1-v0") == pytest.approx(0.2)  # from -1 to 1
    for wrong in ("0", "-1", "0.1x", ""):
        with pytest.raises(sp.InvalidArgumentError, match="is not a difference"):
            Margin.parse(wrong)
    with pytest.raises(sp.InvalidArgumentError, match="has no human score"):
        Margin.parse("0.1h").points("Hanoi4Disk-v0")


def test_every_pairing_has_a_verdict():
    facts = {"prompts": "0", "versions": {}}
    runs = {
        "a": [row(seed=seed, score=20, **facts) for seed in range(20)],
        "b": [row(seed=seed, score=22 + seed % 2, **facts) for seed in range(20)],
    }
    (pairing,) = compare(runs, margin=Margin(1)).pairings
    assert pairing.verdict.word == "different"
    assert compare(runs).pairings[0].verdict is None


@pytest.mark.parametrize(("n", "expected"), [(5, 1.68), (10, 1.00), (20, 0.66), (50, 0.40), (100, 0.28), (200, 0.20)])
def test_the_smallest_difference_that_is_seen(n, expected):
    assert mde(1.0, n) == pytest.approx(expected, abs=0.005)


def test_losing_as_much_in_every_world_is_no_null_and_playing_alike_is_identical():
    bounds = Bounds(-50, 50, paired=True)
    assert words([-27.0] * 8, 3, bounds) == "different"
    assert words([-27.0] * 5, 3, bounds) == "undecided"  # p 0.06
    facts = {"prompts": "0", "versions": {}}
    runs = {name: [row(seed=at, play_sha256=f"{at}", **facts) for at in range(12)] for name in ("a", "b")}
    (pairing,) = compare(runs, margin=Margin(3)).pairings
    assert (pairing.is_identical, pairing.verdict.word) == (True, "identical")
    runs["b"][0]["play_sha256"] = "other"
    (pairing,) = compare(runs, margin=Margin(3)).pairings
    assert (pairing.is_identical, pairing.verdict.word) == (False, "undecided")


def test_the_command_line_has_the_verdict_and_the_difference_that_would_have_been_seen(tmp_path):
    given = {"trials": 4, "budgets": sp.Budget(tool_calls=5), "executor": "inline"}
    for player in ("random", "always:1"):
        sp.evaluate(["RockPaperScissorBasic-v0"], [player], out=tmp_path / player[:6], **given)
    command = ("compare", tmp_path / "random", tmp_path / "always", "--margin", "0.1h")
    (pairing,) = json.loads(run(*command, "--format", "json")[1])["pairings"]
    assert pairing["verdict"] == {"word": "undecided", "margin": 4.3, "mde": pytest.approx(5.76, abs=0.01)}
    code, table, _ = run(*command)
    assert (code, "undecided, MDE 5.8" in table) == (0, True)
