"""The bandits, Rock Paper Scissors and Hanoi, against transcripts of the original."""

from __future__ import annotations

import hashlib
from collections import Counter
from itertools import product

import pytest

import smartplay_tools as sp
from smartplay_tools.games import bandit, rock_paper_scissors
from smartplay_tools.games.base import TextGame
from tests.games.recorded import MANUALS, ROWS, Rows, begin, episodes


def assert_replays(game: TextGame, rows: Rows) -> None:
    """Play a recorded episode's actions and compare every field that it has."""
    assert begin(game, rows) == rows[0]["obs"]
    assert hashlib.sha256(game.manual.encode()).hexdigest() == rows[0].get("manual_sha256", MANUALS[rows[0]["game"]])
    for row in rows[1:]:
        observation, reward, terminated, truncated, info = game.step(game.actions.index(row["action"]))
        assert (observation, reward, terminated) == (row["obs"], row["reward"], row["done"])
        assert not truncated
        assert info["score"] == row["score"]
        assert row["history"] in (info["history"], None)  # not every row records it
        assert info["completed"] == row.get("completed", 0)


@pytest.mark.parametrize(("name", "rows"), episodes())
def test_the_games_play_as_recorded(name, rows):
    # The original kept 5 steps of history in Hanoi; the paper's table says 30.
    assert_replays(sp.GAMES[name].make(**({"history": 5} if "Hanoi" in name else {})), rows)


def test_every_recorded_row_is_played():
    assert sum(len(rows) for _, rows in episodes()) == len(ROWS) == 277


def test_all_bandits_have_the_same_manual():
    manuals = {spec.make().manual for spec in sp.GAMES.values() if spec.family == "bandit"}
    assert len(manuals) == 1


@pytest.mark.parametrize("seed", range(12))
def test_the_rps_manual_tells_the_true_scores(seed):
    game = sp.GAMES["RockPaperScissorDifferentScore-v0"].make()
    game.reset(seed=seed)
    rock, paper, scissors = game._table.scores
    assert f"(Rock wins, score {rock})" in game.manual
    assert f"(Scissors win, score {scissors})" in game.manual
    assert f"(Paper wins, score {paper})" in game.manual
    for hand, other in product(range(3), repeat=2):
        reward = rock_paper_scissors.reward(game._table, hand, other)
        if (hand, other) in ((0, 2), (1, 0), (2, 1)):
            assert reward == game._table.scores[hand]
        elif hand != other:
            assert reward == -game._table.scores[other]
        else:
            assert reward == 0


def test_pairs_are_dealt_together_and_evenly():
    game = sp.GAMES["RockPaperScissorDifferentScore-v0"].make()
    deals = Counter()
    for seed in range(600):
        game.reset(seed=seed)
        deals[tuple(zip(game._table.probabilities, game._table.scores, strict=True))] += 1
    assert {tuple(sorted(deal)) for deal in deals} == {((0.3, 1), (0.3, 2), (0.4, 1))}
    assert len(deals) == 6
    assert min(deals.values()) > 60


def test_the_opponent_and_the_arms_keep_their_odds():
    game = sp.GAMES["RockPaperScissorBasic-v0"].make()
    game.reset(seed=4)
    hands = Counter(rock_paper_scissors.opponent_hand(game._table, game.np_random) for _ in range(20_000))
    for hand, probability in enumerate(game._table.probabilities):
        assert hands[hand] / 20_000 == pytest.approx(probability, abs=0.015)
    machine = sp.GAMES["BanditTwoArmedHighLowFixed-v0"].make()
    machine.reset(seed=4)
    wins = sum(bandit.pull(bandit.Arm(0.8, 1), machine.np_random) > 0 for _ in range(20_000))
    assert wins / 20_000 == pytest.approx(0.8, abs=0.015)


@pytest.mark.parametrize("disks", [3, 4])
def test_every_move_of_every_hanoi_state(disks):
    game = sp.GAMES[f"Hanoi{disks}Disk-v0"].make()
    for rod_of in product(range(3), repeat=disks):
        for action, (source, target) in enumerate(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))):
            game.reset(seed=0)
            game._rods = tuple(
                tuple(disk for disk in reversed(range(disks)) if rod_of[disk] == rod) for rod in range(3)
            )
            top = {rod: min((disk for disk in range(disks) if rod_of[disk] == rod), default=disks) for rod in range(3)}
            after = list(rod_of)
            if is_legal := top[source] < top[target]:
                after[top[source]] = target
            is_goal = after == [2] * disks and is_legal
            observation, reward, terminated, truncated, info = game.step(action)
            assert (reward, terminated, truncated) == (100 if is_goal else 0 if is_legal else -1, is_goal, False)
            assert [[disk in rod for rod in game._rods].index(True) for disk in range(disks)] == after
            if is_legal:
                assert (info["score"], info["completed"]) == (after.count(2), is_goal)
            assert observation in game.observation_space
