"""The settings agree with the paper's tables."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.games import PAPER_RESULTS
from smartplay_tools.games.messenger import rules
from smartplay_tools.games.paper_tables import CAPABILITIES, PAPER_SETTINGS

PLAYED = Path(__file__).parents[1] / "experiments" / "tools-v1"


SETTINGS = """
BanditTwoArmedDeterministicFixed-v0     50    50  20   2  111123211   0..50
BanditTwoArmedHighHighFixed-v0          50    50  20   2  111123211   0..50
BanditTwoArmedHighLowFixed-v0           50    50  20   2  111123211   0..50
BanditTwoArmedLowLowFixed-v0            50    50  20   2  111123211   0..50
RockPaperScissorBasic-v0                50    50  20   3  213123311   0..50
RockPaperScissorDifferentScore-v0       50    50  20   3  213123311   0..50
Hanoi3Disk-v0                           30    30  10   6  232311121   0..3
Hanoi4Disk-v0                           30    30  10   6  232311121   0..4
MessengerL1-v0                           2     4 100   5  312122112  -1..1
MessengerL2-v0                           2    64 100   5  322222112  -1..1
MessengerL3-v0                           2   128 100   5  322222112  -3..1
Crafter-v0                               5 10000  10  17  433332432   ..
""" + "".join(f"MinedojoCreative{task}-v0 2 200 20 4 112132123 0..1\n" for task in (0, 1, 2, 4, 5, 7, 8, 9))
"""The paper's settings: history, rollout, trials, actions, the degree of each capability, and the bounds of a score."""

DEGREES_OF = (
    "long text understanding, reasoning, instruction following, planning, generalization, understanding the odds, "
    "learning from interactions, error handling, spatial reasoning"
)

RESULTS_AT = (
    "BanditTwoArmedHighLowFixed RockPaperScissorBasic Hanoi3Disk MessengerL1 MessengerL2 Crafter MinedojoCreative0"
)
RESULTS = """
human             45    43    3   1     1      2680   1      1.00 1.00 1.00 1.00 1.00 1.00 1.00
GPT-4-0613        45.09 39.25 2.5 0.8   0.85   700    0.61   1.00 0.91 0.83 0.90 0.93 0.26 0.61
GPT-4-0314        43.86 42.05 2.7 0.74  0.93   845.6  0.592  0.97 0.98 0.90 0.87 0.97 0.32 0.59
text-davinci-003  46.92 17.0  1.5 0.24  -0.07  186.25 0.449  1.04 0.40 0.50 0.62 0.46 0.07 0.45
Claude            32.43 20.3  2   -0.12 0.2    143.3  0.5    0.72 0.47 0.67 0.44 0.60 0.05 0.50
Bard              38.85 12.9  2   0.22  -0.21  112.3  0.54   0.86 0.30 0.67 0.61 0.40 0.04 0.54
llama-2-13b       22.33 15.05 1.1 -0.76 -0.745 115.3  0.606  0.50 0.35 0.37 0.12 0.13 0.04 0.61
llama-13b         30.5  21.4  1   -0.68 -0.885 100.2  0.5    0.68 0.50 0.33 0.16 0.06 0.04 0.50
vicuna-13b        28.81 7.1   0.2 -1    -0.76  56.7   0.43   0.64 0.17 0.07 0.00 0.12 0.02 0.43
"""
"""The paper's two tables of results: seven mean scores of each player, and the same relative to a human's."""


def test_the_settings_are_the_papers_table():
    rows = []
    for spec in (spec for name, spec in sp.GAMES.items() if name in sp.GAMES.benchmark):
        assert tuple(spec.challenges) == CAPABILITIES == tuple(DEGREES_OF.split(", "))
        degrees = "".join(map(str, spec.challenges.values()))
        bounds = "..".join(map(str, spec.score_bounds or ("", "")))
        assert spec.make(history=0).is_slow == (spec.family == "minecraft")
        rows.append(f"{spec.id} {spec.history} {spec.rollout} {spec.trials} {spec.count_actions()} {degrees} {bounds}")
    assert rows == [" ".join(line.split()) for line in SETTINGS.strip().splitlines()]


def test_the_odds_of_the_bandits_and_of_rock_paper_scissors_are_the_papers():
    odds = {
        "BanditTwoArmedDeterministicFixed-v0": [1, 0],
        "BanditTwoArmedHighHighFixed-v0": [0.8, 0.9],
        "BanditTwoArmedHighLowFixed-v0": [0.8, 0.2],
        "BanditTwoArmedLowLowFixed-v0": [0.1, 0.2],
    }
    for name, probabilities in odds.items():
        assert [list(arm) for arm in sp.GAMES[name].kwargs["arms"]] == [[odd, 1] for odd in probabilities]
    assert sp.GAMES["RockPaperScissorBasic-v0"].kwargs == {"probabilities": (0.2, 0.2, 0.6), "scores": (1, 1, 1)}
    assert sp.GAMES["RockPaperScissorDifferentScore-v0"].kwargs == {
        "probabilities": (0.3, 0.3, 0.4),
        "scores": (1, 2, 1),
    }


def test_the_results_are_the_papers_two_tables_and_our_normalisation_turns_one_into_the_other():
    rows = [line.split() for line in RESULTS.strip().splitlines()]
    assert tuple(f"{name}-v0" for name in RESULTS_AT.split()) == PAPER_SETTINGS
    assert [row.player for row in PAPER_RESULTS] == [row[0] for row in rows]
    for result, (_, *numbers) in zip(PAPER_RESULTS, rows, strict=True):
        assert [*result.raw.values(), *result.normalized.values()] == list(map(float, numbers))
        for setting in PAPER_SETTINGS:
            ours = sp.GAMES[setting].normalize(result.raw[setting])
            assert ours == pytest.approx(result.normalized[setting], abs=0.0051), (result.player, setting)
    assert sp.GAMES["Hanoi4Disk-v0"].normalize(4) is None  # no human has played it


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
