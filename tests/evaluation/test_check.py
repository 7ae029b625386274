"""`check`: every way in which a model cannot play has its own sentence, and exit code 1."""

from __future__ import annotations

import json
import threading
from typing import Any

import pytest

from smartplay_tools.evaluation.run_folder.folder import RunFolder
from tests.evaluation.command import run
from tests.evaluation.servers import calling, completion, refusal, serving
from tests.evaluation.test_models_of_runs import BANDIT, MODEL
from tests.loopback import Loopback

pytest.importorskip("openai")


def called(name: str, arguments: str) -> dict[str, Any]:
    call = {"id": "1", "type": "function", "function": {"name": name, "arguments": arguments}}
    return {"content": None, "tool_calls": [call]}


def cut(message: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    status, body = completion(message, prompt_tokens=100, completion_tokens=1000)
    body["choices"][0]["finish_reason"] = "length"
    return status, body


HERMES = '<tool_call>\n{"name": "act", "arguments": {"action": "1"}}\n</tool_call>'

REPLIES = {
    "arguments that are not JSON": (completion(called("act", '{"action": Rock')), "are not JSON", "--tool-call-parser"),
    "a prefix": (completion(called("functions.act", '{"action": "1"}')), "adds `functions.`", "--tool-call-parser"),
    "an unknown tool": (completion(called("move", "{}")), "`move`, which is not a tool", "observe, act, read_manual"),
    "an illegal action": (completion(called("act", '{"action": "Fly"}')), "cannot be played", "description"),
    "cut within words": (cut({"content": "<think>Let me see"}), "cut at its length", "--reply-tokens"),
    "cut within a call": (cut(called("act", '{"act')), "within a call", "--reply-tokens"),
    "a call as text": (completion({"content": HERMES}), "writes its calls as text", "--tool-call-parser hermes"),
    "reasoning alone": (
        completion({"content": None, "reasoning_content": "hm " * 9}),
        "27 characters",
        "reasoning pars",
    ),
    "words": (completion({"content": "I observe."}), "has called no tool", "tool_choice=required"),
}


@pytest.mark.parametrize("name", REPLIES)
def test_a_model_that_cannot_play_is_told_apart(name):
    answer, what, remedy = REPLIES[name]
    with serving(lambda body, number: answer) as (url, bodies):
        code, output, _ = run("check", "--players", MODEL, "--base-url", url)
    (sentence,) = [line for line in output.splitlines() if line.startswith(f"{MODEL} ") and what in line]
    assert remedy in sentence
    assert code == 1
    assert len(bodies) == 3


def test_a_model_that_errs_once_can_play():
    answers = [called("act", "{"), calling("act", action="1"), calling("act", action="1")]
    with serving(lambda body, number: completion(answers[number])) as (url, _):
        code, output, _ = run("check", "--players", MODEL, "--base-url", url)
    assert code == 0
    assert all(advice in output for advice in ("are not JSON", "does not report usage"))


def test_reasoning_that_no_usage_counts_is_counted_and_calls_without_ids_are_told():
    message = {**calling("observe", ids=False), "reasoning_content": "I take the first arm."}
    with serving(lambda body, number: completion(message, prompt_tokens=9, completion_tokens=9)) as (url, _):
        (report,) = json.loads(run("check", "--players", MODEL, "--base-url", url, "--json")[1])
    assert (report["reasoning"], report["ids"], report["parallel"]) == (3 * 6, False, False)
    assert f"{MODEL} has played no action in 3 turns; it only looks." in report["advice"]


@pytest.mark.parametrize("kind", ["text/html", "application/json"])
def test_a_web_page_is_not_a_model(kind):
    with Loopback(lambda path, body: (200, kind, b"<!doctype html><title>Hello</title>")) as server:
        code, output, _ = run("check", "--players", MODEL, "--base-url", server.url)
    assert code == 1
    assert f"{server.url} answered with" in output
    assert "usually ends in /v1" in output


def test_a_missing_v1_is_named():
    with serving(lambda body, number: refusal(404, "not_found", "Not Found")) as (url, _):
        code, output, _ = run("check", "--players", MODEL, "--base-url", url.removesuffix("/v1"))
    assert code == 1
    assert "Check the model's name and --base-url, which ends in /v1 as a rule" in output


# A run begins with one episode, until it has played an action.


def test_the_others_wait_for_the_first_action(tmp_path):
    """A server that never passes a call on is asked by one episode at a time."""
    at_once = [0, 0]
    lock = threading.Lock()

    def words(body: dict[str, Any], number: int) -> tuple[int, dict[str, Any]]:
        with lock:
            at_once[0] += 1
            at_once[1] = max(at_once)
        try:
            return completion({"content": "I think."}, prompt_tokens=10, completion_tokens=2)
        finally:
            with lock:
                at_once[0] -= 1

    with serving(words) as (url, bodies):
        command = ("eval", "--games", BANDIT, "--players", MODEL, "--base-url", url, "--trials", 3, "--out", tmp_path)
        assert run(*command)[0] == 1
    assert at_once[1] == 1
    assert len(bodies) == 9


def test_play_warns_of_replies_beyond_their_cap_and_shows_the_cost():
    message = {**calling("act", action="1"), "content": "so " * 300}
    with serving(lambda body, number: cut(message)) as (url, bodies):
        command = ("play", BANDIT, "--player", MODEL, "--base-url", url, "--quiet", "--steps", 2, "--reply-tokens", 50)
        code, output, warned = run(
            *command, "--price", f"{MODEL}=1,2", "--player-option", 'parameters={"temperature": 0}'
        )
    assert code == 0
    assert "2 of 2 replies were longer than --reply-tokens allows" in warned
    assert "2 of 2 replies were cut at their length" in warned
    assert "$0.0042" in output
    assert {body["temperature"] for body in bodies} == {0}


# Options of the server.


def test_tool_choice_goes_to_the_server(tmp_path):
    with serving(lambda body, number: completion(calling("act", action="1"))) as (url, bodies):
        command = f"eval --games {BANDIT} --players {MODEL},rule --base-url {url} --trials 1 --tool-calls 3"
        option = f"--player-option {MODEL}.tool_choice=required"
        assert run(*command.split(), *option.split(), "--executor", "inline", "--out", tmp_path)[0] == 0
    assert {body["tool_choice"] for body in bodies} == {"required"}
    model, rule = RunFolder(tmp_path).rows()
    assert model["deviations"]["tool_choice"] == {"paper": "auto", "played": "required"}
    assert "tool_choice" not in rule["deviations"]
