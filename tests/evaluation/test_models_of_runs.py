"""Runs with models behind a server: an error of the server is found with one attempt and reported in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.records.rows import unplayed
from tests.evaluation.command import run
from tests.evaluation.servers import calling, completion, refusal, serving
from tests.evaluation.window_rows import row

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"
MODEL = "openai:m"
FRAMEWORKS = [pytest.param(player, marks=pytest.mark.slow) for player in ("anthropic:m", "langchain:openai:m")]
"""Players whose libraries take a second to import."""


def play(out: Path, url: str, *more: object) -> tuple[int, str, str]:
    short = ("--history", 3)  # short prompts are read in less time
    return run("eval", "--games", BANDIT, "--players", MODEL, "--base-url", url, "--out", out, *short, *more)


def first_arm(body: dict, number: int) -> tuple[int, dict]:
    return completion(calling("act", action="1"), prompt_tokens=100, completion_tokens=10)


# A server that refuses.


@pytest.mark.parametrize(
    ("status", "code", "text"),
    [
        (401, "invalid_api_key", "Incorrect API key provided"),
        (403, "forbidden", "You have no access"),
        (404, "model_not_found", "The model m does not exist"),
    ],
)
def test_a_refusal_for_good_stops_the_run_after_one_attempt(tmp_path, status, code, text):
    with serving(lambda body, number: refusal(status, code, text)) as (url, bodies):
        exit_code, _, stderr = play(tmp_path, url, "--trials", 20)
    assert exit_code == 1
    assert len(bodies) == 1
    assert len(RunFolder(tmp_path).failures()) == 1
    (sentence,) = [line for line in stderr.splitlines() if line.startswith(MODEL)]
    assert text in sentence
    assert "Once that is corrected, the same command continues the run." in sentence


FLAGGED = (403, "x", "This model requires moderation. Your input was flagged.")


ONE_REQUEST = [(403, "x", "No."), (402, "x", "Fewer max_tokens."), (404, "x", "No."), FLAGGED]


@pytest.mark.parametrize(("refused", "at"), [*((refused, 5) for refused in ONE_REQUEST), (FLAGGED, 0)])
def test_a_refusal_of_one_request_stops_no_run(tmp_path, refused, at):
    """What was refused goes on from its record; a filter that refuses a later prompt ends the episode."""
    with serving(lambda body, number: refusal(*refused) if number == at else first_arm(body, number)) as (url, bodies):
        assert play(tmp_path, url, "--trials", 2)[0] == 0
    rows = RunFolder(tmp_path).rows()
    steps = [row["steps"] for row in rows]
    assert (len(rows), len(bodies)) == (2, sum(steps) + 1)
    assert (max(steps), min(steps) < 50) == (50, refused is FLAGGED and at > 0)
    assert sum(row["tokens"]["provider"].get("refused", 0) for row in rows) == (refused is FLAGGED)


def test_a_server_that_is_not_there_is_tried_out_by_one_episode_and_named(tmp_path, caplog):
    arguments = ("--trials", 20, "--player-option", "retries=1", "--player-option", "pause=0.01")
    assert play(tmp_path, "http://127.0.0.1:9/v1", *arguments)[0] == 1
    (failure,) = RunFolder(tmp_path).failures()
    assert "http://127.0.0.1:9/v1/chat/completions" in failure["error"]
    assert "http://127.0.0.1:9/v1/chat/completions" in caplog.text


@pytest.mark.parametrize("player", ["openai:m", "openai-responses:m", *FRAMEWORKS])
def test_a_missing_key_is_one_sentence_before_anything_is_written(tmp_path, monkeypatch, player):
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    code, _, stderr = run("eval", "--games", BANDIT, "--players", player, "--out", tmp_path / "run")
    assert code == 2
    assert "_API_KEY" in stderr
    assert stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()


# A server that answers without tool calls.


@pytest.mark.slow
def test_an_episode_without_any_action_is_flagged_with_the_likely_cause(tmp_path):
    as_text = {"content": '<tool_call>{"name": "act", "arguments": {"action": "1"}}</tool_call>'}
    with serving(lambda body, number: completion(as_text)) as (url, _):
        code, _, stderr = play(tmp_path, url, "--trials", 2)
    assert code == 1
    assert f"2 episodes of {MODEL} at {BANDIT} ended without any action" in stderr
    assert "it writes its calls as text" in stderr
    assert "--tool-call-parser hermes" in stderr
    shown = run("results", tmp_path)[1]
    assert "--tool-call-parser hermes" in shown
    assert f"{MODEL}!" in shown, "it is marked in the table"
    assert "!: 2 without any action" in shown
    page = tmp_path / "page.html"
    assert run("report", tmp_path, "--out", page)[0] == 0
    words = page.read_text(encoding="utf-8").partition('id="episodes"')[0]
    assert f"2 episodes of {MODEL} at {BANDIT} ended without any action" in words


def test_the_cause_of_an_episode_without_any_action_is_what_most_of_its_replies_were():
    def cause(idle=0, turns=4, **ends):
        counts = {"turns": turns, "idle_replies": idle, "malformed_calls": 0, "illegal_actions": 0}
        played = row(steps=0, end_reason="stalled_turns", **counts)
        played["tokens"]["provider"] = ends
        return unplayed([played])[0]

    assert "cut at their length" in cause(cut=3)
    assert "refused by the model" in cause(refused=3)
    assert cause(idle=3, cut=2, refused=2).endswith("the end is stalled turns.")
    assert "has called no tool" in cause(idle=1, turns=1)


# The command `check`.


def test_check_says_that_a_model_can_be_played_with(tmp_path):
    looks = completion(calling("observe", "read_manual"), prompt_tokens=120, completion_tokens=20)
    acts = completion(calling("act", action="1"), prompt_tokens=120, completion_tokens=20)
    with serving(lambda body, number: acts if number % 3 else looks) as (url, bodies):
        command = ("check", "--players", f"{MODEL},rule", "--base-url", url)
        code, output, _ = run(*command)
        (report,) = json.loads(run(*command, "--json")[1])
    assert code == 0
    assert len(bodies) == 2 * 3, "three turns each"
    assert "no model" in output
    assert [report[name] for name in ("reachable", "tools", "ids", "parallel", "usage", "played", "acted")] == [
        True
    ] * 7
    assert report["advice"] == []
    assert max(map(len, output.splitlines())) <= 80


def test_check_does_not_ask_again_and_tells_a_server_that_only_streams():
    streams = refusal(400, "x", "This model only supports stream mode")
    with serving(lambda body, number: streams) as (url, bodies):
        code, output, _ = run("check", "--players", MODEL, "--base-url", url)
    assert (code, len(bodies)) == (1, 1)
    assert f"--player-option {MODEL}.stream=true" in output


# Continuing.


@pytest.mark.parametrize("workers", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_replies_that_were_paid_for_are_not_bought_again(tmp_path, workers):
    """Three refusals in a row end the run, those side by side counted once; the same command continues its records."""
    answered, has_credit = [], False

    def answer(body: dict, number: int) -> tuple[int, dict]:
        if not has_credit and number >= 30 and (number >= 60 or number % 10 == 0):
            return refusal(402, "insufficient_quota", "You have no credit left")
        answered.append(number)
        return first_arm(body, number)

    with serving(answer) as (url, bodies):
        code, _, stderr = play(tmp_path / "broken", url, "--trials", 3, "--workers", workers)
        assert code == 1
        assert "You have no credit left" in stderr
        assert 62 < len(bodies) < 60 + 3 * workers + 1
        has_credit = True
        assert play(tmp_path / "broken", url, "--trials", 3, "--workers", workers)[0] == 0
    assert len(answered) == 3 * 50
    with serving(first_arm) as (url, _):
        assert play(tmp_path / "whole", url, "--trials", 3)[0] == 0
    broken, whole = (RunFolder(tmp_path / name) for name in ("broken", "whole"))
    for one, other in zip(broken.rows(), whole.rows(), strict=True):
        same = {"score", "turns", "steps", "state_hash", "trial"}
        assert {name: one[name] for name in same} == {name: other[name] for name in same}
        assert sp.replay(broken.transcript(one["key"])).identical
