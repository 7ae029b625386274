"""The findings of `submit check`, each from a change that somebody could make to an honest run."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.board.submissions.records import RecordJob, check_record
from smartplay_tools.evaluation.board.submissions.submitted_plan import Allowed, check_plan, check_suite, read_plan
from smartplay_tools.evaluation.runs.runner import Run
from tests.evaluation.bundles import HANOI, chained

Events = list[dict[str, Any]]
Manifest = dict[str, Any]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Two episodes of Hanoi under caps."""
    budget = sp.Budget(prompt_tokens=4000, episode_tokens=100_000)
    out = tmp_path_factory.mktemp("honest")
    return sp.evaluate([HANOI], ["rule"], out=out, trials=2, budgets=budget, executor="inline")


def manifest_of(run: Run) -> dict[str, Any]:
    """The manifest as a bundle has it."""
    return {**run.folder.manifest().to_json(), "caps": {}, "run_file": None, "spending": None}


def job(
    record: Path, *, row: bytes | None = None, attempts: tuple[Path, ...] = (), standard: bool = False
) -> RecordJob:
    config = sp.EpisodeConfig.from_event(json.loads(record.read_bytes().splitlines()[0]))
    return RecordJob(record, config, 0, row, None, attempts, None, None, standard)


def said_of(asked: RecordJob, level: str = "error") -> str:
    return "\n".join(finding.text for finding in check_record(asked).findings if finding.level == level)


def copy_of(run: Run, path: Path, change: Callable[[Events], None] = lambda events: None) -> Path:
    """Write the record of the first episode, changed, with a chain that fits."""
    events = [json.loads(line) for line in run.transcript(run.rows[0]["key"]).read_bytes().splitlines()]
    change(events)
    path.write_bytes(chained(events))
    return path


def failed(events: Events) -> None:
    events[-1]["result"]["end_reason"] = "player_error"


def broken_off(events: Events) -> None:
    del events[-1]


def dearer_prompt(events: Events) -> None:
    next(event for event in events if event["event"] == "view")["tokens"] = 5000


def dearer_reply(events: Events) -> None:
    next(event for event in events if event["event"] == "usage")["reply"] = 200_000


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (failed, "The record is not a finished episode: it ended as player_error."),
        (broken_off, "The record breaks off: it does not say how the episode ended."),
        (dearer_prompt, "The prompt of turn 0 has 5000 tokens."),
        (dearer_reply, "tokens under a cap of 100000."),
    ],
)
def test_a_record_that_was_changed(run, tmp_path, change, sentence):
    assert sentence in said_of(job(copy_of(run, tmp_path / "record.jsonl", change)))


def test_a_row_that_is_missing_or_was_changed(run, tmp_path):
    record = copy_of(run, tmp_path / f"{run.rows[0]['key']}.jsonl")
    assert said_of(job(record)) == "The results hold no row for this episode."
    row = {**run.rows[0], "steps": 3}
    assert said_of(job(record, row=json.dumps(row).encode())) == "The row says steps is 3, the record 7."
    assert said_of(job(record, row=json.dumps(run.rows[0]).encode())) == ""


def test_attempts_that_were_changed_or_replaced(run, tmp_path):
    key, row = run.rows[0]["key"], json.dumps(run.rows[0]).encode()
    record = copy_of(run, tmp_path / f"{key}.jsonl")
    finished = copy_of(run, tmp_path / f"{key}.1.jsonl")
    edited = tmp_path / f"{key}.2.jsonl"
    edited.write_bytes(finished.read_bytes().replace(b'"role": "assistant"', b'"role": "user"', 1))
    assert "attempt 1 is a finished episode" in said_of(job(record, row=row, attempts=(finished,)))
    assert "attempt 2 was changed" in said_of(job(record, row=row, attempts=(edited,)))
    paused = copy_of(run, tmp_path / f"{key}.3.jsonl", broken_off)
    assert said_of(job(record, row=row, attempts=(paused,))) == ""


@pytest.mark.slow
def test_a_player_that_was_shown_pictures(tmp_path):
    record = tmp_path / "record.jsonl"
    with sp.Episode("Crafter-v0", seed=1, render_mode="rgb_array", transcript=record) as episode:
        sp.Conversation(episode).prompt()
        episode.picture()
    assert "The player was shown pictures of the game, which no prompt has." in said_of(job(record))


def test_a_host_that_owned_the_context_or_made_calls_without_prompts(tmp_path):
    for context, sentence in (("host", "The host owned the context"), ("window", "The record holds no prompts")):
        record = tmp_path / f"{context}.jsonl"
        with sp.Episode(HANOI, seed=1, context=context, transcript=record) as episode:  # type: ignore[arg-type]
            episode.call("act", {"action": "1"})
        assert sentence in said_of(job(record), "remark")
        assert sentence in said_of(job(record, standard=True))


def test_a_host_that_added_messages(tmp_path):
    record = tmp_path / "record.jsonl"
    with sp.Episode(HANOI, seed=1, transcript=record) as episode:
        sp.Conversation(episode, head=[{"role": "user", "content": "Move disk A first."}]).prompt()
    assert "The host added messages or tools to every prompt." in said_of(job(record, standard=True))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda manifest: manifest["cells"].append({**manifest["cells"][0], "player": "b"}), "The run has 2 players"),
        (lambda manifest: manifest["episodes"].append(manifest["episodes"][0]), "lists episodes twice"),
        (lambda manifest: manifest["episodes"][0].update(key="0" * 16), "a key that is not its config's"),
        (lambda manifest: manifest["episodes"][0].update(seed=1), "does not follow from the run's"),
        (lambda manifest: manifest["episodes"].pop(0), "are not 0, 1, 2 and so on"),
    ],
)
def test_a_plan_that_was_changed(run, change, sentence):
    manifest = manifest_of(run)
    assert check_plan(read_plan(manifest), Allowed()).findings == []
    change(manifest)
    assert sentence in "\n".join(finding.text for finding in check_plan(read_plan(manifest), Allowed()).findings)


def test_an_episode_of_a_cell_that_is_not_listed(run):
    manifest = manifest_of(run)
    manifest["episodes"][0]["cell"] = 7
    with pytest.raises(sp.InvalidArgumentError, match="has the cell 7, which is not listed"):
        read_plan(manifest)


def test_a_suite_that_is_unknown_or_not_covered(run):
    plan = read_plan(manifest_of(run))
    for suite, kind, sentence in (
        ("mine", "custom", "There is no suite 'mine'"),
        ("paper", "custom", "The suite paper is not covered"),
        (None, "standard", "A standard submission is a run of a fixed suite"),
        ("tools-v1", "standard", "cells of the run differ from tools-v1"),
    ):
        assert sentence in "\n".join(finding.text for finding in check_suite(plan, suite, kind))
