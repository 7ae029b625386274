"""Records: every change of one is found, every released format is read, and an episode continues from its own."""

from __future__ import annotations

import copy
import dataclasses
import json
import re
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.errors import TranscriptError
from smartplay_tools.players import get_player
from smartplay_tools.records import Record, driver
from smartplay_tools.transcript import EVENTS, FORMAT, TranscriptWriter
from smartplay_tools.types import ToolCall
from tests import scripts

RPS, HANOI = "RockPaperScissorBasic-v0", "Hanoi3Disk-v0"
FORMATS = sorted((Path(__file__).parent / "data" / "records").glob("format-*.jsonl"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> list[dict[str, Any]]:
    """A record with every kind of event that a conversation can have."""
    path = tmp_path_factory.mktemp("records") / "episode.jsonl"
    budget = sp.Budget(prompt_tokens=700, history=2)
    with sp.Episode(RPS, seed=11, budget=budget, transcript=path) as episode:
        conversation = sp.Conversation(episode, player="p", foreign_tools=[scripts.NOTE])
        for number in range(6):
            conversation.prompt()
            function = {"name": "act", "arguments": json.dumps({"action": str(number % 4)})}
            calls = [{"id": "same", "type": "function", "function": function}]
            if number == 1:
                note = {"name": "note", "arguments": "{}"}
                calls.append({"id": "n", "type": "function", "function": note})
            usage = sp.Usage(prompt=100 + number, reply=20)
            message = {"role": "assistant", "content": f"Number {number}.", "reasoning_content": "Because."}
            conversation.receive(sp.Reply({**message, "tool_calls": calls} if number != 3 else message, usage))
            if number == 1:
                conversation.add({"role": "tool", "tool_call_id": "n", "content": "noted"})
            conversation.spend(sp.Usage(prompt=7))
        conversation.add({"role": "user", "content": "Go on."})
    return sp.read_transcript(path)


def write(path: Path, events: list[Any]) -> Path:
    path.write_text("".join(json.dumps(event) + "\n" for event in events), encoding="ascii")
    return path


def leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of everything in an event that can be changed by itself."""
    if isinstance(value, dict) and value:
        return [path, *(leaf for key, item in value.items() for leaf in leaves(item, (*path, key)))]
    if isinstance(value, list) and value:
        return [path, *(leaf for at, item in enumerate(value) for leaf in leaves(item, (*path, at)))]
    return [path]


def changed(event: dict[str, Any], path: tuple[Any, ...], *, remove: bool = False) -> dict[str, Any]:
    event = copy.deepcopy(event)
    *way, last = path
    inner: Any = event
    for key in way:
        inner = inner[key]
    if remove:
        del inner[last]
        return event
    old = inner[last]
    inner[last] = old + 1 if type(old) in (int, float) else not old if isinstance(old, bool) else [old, 1]
    return event


def is_noticed(path: Path) -> bool:
    """Whether a replay finds a difference, or refuses the record in one sentence."""
    try:
        return not sp.replay(path).identical
    except sp.SmartPlayError as error:
        return "\n" not in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("remove", [False, True], ids=["changed", "removed"])
def test_every_change_of_a_single_field_is_found(recorded, tmp_path, remove):
    """Usage, ids, versions and reasoning included: nothing in a record is free. Together over 1,100 changes."""
    tried = 0
    for at, event in enumerate(recorded):
        for path in leaves(event)[1:]:
            events = [*recorded[:at], changed(event, path, remove=remove), *recorded[at + 1 :]]
            assert is_noticed(write(tmp_path / "changed.jsonl", events)), (event["event"], path)
            tried += 1
    assert tried >= 550


def test_every_change_of_the_order_is_found(recorded, tmp_path):
    path = tmp_path / "moved.jsonl"
    for at in range(len(recorded) - 1):
        swapped = [*recorded[:at], recorded[at + 1], recorded[at], *recorded[at + 2 :]]
        missing, doubled = recorded[:at] + recorded[at + 1 :], [*recorded[: at + 1], *recorded[at:]]
        assert is_noticed(write(path, (swapped, missing, doubled)[at % 3])), at


@pytest.fixture(scope="module")
def full() -> list[dict[str, Any]]:
    """A record with messages of several calls, notes and summaries."""
    events: list[dict[str, Any]] = []
    budget = sp.Budget(prompt_tokens=700, slack=0.5, history=3, notes_tokens=20, summary_tokens=20)
    with sp.Episode(HANOI, seed=2, budget=budget, transcript=events) as episode:
        sp.play(episode, get_player("rule-notes"))
    return [{name: value for name, value in event.items() if name != "chain"} for event in events]


def replaced(event: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    event = copy.deepcopy(event)
    inner: Any = event
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return event


@pytest.fixture(scope="module")
def called() -> list[dict[str, Any]]:
    """A record of calls without a conversation, several to a turn."""
    events: list[dict[str, Any]] = []
    with sp.Episode(HANOI, seed=2, transcript=events) as episode:
        episode.call_batch([ToolCall("observe", {}), ToolCall("act", {"action": "1"})])
        episode.call_batch([ToolCall("act", {"action": "2"}), ToolCall("act", "{")])
    return [{name: value for name, value in event.items() if name != "chain"} for event in events]


@pytest.fixture(scope="module")
def on_paper() -> list[dict[str, Any]]:
    """A record of the paper's protocol."""
    events: list[dict[str, Any]] = []
    with sp.Episode(RPS, seed=2, transcript=events) as episode:
        sp.play(episode, get_player("rule"), protocol="paper")
    return [{name: value for name, value in event.items() if name != "chain"} for event in events]


@settings(deadline=None, derandomize=True, database=None)
@given(st.data())
def test_whatever_is_done_to_a_record_replay_finds_differences(recorded, full, called, on_paper, data):
    """Only a record that does not say which episode it is, and a line that is not an event, are refused."""
    whole = data.draw(st.sampled_from([recorded, full, called, on_paper]))
    events = list(whole)
    values = st.sampled_from([None, "", -1, 0, 10**30, 0.5, True, [], {}, [[]], "act", float("nan"), {"event": "call"}])
    for _ in range(data.draw(st.integers(1, 3))):
        at, other = (data.draw(st.integers(0, len(events) - 1)) for _ in range(2))
        match data.draw(st.sampled_from(["swap", "remove", "double", "replace", "replace", "delete"])):
            case "swap":
                events[at], events[other] = events[other], events[at]
            case "remove" if len(events) > 1:
                del events[at]
            case "double":
                events.insert(other, events[at])
            case "replace":
                path = data.draw(st.sampled_from(leaves(events[at])[1:]))
                events[at] = replaced(events[at], path, data.draw(values))
            case "delete":
                events[at] = changed(events[at], data.draw(st.sampled_from(leaves(events[at])[1:])), remove=True)
    if events[0] == whole[0] and all(isinstance(event.get("event"), str) for event in events):
        sp.replay(events)
    else:
        replay_or_sentence(events)


def replay_or_sentence(events: list[dict[str, Any]]) -> Any:
    """A replay, or the sentence with which a record is refused."""
    try:
        return sp.replay(events)
    except sp.SmartPlayError as error:
        sentence = str(error)
    assert "\n" not in sentence
    return sentence


def test_a_record_without_its_end_is_incomplete_at_every_length(recorded, tmp_path):
    for length in range(1, len(recorded)):
        replay = sp.replay(write(tmp_path / "short.jsonl", recorded[:length]))
        assert not replay.differences, length
        assert not replay.complete
        assert not replay.identical


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        ("view", "masked", [1]),
        ("view", "turns", None),
        ("view", "tokens", 5),
        ("call", "position", 5),
        ("call", "text", "You win."),
        ("message", "turn", 9),
    ],
)
def test_what_makes_no_sense_is_a_difference_that_names_event_and_field(recorded, tmp_path, kind, field, value):
    events = copy.deepcopy(recorded)
    next(event for event in reversed(events) if event["event"] == kind)[field] = value
    replayed = sp.replay(write(tmp_path / "wrong.jsonl", events))
    assert not replayed.identical
    assert f"({kind}" in " ".join(replayed.differences)


def test_kinds_of_events_are_those_that_are_typed_and_documented():
    page = (Path(__file__).parents[1] / "docs" / "records.md").read_text(encoding="utf-8")
    _, _, section = page.partition("| event | what it holds |")
    documented = re.findall(r"^\| `(\w+)` \|", section.partition("\n\n")[0], flags=re.MULTILINE)
    typed = [get_args(get_type_hints(kind)["event"])[0] for kind in EVENTS]
    assert documented == typed


@pytest.mark.parametrize("path", FORMATS, ids=lambda path: path.stem)
def test_every_released_format_can_be_read_and_replayed(path):
    assert sp.replay(path).identical


def test_there_is_a_record_of_the_format_that_is_written():
    assert FORMATS[-1].stem == f"format-{FORMAT}"


def test_a_new_kind_of_event_needs_no_reader_to_know_it(recorded, tmp_path):
    """What is read from a record stays the same if there are events of a kind that nothing has been taught."""
    plain = Record.read(write(tmp_path / "plain.jsonl", recorded))
    writer = TranscriptWriter(tmp_path / "new.jsonl")
    for event in recorded:
        if event["event"] == "end":
            writer.append({"event": "applause", "turn": 0})
        writer.append({name: value for name, value in event.items() if name != "chain"})
    writer.close()
    whole, head, followed = (read(tmp_path / "new.jsonl") for read in (Record.read, Record.head, Record.follow))
    for record in (whole, head, followed):
        assert (record.outcome, record.result, record.config) == (plain.outcome, plain.result, plain.config)
        assert (record.totals, record.steps, record.calls) == (plain.totals, plain.steps, plain.calls)
        assert record.replies == plain.replies
        assert [sent.sha256 for sent in record.prompts] == [sent.sha256 for sent in plain.prompts]


def test_a_record_is_followed_while_it_grows(recorded, tmp_path):
    path = tmp_path / "growing.jsonl"
    record = Record.follow(path)
    assert not record.exists
    lines = write(tmp_path / "whole.jsonl", recorded).read_bytes().splitlines(keepends=True)
    with path.open("wb", buffering=0) as file:
        for line in lines:
            file.write(line[:-5])
            assert record.refresh().ending is None
            file.write(line[-5:])
            record.refresh()
    whole = Record.read(path)
    assert (record.totals, record.steps, record.result) == (whole.totals, whole.steps, whole.result)
    assert whole.totals.replies == len(whole.replies)


class TestResume:
    """An episode that continues from its record is the episode that was never interrupted."""

    @pytest.mark.parametrize(
        ("game", "protocol"),
        [
            (HANOI, "tools"),
            ("MessengerL1-v0", "paper"),
            *(
                pytest.param(game, protocol, marks=pytest.mark.slow)
                for game, protocol in [(RPS, "tools"), ("MessengerL1-v0", "tools"), (RPS, "paper"), (HANOI, "paper")]
            ),
        ],
    )
    def test_from_every_event_on(self, game, protocol, tmp_path):
        budget = sp.Budget(prompt_tokens=900, slack=0.4) if protocol == "tools" else sp.Budget()
        whole = tmp_path / "whole.jsonl"
        with sp.Episode(game, seed=5, budget=budget, transcript=whole) as episode:
            result = sp.play(episode, sp.get_player("random", seed=2), protocol=protocol)
        lines = whole.read_text().splitlines(keepends=True)
        events = [*sp.read_transcript(whole)]
        prompts = [event["sha256"] for event in events if event["event"] == "view"]
        replies = [event["message"] for event in events if event["event"] == "message"]
        answers = [message for message in replies if message["role"] == "assistant"]
        step = max(1, len(lines) // 8)
        for length in range(2, len(lines) - 1, step):
            path = tmp_path / f"{length}.jsonl"
            path.write_text("".join(lines[:length]) + lines[length][: len(lines[length]) // 2])
            with sp.resume(path) as resumed:
                turns = resumed.episode.stats.turns
                player = sp.get_player("random", seed=2)
                assert turns <= len(answers)
                assert sp.play(resumed.conversation, sp.ScriptedPlayer(answers[turns:])) == result, player.name
            replay = sp.replay(path)
            assert replay.identical
            assert len(replay.resumed) == 1
            assert [event["sha256"] for event in sp.read_transcript(path) if event["event"] == "view"] == prompts

    def test_an_attempt_that_was_stopped_goes_on_in_a_new_record(self, tmp_path):
        first, second = tmp_path / "1.jsonl", tmp_path / "2.jsonl"
        with sp.Episode(RPS, seed=5, transcript=first) as episode:
            conversation = sp.Conversation(episode, player="rule")
            for _ in range(3):
                conversation.receive(sp.get_player("rule").reply(conversation.prompt()).message)
            episode.end("run_budget")
        with sp.resume(first, transcript=second) as resumed:
            result = sp.play(resumed.conversation, sp.get_player("rule"))
        with sp.Episode(RPS, seed=5) as episode:
            assert result == sp.play(episode, sp.get_player("rule"))
        assert sp.replay(second).identical

    def test_an_episode_that_is_over_comes_back_as_it_ended(self, recorded, tmp_path):
        path = write(tmp_path / "over.jsonl", recorded)
        before = path.read_bytes()
        with sp.resume(path) as resumed:
            assert resumed.episode.result.model_dump() == recorded[-1]["result"]
            assert resumed.episode.call("observe").is_error
        assert path.read_bytes() == before

    def test_a_record_that_plays_differently_is_refused(self, recorded, tmp_path):
        events = copy.deepcopy(recorded[:-1])
        del events[-1]["chain"]
        with pytest.raises(TranscriptError, match="cannot be continued: event"):
            sp.resume(write(tmp_path / "changed.jsonl", events))

    def test_events_need_a_place_to_go_on(self, recorded):
        with pytest.raises(sp.InvalidArgumentError, match="name one with `transcript`"):
            sp.resume(recorded[:-1])
        events: list[Any] = []
        with sp.resume(recorded[:-1], transcript=events) as resumed:
            assert resumed.episode.stats.turns == 6
        assert events[-1]["event"] == "end"

    def test_a_game_under_another_rollout_resumes_as_that_game(self, tmp_path):
        path = tmp_path / "short.jsonl"
        spec = dataclasses.replace(sp.GAMES[RPS], rollout=4)
        episode = sp.Episode(spec, seed=1, context="host", transcript=path)
        episode.call("act", {"action": "1"}, "key-1")
        episode.ledger.writer.close()  # the process ends here
        with sp.resume(path) as resumed:
            assert resumed.episode.call("act", {"action": "1"}, "key-1").data["replayed"]
            for _ in range(3):
                resumed.episode.call("act", {"action": "1"})
            assert resumed.episode.result.end_reason == "rollout"
        assert sp.replay(path).identical


def test_a_field_that_earlier_versions_lack_hides_no_other_that_is_missing():
    now = {"scoring": 1, "shape": 2}
    assert list(driver._field_differences("start", {}, now, "start")) == ["start shape is missing in the record."]
