"""The times beside a record: kept if asked for, outside of everything that is compared or hashed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.files.times import times_file
from smartplay_tools.records import Record
from smartplay_tools.transcript import keep_times, read_times

GAME = "RockPaperScissorBasic-v0"


@pytest.fixture
def keeping() -> Iterator[None]:
    stop = keep_times()
    yield
    stop()


def record_in(folder: Path, calls: int = 2) -> Path:
    path = folder / "one.jsonl"
    with sp.Episode(GAME, seed=1, budget=sp.Budget(tool_calls=calls), transcript=path) as episode:
        sp.play(episode, sp.get_player("rule"))
    return path


def test_a_record_says_how_long_each_reply_took(tmp_path, keeping):
    record = Record.read(record_in(tmp_path))
    assert record.seconds.keys() == record.replies.keys()
    assert all(seconds >= 0 for seconds in record.seconds.values())
    times_file(tmp_path / "one.jsonl").unlink()
    assert Record.read(tmp_path / "one.jsonl").seconds == {}


def test_the_record_is_the_same_with_and_without(tmp_path):
    plain = record_in(tmp_path / "plain").read_bytes()
    stop = keep_times()
    kept = record_in(tmp_path / "kept")
    stop()
    assert kept.read_bytes() == plain
    assert not list((tmp_path / "plain").glob("*.times"))
    assert sp.replay(kept).identical


def test_times_can_be_deleted_while_the_episode_is_played(tmp_path, keeping):
    record = tmp_path / "one.jsonl"
    with sp.Episode(GAME, seed=1, transcript=record) as episode:
        episode.call("act", {"action": "Rock"})
        times_file(record).unlink()
        episode.call("act", {"action": "Rock"})
    assert sp.replay(record).identical


def test_a_record_that_is_continued_has_the_times_of_both(tmp_path, keeping):
    record = record_in(tmp_path)
    *begun, _ = record.read_bytes().splitlines(keepends=True)  # as if it had been killed before its end
    record.write_bytes(b"".join(begun))
    before = read_times(record, len(begun) + 1)[: len(begun)]
    with sp.resume(record) as resumed:
        resumed.episode.end("closed")
    after = read_times(record, len(sp.read_transcript(record)))
    assert after[: len(before)] == before
    assert None not in after


def test_times_move_with_the_records_of_a_run(tmp_path, keeping):
    run = tmp_path / "run"
    sp.evaluate([GAME], ["rule"], trials=2, out=run, workers=1, executor="inline")
    records = sorted((run / "episodes").glob("*.jsonl"))
    assert len(records) == 2
    assert all(None not in read_times(record, len(sp.read_transcript(record))) for record in records)
    assert not list((run / "running").iterdir())


def test_times_of_another_record_are_refused(tmp_path, keeping):
    record = record_in(tmp_path)
    with pytest.raises(sp.SmartPlayError, match="does not hold the times"):
        read_times(record, 3)
