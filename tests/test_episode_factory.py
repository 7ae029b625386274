"""Episodes for training: one configuration, many seeds."""

from __future__ import annotations

import pytest

import smartplay_tools as sp
from smartplay_tools.training import EpisodeFactory

GAME = "Hanoi3Disk-v0"


def test_episodes_differ_in_their_seeds_and_are_recorded_and_rewarded(tmp_path):
    factory = EpisodeFactory(GAME, budget=sp.Budget(history=3), records=tmp_path / "rollouts", manual="pinned")
    for seed, name in ((7, "a"), (7, None), (8, None)):
        with factory.episode(seed, name) as episode:
            assert episode.config == factory.config(seed)
            sp.play(episode, sp.get_player("rule"))
        assert factory.reward(episode) == 1.0
    records = sorted((tmp_path / "rollouts").glob("*.jsonl"))
    assert len(records) == 3
    assert records[1].name.startswith("7.")
    assert tmp_path / "rollouts" / "7.a.jsonl" in records
    assert all(sp.replay(record).identical for record in records)


@pytest.mark.parametrize("name", ["/../../elsewhere", "..\\elsewhere", "a/b", "a\0", "\ud800", "a" * 101])
def test_a_name_leads_to_no_other_folder(tmp_path, name):
    factory = EpisodeFactory(GAME, records=tmp_path / "rollouts" / "today")
    with pytest.raises(sp.InvalidArgumentError, match="The id of an episode is part of its record's name"):
        factory.episode(7, name)
    assert not list(tmp_path.iterdir())


def test_without_a_folder_nothing_is_recorded():
    factory = EpisodeFactory(GAME, reward="return")
    with factory.episode(7) as episode:
        assert not episode.ledger.is_recording
        assert [tool.name for tool in episode.tools] == [tool.name for tool in factory.tools]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"game": "Hanoi4Disk-v0"}, 'reward="score"'),
        ({"game": GAME, "reward": "best"}, "must be one of normalized, score, return"),
        ({"game": GAME, "manual": "aloud"}, "manual must be one of"),
    ],
)
def test_a_mistake_is_reported_before_anything_is_played(arguments, sentence):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        EpisodeFactory(**arguments)
