"""Submissions: a bundle of a run that was played is verified, and whatever was done to it afterwards is found."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.evaluation.board.submissions.bundle import Limits
from smartplay_tools.evaluation.board.submissions.check import Checked, check_submission
from smartplay_tools.evaluation.board.submissions.check_report import report_json, report_text
from smartplay_tools.evaluation.board.submissions.issued_seeds import issue_seed, read_seeds
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from smartplay_tools.evaluation.board.submissions.submitted_plan import check_suite, read_plan
from smartplay_tools.evaluation.run_folder.folder import RunFolder, Until
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.suites import get_suite
from tests.evaluation import bundles
from tests.evaluation.bundles import BANDIT, FACTS, HANOI, Files, changed, edit_json, edit_record, records
from tests.evaluation.players import FirstMoves


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundles.play_bundle(tmp_path_factory.mktemp("honest"))


def kinds(checked: Checked) -> set[str]:
    return {finding.kind for finding in checked.errors}


def check(bundle, tmp_path, change) -> Checked:
    return check_submission(changed(bundle, tmp_path / "changed.zip", change), workers=0)


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_an_honest_run_is_verified(bundle, workers):
    checked = check_submission(bundle, workers=workers)
    assert checked.errors == []
    assert (len(checked.rows), checked.planned) == (4, 4)
    assert checked.prompts == checked.replies > 20
    assert checked.rows == RunFolder(bundle.parent / "run").rows()
    assert "Who wrote the replies" in report_text(checked)
    assert "several plays of one seed" in report_text(checked)


def test_the_same_run_makes_the_same_bytes(bundle, tmp_path):
    prepare_submission(bundle.parent / "run", tmp_path / "again.zip", FACTS)
    assert (tmp_path / "again.zip").read_bytes() == bundle.read_bytes()


def test_the_rollout_card_of_an_older_version_is_not_checked_and_the_report_says_so(bundle, tmp_path):
    checked = check(bundle, tmp_path, lambda files: files.update({"rollout-card.json": b"{}"}))
    assert checked.verified
    assert "rollout-card.json, of an older version, is not checked." in report_text(checked)
    assert "rollout-card" not in report_text(check_submission(bundle, workers=0))


@pytest.mark.slow
def test_the_commands(bundle, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = ["submit", "prepare", str(bundle.parent / "run"), "--name", "Mine", "--type", "custom", "-o", "mine.zip"]
    assert CliRunner().invoke(app, asked).exit_code == 0
    again = CliRunner().invoke(app, asked)
    assert (again.exit_code, "exists" in again.output) == (2, True)
    done = CliRunner().invoke(app, ["submit", "check", "mine.zip", "--workers", "1", "--report", "mine.json"])
    assert done.exit_code == 0, done.output
    assert done.output.startswith("mine.zip: verified\nMine (not given), submitted by not given: custom\n")
    report = json.loads((tmp_path / "mine.json").read_text())
    assert report["verified"] is True
    assert report["submission"]["model_name"] == "Mine"
    assert [result["episodes"] for result in report["results"]] == [2, 2]
    absent = CliRunner().invoke(app, ["submit", "check", "nowhere.zip"])
    assert (absent.exit_code, absent.output) == (
        2,
        "smartplay-tools: nowhere.zip cannot be read: No such file or directory.\n",
    )


def test_an_answer_that_was_edited_is_found_by_the_chain(bundle, tmp_path):
    def edit(files: Files) -> None:
        name = records(files, HANOI)[0]
        files[name] = files[name].replace(b'"is_error": false', b'"is_error": true', 1)

    checked = check(bundle, tmp_path, edit)
    assert any("chain is broken" in finding.text for finding in checked.errors)
    assert len(checked.rows) == 3


def test_episodes_that_are_missing_or_doubled_are_found(bundle, tmp_path):
    def remove(files: Files) -> None:
        del files[records(files, HANOI)[0]]

    def omit(files: Files) -> None:
        def shorten(manifest):
            manifest["episodes"] = manifest["episodes"][1:]

        edit_json(files, "manifest.json", shorten)

    def repeat_row(files: Files) -> None:
        files["results.jsonl"] += files["results.jsonl"].splitlines(keepends=True)[0]

    assert "coverage" in kinds(check(bundle, tmp_path, remove))
    omitted = check(bundle, tmp_path, omit)
    assert {"plan", "coverage"} <= kinds(omitted)
    assert kinds(check(bundle, tmp_path, repeat_row)) == {"coverage"}


def test_a_player_that_was_given_the_game_is_found(tmp_path):
    checked = check_submission(bundles.play_bundle(tmp_path, player="oracle"), workers=0)
    assert "privileged" in kinds(checked)
    assert all(row is not None for row in checked.rows)


def test_messages_of_a_host_are_found(bundle, tmp_path):
    """The same episode played with a hint in every prompt replays, and is not an episode with the library's prompts."""

    def hint(files: Files) -> None:
        name = records(files, HANOI)[0]
        start = json.loads(files[name].splitlines()[0])
        events: list[dict] = []
        with sp.Episode.from_config(sp.EpisodeConfig.from_event(start), transcript=events) as episode:
            conversation = sp.Conversation(episode, head=[{"role": "user", "content": "Move disk A first."}])
            player = sp.get_player("rule", seed=start["config"]["seed"])
            while (prompt := conversation.prompt()) is not None:
                conversation.receive(player.reply(prompt).message)
        files[name] = bundles.chained(events)

    checked = check(bundle, tmp_path, hint)
    assert any(finding.kind == "prompts" and finding.level == "remark" for finding in checked.findings)
    assert "metadata" in kinds(checked), "the submission says that no prompts were modified"


def test_an_episode_that_was_begun_anew_is_remarked(bundle, tmp_path):
    def attempt(files: Files) -> None:
        name = records(files, BANDIT)[0]
        events = [json.loads(line) for line in files[name].splitlines()]
        first = next(at for at, event in enumerate(events) if event["event"] == "call")
        key = name.removeprefix("episodes/").removesuffix(".jsonl")
        files[f"attempts/{key}.1.jsonl"] = bundles.chained(events[: first + 1])
        events[first - 1 if events[first - 1]["event"] == "message" else first - 2]["message"]["content"] = (
            "Other words"
        )
        files[f"attempts/{key}.2.jsonl"] = bundles.chained(events[: first + 1])

    checked = check(bundle, tmp_path, attempt)
    assert checked.verified
    assert checked.attempts == {"interrupted": 2}
    remarks = [finding.text for finding in checked.findings if finding.kind == "attempts"]
    assert remarks == ["After attempt 2 (interrupted, 1 replies) the episode was begun anew."]


def test_records_of_a_server_without_usage_are_remarked(bundle, tmp_path):
    """What counts are the tokens: the requests to such a server are on record, too."""

    def asked_only(files: Files) -> None:
        def without_tokens(events: list[dict]) -> None:
            for event in events:
                if event["event"] == "usage":
                    event["provider"] = sp.Usage(requests=2).model_dump()

        edit_record(files, records(files, HANOI)[0], without_tokens)

    checked = check(bundle, tmp_path, asked_only)
    text = "4 of 4 records hold no count of tokens by a provider; ours is exact for both."
    assert text in [finding.text for finding in checked.findings]


@pytest.mark.slow
def test_a_seed_that_the_board_issued(tmp_path):
    seeds = tmp_path / "seeds.jsonl"
    issued = issue_seed(seeds, "An agent")
    assert issue_seed(seeds, "Another").seed != issued.seed
    assert [one.name for one in read_seeds(seeds)] == ["An agent", "Another"]
    bundle = bundles.play_bundle(tmp_path, seed=issued.seed)
    checked = check_submission(bundle, seeds=seeds, workers=0)
    assert checked.verified
    assert checked.issued == issued
    other = bundles.play_bundle(tmp_path / "other", seed=issued.seed, model_name="Another")
    assert kinds(check_submission(other, seeds=seeds, workers=0)) == {"seed"}
    chosen = bundles.play_bundle(tmp_path / "chosen", seed=5)
    assert kinds(check_submission(chosen, seeds=seeds, workers=0)) == {"seed"}


def test_a_standard_submission_follows_a_fixed_suite(bundle, tmp_path):
    with pytest.raises(sp.InvalidArgumentError, match="A standard submission is a run of a fixed suite"):
        prepare_submission(bundle.parent / "run", tmp_path / "no.zip", {**FACTS, "submission_type": "standard"})
    with pytest.raises(sp.InvalidArgumentError, match=r"tools-v1 has 10 episodes of .* the run has 0"):
        prepare_submission(bundle.parent / "run", tmp_path / "no.zip", {**FACTS, "suite": "tools-v1"})


def test_the_fixed_suite_is_planned_as_it_is_checked(tmp_path):
    from smartplay_tools.evaluation.runs.plan import plan_suite

    suite = get_suite("tools-v1")
    plan = plan_suite(suite, ["rule"], seed=3)
    assert list(plan.cells) == suite.cells("rule", {})
    assert len(plan.episodes) == 3 * (5 * 10 + 2 * 5)
    with pytest.raises(sp.InvalidArgumentError, match="The suite tools-v1 fixes budgets, trials"):
        sp.evaluate([], ["rule"], out=tmp_path, suite="tools-v1", trials=2, budgets=sp.Budget(history=1))
    refused = CliRunner().invoke(
        app, ["eval", "--suite", "tools-v1", "--prompt-tokens", "900", "--out", str(tmp_path / "run")]
    )
    assert (refused.exit_code, "fixes budgets" in refused.output) == (2, True)


@pytest.mark.slow
def test_what_cannot_be_prepared(bundle, tmp_path):
    run = tmp_path / "run"
    sp.evaluate([HANOI], ["rule", "random"], out=run, trials=1, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="The run has the players rule, random; name the submitted one"):
        prepare_submission(run, tmp_path / "two.zip", FACTS)
    prepare_submission(run, tmp_path / "one.zip", FACTS, player="random")
    assert check_submission(tmp_path / "one.zip", workers=0).verified
    with pytest.raises(sp.InvalidArgumentError, match="submission_date: this day does not exist"):
        prepare_submission(run, tmp_path / "day.zip", {**FACTS, "submission_date": "2026-02-31"}, player="rule")
    sp.evaluate([HANOI], ["rule"], out=tmp_path / "again", trials=1, repeats=2, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="plays every world 2 times; submit a run without repeats"):
        prepare_submission(tmp_path / "again", tmp_path / "again.zip", FACTS)
    heats = [PlayerConfig(name="first", factory=FirstMoves, options={"heat": heat}) for heat in (0, 1)]
    sp.evaluate([BANDIT], heats, out=tmp_path / "heats", trials=1, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="first has several sets of options"):
        prepare_submission(tmp_path / "heats", tmp_path / "heats.zip", FACTS)
    until = Until("5", None, "score")
    sp.evaluate([BANDIT], ["rule", "random"], until=until, out=tmp_path / "until", trials=12, executor="inline")
    with pytest.raises(sp.InvalidArgumentError, match="Play it without --until"):
        prepare_submission(tmp_path / "until", tmp_path / "until.zip", FACTS, player="rule")
    (run / "results.jsonl").write_text("")
    with pytest.raises(sp.InvalidArgumentError, match="1 of 1 episodes are not finished"):
        prepare_submission(run, tmp_path / "none.zip", FACTS, player="rule")


def test_a_check_that_takes_too_long_is_ended(bundle):
    checked = check_submission(bundle, limits=Limits(seconds=0.001))
    assert checked.rows == []
    assert all("took more than 0.001 seconds" in finding.text for finding in checked.errors)
    checked = check_submission(bundle, limits=Limits(total_seconds=0))
    assert sum("all records together" in finding.text for finding in checked.errors) == 4


def test_the_report_in_json_is_plain_data(bundle):
    report = report_json(check_submission(bundle, workers=0))
    assert json.loads(json.dumps(report)) == report
    assert report["results"] == report["submission"]["results"]


@pytest.mark.parametrize("player", ["rule", "random", "first"])
def test_the_reference_rows_are_of_the_suite_as_it_is_planned(player):
    from smartplay_tools.evaluation.runs.plan import plan_suite

    folder = Path(__file__).parents[2] / "experiments" / "tools-v1" / player
    if not folder.exists():
        pytest.skip("not in a checkout")
    planned = plan_suite(get_suite("tools-v1"), [player])
    keys = [episode.key for episode in planned.episodes]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert [episode["key"] for episode in manifest["episodes"]] == keys
    assert not list(check_suite(read_plan({**manifest, "spending": None}), "tools-v1", "standard"))  # as in a bundle
    v1 = zip(manifest["episodes"], planned.with_prompts("v1").episodes, strict=True)
    earlier = {
        **manifest,
        "spending": None,
        "cells": [{**cell, "prompts": "v1"} for cell in manifest["cells"]],
        "episodes": [{**now, "key": then.key} for now, then in v1],
    }
    assert not list(check_suite(read_plan(earlier), "tools-v1", "standard")), "a run of an earlier version is one, too"
    assert [row["key"] for row in RunFolder(folder).rows()] == keys
