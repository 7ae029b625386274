"""Interrupted episodes continue from their records, with the same result as without an interruption."""

from __future__ import annotations

import logging

import pytest

import smartplay_tools as sp
from smartplay_tools.cli.runs import conclude
from tests.evaluation.players import FirstMoves, Moody
from tests.evaluation.runs import under_way

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


@pytest.mark.parametrize(("player", "count"), [("rule", 20), ("oracle", 2)])
def test_an_interrupted_run_has_the_bytes_of_one_that_was_not(tmp_path, player, count):
    """`count` lines of the record were left."""
    arguments = {"games": [BANDIT, HANOI], "players": [player], "trials": 2, "executor": "inline"}
    run = sp.evaluate(out=tmp_path, **arguments)
    whole = (tmp_path / "results.jsonl").read_bytes()
    for row in run.rows[::2]:
        under_way(tmp_path, row["key"], count)
    again = sp.evaluate(out=tmp_path, **arguments)
    assert again.complete
    assert (tmp_path / "results.jsonl").read_bytes() == whole
    for row in again.rows:
        assert sp.replay(run.folder.transcript(row["key"])).identical


def test_a_record_says_where_it_was_resumed_and_what_it_repeats_is_counted_once(tmp_path):
    arguments = {"games": [BANDIT], "players": ["random"], "trials": 1, "executor": "inline", "out": tmp_path}
    run = sp.evaluate(**arguments)
    before = run.spending
    under_way(tmp_path, run.rows[0]["key"])
    again = sp.evaluate(**arguments)
    events = sp.read_transcript(run.folder.transcript(run.rows[0]["key"]))
    (place,) = [at for at, event in enumerate(events) if event["event"] == "resume"]
    assert 0.4 < place / len(events) < 0.6
    assert again.spending.total.tokens == again.spending.results.tokens == before.total.tokens
    assert again.spending.other_attempts.replies == 0


def test_a_player_that_replies_differently_begins_anew_and_both_costs_are_shown(tmp_path):
    """Its state cannot be restored, because its replies depend on a file that has changed since."""
    mood = tmp_path / "mood"
    mood.write_text("1")
    arguments = {"games": [BANDIT], "players": {"moody": Moody}, "trials": 1, "executor": "inline"}
    arguments |= {"player_options": {"mood": str(mood)}, "out": tmp_path / "run"}
    run = sp.evaluate(**arguments)
    under_way(tmp_path / "run", run.rows[0]["key"])
    mood.write_text("2")
    again = sp.evaluate(**arguments)
    assert again.complete
    events = sp.read_transcript(run.folder.transcript(again.rows[0]["key"]))
    assert "resume" not in {event["event"] for event in events}
    assert 20 < again.spending.other_attempts.replies < 30
    assert again.spending.total.replies == 50 + again.spending.other_attempts.replies


def test_a_reply_on_record_whose_call_was_not_played_is_played_on(tmp_path, caplog):
    arguments = {"games": [BANDIT], "players": {"counts": Counting}, "trials": 1, "executor": "inline", "out": tmp_path}
    run = sp.evaluate(**arguments)
    key, whole = run.rows[0]["key"], (tmp_path / "results.jsonl").read_bytes()
    events = sp.read_transcript(run.folder.transcript(key))
    place = [at for at, event in enumerate(events) if event["event"] == "message"][25]
    under_way(tmp_path, key, place + 2)  # and its usage
    Counting.asked = 0
    assert sp.evaluate(**arguments).complete
    assert Counting.asked == 50 - 26
    assert (tmp_path / "results.jsonl").read_bytes() == whole
    assert "began again" not in caplog.text


REASON = "The record cannot be continued"


def test_an_episode_that_begins_again_says_why_once_for_a_run_and_is_counted(tmp_path, caplog, capsys):
    """Another comma in a recorded text, as another release might have written."""
    arguments = {"games": [BANDIT], "players": {"counts": Counting}, "trials": 2, "executor": "inline", "out": tmp_path}
    run = sp.evaluate(**arguments)
    for row in run.rows:
        _, left = under_way(tmp_path, row["key"])
        left.write_text(left.read_text().replace("Show the current observation again,", "Show the observation again"))
    Counting.asked = 0
    with caplog.at_level(logging.WARNING):
        again = sp.evaluate(**arguments)
    assert again.complete
    assert Counting.asked == 2 * 50
    [said] = [record.message for record in caplog.records if "began again" in record.message]
    assert REASON in said
    assert again.folder.beginnings() == {REASON: 2}
    assert again.status.began_again == 2
    assert "2 began again" in again.status.describe()
    assert again.rows == run.rows, "rows are the same for equal play"
    conclude(again)
    said = f"2 episodes began again instead of going on, and what was spent before is counted: {REASON} (2)."
    assert said in capsys.readouterr().err.splitlines()


class Counting(FirstMoves):
    """A player whose replies depend on its prompts alone, as a model's do; it counts its prompts."""

    serves_many = True
    asked = 0

    def before(self, prompt: sp.Prompt) -> None:
        Counting.asked += 1
