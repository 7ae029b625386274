"""Exports: what is chosen, what the rows say, and that what cannot be trusted is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.exports import export
from smartplay_tools.records import Record, sent_prompts
from tests.evaluation.command import shown_by

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


def test_columns_have_one_type(run, tmp_path):
    """What Arrow needs: a value of a column, at any depth, is of one type in all rows, or missing."""
    for name in ("sft", "sft-chains"):
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
    ],
    ids=str,
)
def test_what_is_left_out_is_counted(run, tmp_path, selection, kept):
    exported = export(run, tmp_path / "data", "sft-chains", **selection)
    assert exported.counts["episodes"] == kept
    assert exported.counts["episodes"] + exported.left_out.total() == 12


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


def test_what_cannot_be_exported_is_said_in_a_sentence(run, tmp_path):
    with pytest.raises(sp.SmartPlayError, match="csv"):
        export(run, tmp_path / "data", format="csv")
    for name in ("games", "players"):
        with pytest.raises(sp.InvalidArgumentError, match=rf"{name} is a list of names, such as \['rule'\]"):
            export(run, tmp_path / "data", **{name: "rule"})


def test_the_papers_protocol_has_rows_for_replies_only(tmp_path):
    record = tmp_path / "one.jsonl"
    with sp.Episode("RockPaperScissorBasic-v0", seed=1, transcript=record) as episode:
        sp.play(episode, sp.ScriptedPlayer([{"role": "assistant", "content": "1"}] * 100), protocol="paper")
    export(record, tmp_path / "data")
    (first, *_), count = rows(tmp_path / "data"), len(rows(tmp_path / "data"))
    assert "tools" not in first
    assert count == Record.read(record).result.turns


def test_the_command_says_what_it_wrote(run, tmp_path):
    out = tmp_path / "data"
    shown = shown_by("export", run, "--completed", "--out", out)
    assert "3 episodes" in shown
    assert "left out: 9 (not completed)" in shown


def test_a_prompt_for_a_summary_is_no_row(tmp_path):
    record = tmp_path / "one.jsonl"
    budget = sp.Budget(prompt_tokens=1100, summary_tokens=60, slack=0.5, tool_calls=25, stalled_turns=None)
    reply = sp.call("observe", say="I have looked.")
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget, transcript=record) as episode:
        result = sp.play(episode, sp.ScriptedPlayer([reply] * 60))
    assert any(event["event"] == "summary" for event in sp.read_transcript(record))
    assert export(record, tmp_path / "data").counts["rows"] == result.turns
    assert [row["turn"] for row in rows(tmp_path / "data")] == list(range(result.turns))


def transcript(folder: Path, game: str, player: sp.Player, **options) -> Path:
    record = folder / "one.jsonl"
    with sp.Episode(game, seed=7, transcript=record, **options) as episode:
        sp.play(episode, player)
    return record


def test_the_manual_that_was_read_is_in_the_rows(tmp_path):
    """In MESSENGER the manual is the task: without it nobody can learn why a move was right."""
    record = transcript(tmp_path, "MessengerL1-v0", sp.get_player("rule"), split="train")
    with sp.Episode("MessengerL1-v0", seed=7, split="train") as episode:
        manual = episode.manual_text
    export(record, tmp_path / "rows", "sft-chains")
    assert any(manual in (message["content"] or "") for row in rows(tmp_path / "rows") for message in row["prompt"])


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


def test_prompts_of_a_host_are_not_recorded_and_not_invented(tmp_path):
    with sp.Episode("Hanoi3Disk-v0", seed=7, context="host", transcript=tmp_path / "host.jsonl") as episode:
        episode.call("act", {"action": "1"})
        episode.end("host")
    with pytest.raises(sp.InvalidArgumentError, match="its host managed the context, so its prompts are not recorded"):
        export(tmp_path / "host.jsonl", tmp_path / "data", "sft-chains")


def test_episodes_with_pictures_are_left_out(tmp_path):
    path, budget = tmp_path / "both.jsonl", sp.Budget(tool_calls=2)
    with sp.Episode("Crafter-v0", seed=5, observation="both", budget=budget, transcript=path) as episode:
        sp.play(episode, sp.get_player("random", seed=5))
    with pytest.raises(sp.InvalidArgumentError, match="1 observations are pictures"):
        export(tmp_path / "both.jsonl", tmp_path / "data")
