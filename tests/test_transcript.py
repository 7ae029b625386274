"""Transcripts: the recorded events, and their verification."""

from __future__ import annotations

import json
import random
import sys
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import TranscriptError
from smartplay_tools.files.growing_lines import GrowingLines
from smartplay_tools.records.prompts import recorded_turns
from smartplay_tools.records.replays import comparable
from smartplay_tools.transcript import lines as appended
from smartplay_tools.transcript.events import event_fault
from smartplay_tools.transcript.file import TranscriptWriter

GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0", "Hanoi3Disk-v0")
TIGHT = sp.Budget(prompt_tokens=700, slack=0.4)


@pytest.fixture
def path(tmp_path):
    """A transcript."""
    path = tmp_path / "episode.jsonl"
    with sp.Episode(GAMES[2], seed=11, budget=TIGHT, transcript=path) as episode:
        sp.play(episode, sp.get_player("rule"))
    return path


def line_by_line(written: bytes) -> list[dict] | None:
    """The events of a file; None if a line other than an incomplete last one is not an event."""
    events = []
    lines = written.splitlines(keepends=True)
    for number, line in enumerate(lines):
        try:
            event = json.loads(line)
        except ValueError:
            return events if 0 < number == len(lines) - 1 and not line.endswith(b"\n") else None
        if not isinstance(event, dict) or not isinstance(event.get("event"), str):
            return None
        events.append(event)
    return events if events and events[0]["event"] == "start" and events[0].get("format") == 1 else None


def test_a_damaged_record_is_read_line_by_line_or_refused(path):
    whole = path.read_bytes()
    chance = random.Random(4)
    read = 0
    for _ in range(50):
        place = chance.choice([chance.randrange(len(whole)), chance.choice(line_ends(whole))])
        put = chance.choice([b"", b"\n", b"}", b"{", b",", b'"', b" ", b"[1]\n", b"\xc3\xa9", b'\n{"event": "x"}\n'])
        damaged = whole[:place] + put + whole[place + chance.randrange(3) :]
        path.write_bytes(damaged)
        expected = line_by_line(damaged)
        if expected is None or any(map(event_fault, expected)):
            with pytest.raises(TranscriptError):
                sp.read_transcript(path)
        else:
            assert sp.read_transcript(path) == expected
            read += 1
    assert 5 < read < 45


def line_ends(written: bytes) -> list[int]:
    return [at for at, byte in enumerate(written) if byte == ord("\n")]


def test_a_line_is_on_disk_before_the_next_thing_happens(tmp_path):
    path = tmp_path / "running.jsonl"
    with sp.Episode(GAMES[0], seed=1, transcript=path) as episode:
        episode.call("act", {"action": "1"})
        assert [event["event"] for event in sp.read_transcript(path)] == ["start", "call"]


def test_no_line_is_read_in_two_parts_while_it_is_written(tmp_path):
    path, line = tmp_path / "growing.jsonl", json.dumps({"event": "call", "text": "x" * 200}).encode() + b"\n"

    def write() -> None:
        with path.open("wb", buffering=0) as file:
            for _ in range(4_000):
                file.write(line[:100])
                file.write(line[100:])

    growing, read = GrowingLines(path), []
    with ThreadPoolExecutor(1) as pool:
        writing = pool.submit(write)
        while not writing.done():
            read += growing.read()[0]
    read += growing.read()[0]
    assert read == [line] * 4_000


def test_a_record_is_never_overwritten(tmp_path):
    path = tmp_path / "kept.jsonl"
    sp.Episode(GAMES[0], seed=1, transcript=path).close()
    with pytest.raises(TranscriptError, match="never overwritten"):
        sp.Episode(GAMES[0], seed=1, transcript=path)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "does not begin with a start event"),
        ("hello", "line 1 is not JSON"),
        ("[1]\n", "line 1 is not an event"),
        ('{"event": "call"}\n', "does not begin with a start event"),
        ('{"event": "start"}\nbroken\n{"event": "end"}\n', "line 2 is not JSON"),
        ('{"event": "start"}\n', "has format None; this version of smartplay-tools reads format 1 only"),
        ('{"event": "start", "format": 2}\n', "has format 2"),
        ('{"event": "start", "format": 1}\n', "start event has no valid config"),
    ],
)
def test_what_is_no_transcript_is_told_in_one_sentence(tmp_path, content, sentence):
    path = tmp_path / "wrong.jsonl"
    path.write_text(content)
    with pytest.raises(TranscriptError, match=sentence):
        sp.replay(path)


def test_whatever_a_model_writes_is_kept_as_it_was(tmp_path):
    words = "a lone \ud800 surrogate, \u2028 a separator, \x00 a null, 愛, \r\n"
    path = tmp_path / "odd.jsonl"
    reply = {
        "role": "assistant",
        "content": words,
        "reasoning_content": "think",
        "provider_items": [{"type": "reasoning", "id": "r1", "summary": [{"text": "more"}]}],
        "tool_calls": [{"id": "", "type": "function", "function": {"name": words, "arguments": words}}],
    }
    with sp.Episode(GAMES[0], seed=1, transcript=path) as episode:
        conversation = sp.Conversation(episode)
        conversation.receive(reply)
        conversation.prompt()
    events = sp.read_transcript(path)
    assert next(e["message"] for e in events if e["event"] == "message") == reply
    assert next(e for e in events if e["event"] == "call")["arguments"] == words
    kept = recorded_turns(events)[0].assistant
    assert kept == conversation.turns[0].assistant
    assert kept["tool_calls"][0]["id"].isalnum(), "an id that the conversation gave"
    assert sp.replay(path).identical


def test_two_transcripts_are_equal_whatever_the_ids_and_the_spelling():
    def transcript(call_id: str, arguments: object, usage: sp.Usage | None) -> list:
        events: list = []
        function = {"name": "act", "arguments": arguments}
        with sp.Episode(GAMES[0], seed=1, transcript=events) as episode:
            conversation = sp.Conversation(episode)
            call = {"id": call_id, "type": "function", "function": function}
            conversation.receive(sp.Reply({"role": "assistant", "content": None, "tool_calls": [call]}, usage))
            conversation.prompt()
        return events

    one = transcript("call_1", '{"action":"1"}', None)
    other = transcript("toolu_2", {"action": "1"}, sp.Usage(prompt=3))
    assert comparable(one) == comparable(other)
    assert comparable(one) != comparable(transcript("call_1", '{"action":"2"}', None))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
def test_more_episodes_than_a_process_may_open_files(tmp_path, monkeypatch):
    import resource

    # Whatever else this process has open does not count.
    monkeypatch.setattr(appended, "_OPEN", OrderedDict())
    others = len(list(Path("/dev/fd").iterdir()))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(soft, others + 200), hard))
    try:
        writers = [TranscriptWriter(tmp_path / f"{number}.jsonl") for number in range(400)]
        for turn in range(2):
            for writer in writers:
                writer.append({"event": "start" if turn == 0 else "reveal", "turn": turn})
        for writer in writers:
            writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    records = {path.read_bytes() for path in tmp_path.iterdir()}
    assert len(records) == 1, "all were told the same"
    assert len(records.pop().splitlines()) == 2


@pytest.mark.slow
def test_threads_that_share_few_handles_lose_no_line(tmp_path, monkeypatch):
    monkeypatch.setattr(appended, "HANDLES", 3)
    monkeypatch.setattr(appended, "_OPEN", OrderedDict())
    writers = [TranscriptWriter(tmp_path / f"{number}.jsonl") for number in range(48)]

    def write(own: list[TranscriptWriter]) -> None:
        for turn in range(400):
            for writer in own:
                writer.append({"event": "reveal", "turn": turn})

    often, usual = 1e-5, sys.getswitchinterval()
    sys.setswitchinterval(often)
    try:
        with ThreadPoolExecutor(12) as threads:
            list(threads.map(write, [writers[first::12] for first in range(12)]))
    finally:
        sys.setswitchinterval(usual)
    assert len(appended._OPEN) == 3
    for writer in writers:
        writer.close()
    records = [path.read_bytes() for path in tmp_path.iterdir()]
    assert len(set(records)) == 1
    assert len(records[0].splitlines()) == 400


def test_a_record_that_was_moved_or_changed_meanwhile_is_not_written_on(tmp_path, monkeypatch):
    monkeypatch.setattr(appended, "HANDLES", 1)
    monkeypatch.setattr(appended, "_OPEN", OrderedDict())
    moved, changed, last = (TranscriptWriter(tmp_path / f"{name}.jsonl") for name in ("moved", "changed", "last"))
    for writer in (moved, changed, last):
        writer.append({"event": "start"})
    (tmp_path / "moved.jsonl").rename(tmp_path / "elsewhere.jsonl")
    with (tmp_path / "changed.jsonl").open("ab") as file:
        file.write(b"more\n")
    for writer, why in ((moved, "No such file"), (changed, "another program has changed it")):
        with pytest.raises(TranscriptError, match=why):
            writer.append({"event": "reveal"})
    last.close()
    assert not (tmp_path / "moved.jsonl").exists()
