"""What a comparison shows, in one word; how many pairs it takes; and how often both are wrong, by simulation."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.decisions import Margin, decide, mde, pairs_needed, plan_pairs
from smartplay_tools.evaluation.analysis.planning import of_comparison, of_windows, plan
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.statistics.intervals import Bounds, Sample, mean_estimate
from tests.evaluation import simulations
from tests.evaluation.populations import BANDIT, HANOI, MESSENGER, RPS, tilted
from tests.evaluation.simulated_tables import NEAR, published
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
    assert pairs_needed(1.0001 * mde(1.0, n), 1.0, 0.8) == n


def test_a_pilot_that_tells_too_little_is_refused():
    assert plan_pairs(mean_estimate([1.0, 2.0] * 4), 1) == "8 pairs are too few to judge from; play 10"
    assert "no spread" in plan_pairs(mean_estimate([1.0] * 20), 1)


def test_a_plan_of_chains_is_one_of_their_trials():
    """As many chains of two trials as pairs of independent ones, where the means of the chains have their spread."""

    def planned(**facts):
        spreads = {"a": 0, "b": 3}
        length = facts.get("chain", 1)
        facts |= {"prompts": "1", "versions": {}}
        runs = {
            name: [row(seed=trial, score=20 + spread * (trial // length % 2), **facts) for trial in range(12 * length)]
            for name, spread in spreads.items()
        }
        (line,) = plan(of_comparison(compare(runs)), Margin(1))
        return line

    alone, chained = planned(), planned(carry="notes", chain=2)
    assert chained.needed.mde == alone.needed.mde
    assert (chained.contrast.pairs, chained.trials) == (24, tuple(2 * trials for trials in alone.trials))
    few = [
        row(score=trial, trial=trial, player=player, prompts="1", versions={})
        for player in ("a", "b")
        for trial in range(2)
    ]
    assert plan(of_comparison(compare({"run": few})), Margin(1))[0].reason.startswith("1 worlds are too few")


def swept(spreads, *, cost=0.01, n=12):
    """Rows of `rule` under full context and under windows whose scores differ from it by 0 or by this much."""
    generator = np.random.default_rng(1)
    rows = [row(seed=seed, score=20, history=50, tokens=900, cost=cost) for seed in range(n)]
    for history, spread in enumerate(spreads):
        scores = 20 + spread * generator.permutation(np.arange(n) % 2)
        rows += [row(seed=at, score=float(s), history=history, tokens=300, cost=cost) for at, s in enumerate(scores)]
    return rows


def test_the_plan_of_a_sweep_is_that_of_its_table():
    """It has the table's level, leaves controls out, and prices the trials of a cell and its reference."""
    rows = swept([2, 3, 4])
    control = [{**each, "player": "random", "score": each["score"] + each["seed"]} for each in rows]
    comparisons = compare_windows(rows + control)
    *lines, together = plan(of_windows(comparisons), Margin(3), comparisons[0].confidence)
    assert [line.contrast.name for line in lines] == ["history 0", "history 1", "history 2"]
    assert 1 - 0.05 < comparisons[0].confidence <= 1 - 0.05 / 3
    first = lines[0]
    assert first.trials == tuple(pairs_needed(3, first.needed.sd, p, comparisons[0].confidence) for p in (0.8, 0.9))
    assert first.trials[0] > pairs_needed(3, first.needed.sd, 0.8)
    assert first.tokens == tuple(1_200 * trials for trials in first.trials)
    assert first.cost == pytest.approx([0.02 * trials for trials in first.trials])
    assert together.trials[0] >= max(line.trials[0] for line in lines)
    assert together.tokens[0] == (900 + 3 * 300) * together.trials[0]


@pytest.mark.slow
def test_the_table_of_a_sweep_shows_a_difference_as_often_as_its_plan_says():
    """Of 400 sweeps of six windows with the planned trials, each line excludes 0 in 75 to 87 of 100."""
    generator, difference, sds = np.random.default_rng(2), 3.0, np.array([1.9, 2.2, 2.5, 2.8, 3.1, 3.7])
    level = bonferroni(len(sds)).confidence
    for sd in sds[[0, -1]]:
        n = pairs_needed(difference, sd, 0.8, level)
        own = difference + sd * generator.standard_normal((400, n))
        shown = [not e.low <= 0 <= e.high for e in (mean_estimate(v.tolist(), None, bonferroni(len(sds))) for v in own)]
        assert 0.73 <= np.mean(shown) <= 0.9


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


def test_a_run_that_is_named_twice_is_refused(tmp_path):
    for command in (["compare"], ["power", "--difference", "1"]):
        refused = CliRunner().invoke(app, [*command, str(tmp_path), str(tmp_path / ".." / tmp_path.name)])
        assert (refused.exit_code, refused.output.count("named twice")) == (2, 1)


@pytest.mark.slow
def test_the_commands(tmp_path):
    for name, past in (("long", 50), ("short", 1)):
        budget = sp.Budget(history=past)
        sp.evaluate([BANDIT], ["rule"], budgets=budget, trials=10, out=tmp_path / name, executor="inline")

    def run(*given):
        shown = CliRunner(env={"COLUMNS": "80"}).invoke(
            app, [*given[:1], str(tmp_path / "long"), str(tmp_path / "short"), *given[1:]]
        )
        assert shown.exit_code == 0
        return shown.output

    assert "different" in run("compare", "--margin", "0.1h")
    assert "MDE" in run("power", "--difference", "0.2")
    assert "\\toprule" in run("power", "--difference", "0.2", "--format", "latex")
    assert "needed_80%" in run("power", "--difference", "0.2", "--format", "csv")


# Simulations.


@pytest.mark.slow
@pytest.mark.parametrize("name", [*simulations.ALIKE][:1])
def test_the_page_says_how_often_a_word_is_wrong(name):
    """Two players that score alike are "different", and those that differ by the margin "equivalent".

    Of the fewest pairs of one row; `python -m tests.evaluation.simulated_tables` makes them all.
    """
    key, margin = simulations.ALIKE[name]
    wrong = simulations.wrong_words(simulations.against_itself(key), margin, simulations.WORD_SIZES[0])
    assert wrong == pytest.approx(published("words")[name][:2], abs=NEAR)
    assert max(wrong) <= 0.065  # 5 %, and three standard errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "difference"),
    [
        ((HANOI, "random", 50), 0.6),
        ((MESSENGER, "random", 3), 0.3),
        ((RPS, "random", 50), 2),
        ((BANDIT, "random", 50), 2),
    ],
)
def test_the_power_that_is_promised_is_had(cell, difference):
    """With the pairs that a difference needs for 80 %, Student's t sees it in 75 to 87 of 100 comparisons."""
    population = simulations.against_itself(cell)
    weights = tilted(population.values, difference)
    spread = np.sqrt(weights @ (population.values - difference) ** 2)
    samples = simulations.draw(population, pairs_needed(difference, spread, 0.8), 0, weights)
    seen = np.mean(scipy.stats.ttest_1samp(samples, 0, axis=1).pvalue < 0.05)
    assert 0.75 <= seen <= 0.87
