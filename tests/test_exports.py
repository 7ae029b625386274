"""Exports: what is chosen, what the rows and trajectories say, and that what cannot be trusted is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.context.prompts.wording import VERSION, Wording
from smartplay_tools.episode.seeds import trial_seed
from smartplay_tools.evaluation.exports import export
from smartplay_tools.records import Record, recorded_pictures, sent_prompts
from smartplay_tools.types import ToolCall

MANUAL_IS_ABOVE = Wording.of(VERSION)("manual_is_above")
BUDGET = sp.Budget(prompt_tokens=700)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    games = ["Hanoi3Disk-v0", "RockPaperScissorBasic-v0"]
    sp.evaluate(games, ["rule", "random"], budgets=[BUDGET], trials=3, out=folder, executor="inline")
    return folder


def rows(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "data.jsonl").read_text(encoding="utf-8").splitlines()]


def test_a_row_of_sft_is_what_the_model_saw_and_what_it_said(run, tmp_path):
    exported = export(run, tmp_path / "data", "sft", players=("rule",), games=("Hanoi3Disk-v0",))
    written = rows(tmp_path / "data")
    assert exported.counts == {"episodes": 3, "rows": len(written)}
    records = sorted((run / "episodes").glob("*.jsonl"))
    sent = {(record.stem, s.turn): s for record in records for s in sent_prompts(sp.read_transcript(record))}
    first = next(r for r in map(Record.read, records) if (r.game, r.player) == ("Hanoi3Disk-v0", "rule"))
    own = [row for row in written if (row["game"], row["seed"]) == (first.result.game, first.result.seed)]
    for row in own:
        shown = sent[first.name, row["turn"]].prompt.messages
        assert [message["content"] for message in row["prompt"]] == [message["content"] or "" for message in shown]
        (reply,) = row["completion"]
        assert reply["tool_calls"] == first.turns[row["turn"]].assistant["tool_calls"]
        assert [tool["function"]["name"] for tool in json.loads(row["tools"])] == ["observe", "act", "read_manual"]
    assert len(own) == first.result.turns


def test_a_row_of_sft_episodes_is_a_whole_conversation(run, tmp_path):
    export(run, tmp_path / "data", "sft-episodes", completed=True)
    for row in rows(tmp_path / "data"):
        calls = [call["id"] for message in row["messages"] for call in message.get("tool_calls", ())]
        answers = [message["tool_call_id"] for message in row["messages"] if message["role"] == "tool"]
        assert calls == answers
        assert row["completed"]


def test_columns_have_one_type(run, tmp_path):
    """What Arrow needs: a value of a column, at any depth, is of one type in all rows, or missing."""
    for name in ("sft", "sft-episodes"):
        export(run, tmp_path / name, name)
        types: dict[str, set[str]] = {}

        def note(path: str, value: object, types: dict[str, set[str]] = types) -> None:
            if isinstance(value, dict):
                for key, inner in value.items():
                    note(f"{path}.{key}", inner)
            elif isinstance(value, list):
                for inner in value:
                    note(f"{path}[]", inner)
            elif value is not None:
                types.setdefault(path, set()).add(type(value).__name__)

        for row in rows(tmp_path / name):
            note("", row)
        assert {path: kinds for path, kinds in types.items() if len(kinds) > 1} == {}


@pytest.mark.parametrize(
    ("selection", "kept"),
    [
        ({}, 12),
        ({"games": ("Hanoi3Disk-v0",)}, 6),
        ({"players": ("rule",), "completed": True}, 3),
        ({"min_score": 3.0, "games": ("Hanoi3Disk-v0",)}, 3),
        ({"min_normalized_score": 1.0, "players": ("rule",), "games": ("Hanoi3Disk-v0",)}, 3),
        ({"best": 1}, 4),
        ({"best": 2, "players": ("random",)}, 4),
    ],
    ids=str,
)
def test_what_is_left_out_is_counted(run, tmp_path, selection, kept):
    exported = export(run, tmp_path / "data", "sft-episodes", **selection)
    assert exported.counts["episodes"] == kept
    assert exported.counts["episodes"] + exported.left_out.total() == 12
    for reason in exported.left_out:
        assert reason in (tmp_path / "data" / "README.md").read_text(encoding="utf-8")


def test_the_best_have_the_highest_scores(run, tmp_path):
    export(run, tmp_path / "all", "sft-episodes")
    export(run, tmp_path / "best", "sft-episodes", best=1)
    for best in rows(tmp_path / "best"):
        rivals = [r for r in rows(tmp_path / "all") if (r["game"], r["player"]) == (best["game"], best["player"])]
        assert best["score"] == max(rival["score"] for rival in rivals)


def test_an_unfinished_episode_is_not_exported(tmp_path):
    record = tmp_path / "records" / "one.jsonl"
    with sp.Episode("Hanoi3Disk-v0", seed=1, transcript=record) as episode:
        sp.Conversation(episode).prompt()
    with pytest.raises(sp.InvalidArgumentError, match="1 interrupted"):
        export(tmp_path / "records", tmp_path / "data")


def test_a_record_that_was_changed_is_refused_and_leaves_nothing(run, tmp_path):
    episode = next(p for p in (run / "episodes").glob("*.jsonl") if Record.read(p).config.player == "rule")
    changed = tmp_path / "records" / "one.jsonl"
    changed.parent.mkdir()
    changed.write_text(episode.read_text(encoding="utf-8").replace("You’re a player", "You are a player"))
    if changed.read_text(encoding="utf-8") == episode.read_text(encoding="utf-8"):
        changed.write_text(episode.read_text(encoding="utf-8").replace("You\\u2019re a player", "You are a player"))
    with pytest.raises(sp.SmartPlayError, match="is not the one that was sent"):
        export(changed, tmp_path / "data")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["records"]


def test_data_is_never_overwritten(run, tmp_path):
    (tmp_path / "data").mkdir()
    with pytest.raises(sp.InvalidArgumentError, match="exists"):
        export(run, tmp_path / "data")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"format": "csv"}, "csv"),
        ({"best": 0}, "best"),
        ({"format": "sft-episodes", "summaries": True}, "sft-episodes has no rows for summaries"),
    ],
    ids=str,
)
def test_what_cannot_be_exported_is_said_in_a_sentence(run, tmp_path, arguments, sentence):
    with pytest.raises(sp.SmartPlayError, match=sentence):
        export(run, tmp_path / "data", **arguments)


def test_the_papers_protocol_has_rows_for_replies_only(tmp_path):
    record = tmp_path / "one.jsonl"
    with sp.Episode("RockPaperScissorBasic-v0", seed=1, transcript=record) as episode:
        sp.play(episode, sp.ScriptedPlayer([{"role": "assistant", "content": "1"}] * 100), protocol="paper")
    export(record, tmp_path / "data")
    (first, *_), count = rows(tmp_path / "data"), len(rows(tmp_path / "data"))
    assert "tools" not in first
    assert count == Record.read(record).result.turns
    for other in ("sft-episodes", "atif"):
        with pytest.raises(sp.InvalidArgumentError, match="export it as sft"):
            export(record, tmp_path / "episodes", other)


def test_a_trajectory_has_the_calls_with_their_results_and_what_the_prompt_showed(run, tmp_path):
    export(run, tmp_path / "data", "atif", players=("rule",), games=("Hanoi3Disk-v0",))
    files = sorted((tmp_path / "data" / "trajectories").glob("*.json"))
    assert len(files) == 3
    for file in files:
        trajectory = json.loads(file.read_text(encoding="utf-8"))
        result = trajectory["extra"]["smartplay"]["result"]
        agent = [step for step in trajectory["steps"] if step["source"] == "agent"]
        assert [step["step_id"] for step in trajectory["steps"]] == list(range(1, len(trajectory["steps"]) + 1))
        assert sum(step["metrics"]["prompt_tokens"] for step in agent) == result["tokens"]["prompt"]
        for step in agent:
            called = [call["tool_call_id"] for call in step["tool_calls"]]
            assert called == [answer["source_call_id"] for answer in step["observation"]["results"]]
            assert step["extra"]["smartplay"]["prompt"]["tokens"] == step["metrics"]["prompt_tokens"]


def test_the_command_says_what_it_wrote(run, tmp_path):
    out = tmp_path / "data"
    shown = CliRunner().invoke(app, ["export", str(run), "--completed", "--out", str(out)])
    assert shown.exit_code == 0
    assert "3 episodes" in shown.output
    assert "left out: 9 (not completed)" in shown.output
    assert (out / "README.md").read_text(encoding="utf-8").startswith("---\nlanguage: en\n")


def test_a_prompt_for_a_summary_is_no_row(tmp_path):
    record = tmp_path / "one.jsonl"
    budget = sp.Budget(prompt_tokens=1100, summary_tokens=60, slack=0.5, tool_calls=25, stalled_turns=None)
    call = {"id": "", "type": "function", "function": {"name": "observe", "arguments": "{}"}}
    reply = {"role": "assistant", "content": "I have looked.", "tool_calls": [call]}
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget, transcript=record) as episode:
        result = sp.play(episode, sp.ScriptedPlayer([reply] * 60))
    assert any(event["event"] == "summary" for event in sp.read_transcript(record))
    assert export(record, tmp_path / "data").counts["rows"] == result.turns
    assert [row["turn"] for row in rows(tmp_path / "data")] == list(range(result.turns))
    export(record, tmp_path / "trajectories", "atif")


def transcript(folder: Path, game: str, player: sp.Player, **options) -> Path:
    record = folder / "one.jsonl"
    with sp.Episode(game, seed=7, transcript=record, **options) as episode:
        sp.play(episode, player)
    return record


def test_the_manual_that_was_read_is_in_whole_conversations(tmp_path):
    """In MESSENGER the manual is the task: without it nobody can learn why a move was right."""
    record = transcript(tmp_path, "MessengerL1-v0", sp.get_player("rule"), split="train")
    with sp.Episode("MessengerL1-v0", seed=7, split="train") as episode:
        manual = episode.manual_text
    export(record, tmp_path / "rows", "sft-episodes")
    (row,) = rows(tmp_path / "rows")
    assert [m["role"] for m in row["messages"] if m["content"] == manual] == ["tool"]
    export(record, tmp_path / "trajectories", "atif")
    (file,) = (tmp_path / "trajectories" / "trajectories").glob("*.json")
    steps = json.loads(file.read_text(encoding="utf-8"))["steps"]
    answers = [answer["content"] for step in steps for answer in step.get("observation", {}).get("results", ())]
    assert manual in answers
    assert MANUAL_IS_ABOVE not in answers


def test_a_pinned_manual_is_in_the_head_and_is_not_repeated(tmp_path):
    call = {"id": "", "type": "function", "function": {"name": "read_manual", "arguments": "{}"}}
    asking = sp.ScriptedPlayer([{"role": "assistant", "content": None, "tool_calls": [call]}] * 3)
    budget = sp.Budget(tool_calls=3)
    record = transcript(tmp_path, "MessengerL1-v0", asking, manual="pinned", budget=budget)
    export(record, tmp_path / "rows", "sft-episodes")
    (row,) = rows(tmp_path / "rows")
    assert [m["content"] for m in row["messages"] if m["role"] == "tool"] == [MANUAL_IS_ABOVE] * 3


@pytest.mark.parametrize("slack", [0.0, 0.5])
def test_chains_have_every_prompt_exactly_and_every_reply_once(tmp_path, slack):
    budget = sp.Budget(prompt_tokens=800, slack=slack)
    record = transcript(tmp_path, "RockPaperScissorBasic-v0", sp.get_player("rule"), budget=budget)
    replies = export(record, tmp_path / "sft", "sft").counts["rows"]
    counts = export(record, tmp_path / "chains", "sft-chains").counts
    assert counts["replies"] == replies > counts["rows"] > 1
    assert exchanges(rows(tmp_path / "chains")) == exchanges(rows(tmp_path / "sft"))
    size = {name: (tmp_path / name / "data.jsonl").stat().st_size for name in ("sft", "chains")}
    assert size["chains"] < size["sft"]


def exchanges(written: list[dict]) -> list[tuple]:
    """Every prompt with its reply and tools, as rows of either kind teach them."""
    return [
        (messages[:at], messages[at], row["tools"])
        for row in written
        for messages in [row["prompt"] + row["completion"]]
        for at in range(len(row["prompt"]), len(messages))
        if messages[at]["role"] == "assistant"
    ]


@pytest.mark.parametrize("form", ["sft", "sft-chains"])
def test_summaries_have_rows_when_they_are_asked_for(tmp_path, form):
    budget = sp.Budget(prompt_tokens=800, summary_tokens=100, slack=0.5)
    record = transcript(tmp_path, "RockPaperScissorBasic-v0", sp.get_player("rule-notes"), budget=budget)
    result = Record.read(record).result
    assert result.summaries > 0
    without = export(record, tmp_path / "without", form).counts
    counts = export(record, tmp_path / "with", form, summaries=True).counts
    replies = "rows" if form == "sft" else "replies"
    assert (without[replies], counts[replies]) == (result.turns, result.turns + result.summaries)
    recorded = Record.read(record)
    asked = [sent for sent in recorded.sent_prompts() if sent.prompt.purpose != "play"]
    pairs = exchanges(rows(tmp_path / "with"))
    taught = [(prompt[-1]["content"], reply["content"]) for prompt, reply, _ in pairs]
    for sent, summary in zip(asked, recorded.summaries, strict=True):
        assert (sent.prompt.messages[-1]["content"], summary["message"]["content"]) in taught


@pytest.mark.parametrize("form", ["sft-episodes", "sft-chains"])
def test_the_record_of_a_host_is_one_conversation(tmp_path, form):
    with sp.Episode("MessengerL1-v0", seed=7, context="host", transcript=tmp_path / "host.jsonl") as episode:
        head, manual = episode.head, episode.manual_text
        episode.call("read_manual")
        first, second = episode.call_batch([ToolCall("act", {"action": "1"}), ToolCall("act", {"action": "9"})])
        episode.end("host")
    export(tmp_path / "host.jsonl", tmp_path / "data", form)
    (row,) = rows(tmp_path / "data")
    messages = row.get("messages") or row["prompt"] + row["completion"]
    assert [(m["role"], m["content"]) for m in messages] == [
        *((m["role"], m["content"]) for m in head),
        ("assistant", ""),
        ("tool", manual),
        ("assistant", ""),
        ("tool", first.text),
        ("tool", second.text),
    ]
    calls = [call for m in messages for call in m.get("tool_calls", ())]
    assert [call["id"] for call in calls] == [m["tool_call_id"] for m in messages if m["role"] == "tool"]
    assert [json.loads(call["function"]["arguments"]) for call in calls] == [{}, {"action": "1"}, {"action": "9"}]
    assert [tool["function"]["name"] for tool in json.loads(row["tools"])] == ["observe", "act", "read_manual"]


def test_prompts_of_a_host_are_not_recorded_and_not_invented(tmp_path):
    with sp.Episode("Hanoi3Disk-v0", seed=7, context="host", transcript=tmp_path / "host.jsonl") as episode:
        episode.call("act", {"action": "1"})
        episode.end("host")
    with pytest.raises(sp.InvalidArgumentError, match="export it as sft-chains"):
        export(tmp_path / "host.jsonl", tmp_path / "data", "sft")
    assert export(tmp_path / "host.jsonl", tmp_path / "data", "atif").counts == {"episodes": 1, "steps": 3}


def test_a_card_warns_of_names_that_tell_the_role_and_of_worlds_that_are_evaluated(tmp_path):
    for game in ("Hanoi3Disk-v0", "MessengerL1-v0"):
        for trial in range(2):
            record = tmp_path / "records" / f"{game}.{trial}.jsonl"
            with sp.Episode(game, seed=trial_seed(0, game, trial), transcript=record) as episode:
                sp.play(episode, sp.get_player("rule"))
    export(tmp_path / "records", tmp_path / "data", "sft-episodes")
    card = (tmp_path / "data" / "README.md").read_text(encoding="utf-8")
    assert "MessengerL1-v0 played the games and sentences of its split `test`" in card
    assert "dog, queen, robot, sword: always the message" in card
    assert "--option split=train" in card
    assert "Hanoi3Disk-v0 has one world" in card
    assert "MessengerL1-v0: 2 of these worlds are among the first 100" in card


def test_a_card_of_the_train_split_says_so_and_does_not_warn(tmp_path):
    player, options = sp.get_player("rule"), {"split": "train"}
    export(transcript(tmp_path, "MessengerL1-v0", player, **options), tmp_path / "data", "sft-episodes")
    card = (tmp_path / "data" / "README.md").read_text(encoding="utf-8")
    assert "its split `train`, in which every name has 2 or more roles" in card
    assert "always the" not in card


@pytest.mark.parametrize("form_of_rows", ["sft", "sft-chains", "sft-episodes"])
def test_pictures_are_files_beside_the_rows_on_request(tmp_path, form_of_rows):
    (tmp_path / "records").mkdir()
    for form in ("picture", "text"):
        path, budget = tmp_path / "records" / f"{form}.jsonl", sp.Budget(tool_calls=3, history=1)
        with sp.Episode("Crafter-v0", seed=5, observation=form, budget=budget, transcript=path) as episode:
            sp.play(episode, sp.get_player("random", seed=5))
    made = export(tmp_path / "records", tmp_path / "data", form_of_rows, pictures=True)
    recorded = recorded_pictures(tmp_path / "records" / "picture.jsonl")
    files = {file.name: file.read_bytes() for file in (tmp_path / "data" / "pictures").iterdir()}
    assert files == {f"{sha256}.png": picture.png for sha256, picture in recorded.items()}
    assert made.counts["pictures"] == len(files)
    exported = rows(tmp_path / "data")
    for row in exported:
        messages = [*row.get("prompt", ()), *row.get("completion", ()), *row.get("messages", ())]
        parts = [part for message in messages for part in message["content"]]
        assert [part for part in parts if part["type"] == "image"] == [{"type": "image"}] * len(row["images"])
        assert all((tmp_path / "data" / path).is_file() for path in row["images"])
    assert any(row["images"] for row in exported)
    assert not all(row["images"] for row in exported)


def test_episodes_with_pictures_are_left_out_without_the_option(tmp_path):
    path, budget = tmp_path / "both.jsonl", sp.Budget(tool_calls=2)
    with sp.Episode("Crafter-v0", seed=5, observation="both", budget=budget, transcript=path) as episode:
        sp.play(episode, sp.get_player("random", seed=5))
    with pytest.raises(sp.InvalidArgumentError, match="1 observations are pictures"):
        export(tmp_path / "both.jsonl", tmp_path / "data")
    with pytest.raises(sp.InvalidArgumentError, match="atif has no place for pictures"):
        export(tmp_path / "both.jsonl", tmp_path / "data", "atif", pictures=True)
