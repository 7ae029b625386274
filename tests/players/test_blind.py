"""The blind player: it replays a recorded episode, of another seed, whatever it is shown."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.blind import played_actions
from smartplay_tools.players import is_model
from smartplay_tools.records import Record

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("blind") / "run"
    played = sp.evaluate([BANDIT, HANOI], ["rule", "random"], trials=2, executor="inline", out=out)
    return out, played.rows


def best(rows, game, seed):
    return max((row for row in rows if row["game"] == game and row["seed"] != seed), key=lambda row: row["score"])


def test_it_replays_the_best_episode_of_another_seed(run, tmp_path):
    out, rows = run
    for game in (BANDIT, HANOI):
        seed = best(rows, game, None)["seed"]  # even on the seed of the very best one
        with sp.Episode(game, seed=seed, transcript=tmp_path / f"{game}.jsonl") as episode:
            result = sp.play(episode, sp.get_player(f"blind:{out}"))
        expected = best(rows, game, seed)
        replayed = played_actions(Record.read(out / "episodes" / f"{expected['key']}.jsonl"))
        actions = played_actions(Record.read(tmp_path / f"{game}.jsonl"))
        assert actions == (replayed * len(actions))[: len(actions)]
        assert "player" not in result.deviations  # it takes nothing from the game
    assert result.score == 3  # Hanoi is always the same


def test_it_plays_the_papers_protocol(run):
    out, _ = run
    with sp.Episode(HANOI, seed=7) as episode:
        assert sp.play(episode, sp.get_player(f"blind:{out}"), protocol="paper").score == 3


def test_it_is_not_a_model_and_plays_in_a_run(run, tmp_path):
    out, _ = run
    assert not is_model(f"blind:{out}")
    assert is_model("openai:blind")
    played = sp.evaluate([HANOI], [f"blind:{out}"], trials=2, executor="inline", out=tmp_path / "again")
    assert [row["score"] for row in played.rows] == [3, 3]


def test_what_cannot_be_replayed_is_refused(run, tmp_path):
    out, _ = run
    with pytest.raises(sp.InvalidArgumentError, match="There is no"):
        sp.get_player(f"blind:{tmp_path / 'nowhere'}")
    with sp.Episode("MessengerL1-v0", seed=0) as episode, pytest.raises(sp.InvalidArgumentError, match="no finished"):
        sp.play(episode, sp.get_player(f"blind:{out}"))
