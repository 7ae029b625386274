"""A rule of an episode and a field of its budget are defined once; whatever lists them has them all."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest
from typer.main import get_command

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.cli.episode_options import BUDGET, OF_RUNS
from smartplay_tools.context.prompts.budget_line import without_budget_line
from smartplay_tools.episode.config import RULES, Rules
from smartplay_tools.evaluation.runs.run_options import RunKeywords, RunOptions
from smartplay_tools.records import Record, sent_prompts
from smartplay_tools.records.remembered import remembered
from smartplay_tools.types.messages import text_of

HANOI, CRAFTER, ROCK = "Hanoi3Disk-v0", "Crafter-v0", "RockPaperScissorBasic-v0"
OWN = {
    "manual": "pinned",
    "batch": "first_act",
    "protocol": "paper",
    "observation": "both",
    "budget_line": "on",
    "first_observation": "prompt",
    "offered_tools": "useful",
    "carry": "notes",
}
"""A value of every rule that a run can have; `chain` is a number that belongs to `carry`, `wording` names a file."""
SHORT = sp.Budget(tool_calls=3)
NOTING = sp.Budget(tool_calls=3, notes_tokens=50)


@pytest.mark.parametrize("command", ["play", "eval", "sweep"])
def test_every_rule_and_every_field_of_the_budget_is_an_option(command):
    options = {parameter.name for parameter in get_command(app).commands[command].params}
    rules = set(RULES) - {"context"}
    assert options & set(RULES) == (rules if command != "play" else rules - set(OF_RUNS))
    assert set(sp.Budget.model_fields) == set(BUDGET) <= options


def test_every_option_of_a_run_and_every_rule_is_a_keyword_of_evaluate_and_sweep():
    options, rules = {field.name for field in fields(RunOptions)}, set(RULES) - {"context"}
    beside = {"engine", "tokenizer", "options", "player_options"}
    assert RunKeywords.__annotations__.keys() == options | rules | beside
    for name in options:
        assert f"{name}," in sp.evaluate.__doc__ or f"{name})" in sp.evaluate.__doc__


def test_every_rule_is_in_the_record_the_row_and_the_key(tmp_path):
    assert set(OWN) == set(RULES) - {"context", "chain", "wording"}, "a run decides the context by itself"
    keys = set()
    for name, value in [*OWN.items(), ("manual", Rules().manual)]:
        out = tmp_path / f"{name}-{value}"
        budget = NOTING if name == "carry" else SHORT
        run = sp.evaluate([CRAFTER], ["random"], out=out, trials=1, budgets=budget, executor="inline", **{name: value})
        [row] = run.rows
        start = sp.read_transcript(run.transcript(row["key"]))[0]
        assert start["config"].get(name, getattr(Rules(), name)) == row[name] == value
        keys.add(row["key"])
    assert len(keys) == len(OWN) + 1


def test_what_is_no_rule_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="A run has no argument colour; the rules are manual, batch"):
        sp.evaluate([HANOI], out="nowhere", colour="red")
    with pytest.raises(sp.InvalidArgumentError, match="`play` takes it"):
        sp.Episode(HANOI, seed=1, protocol="paper")


BOTH = {"first_observation": "prompt", "offered_tools": "useful"}


@pytest.mark.parametrize(
    ("fields", "shown"),
    [({"history": 2}, 3), ({"history": 2, "beyond_history": "mask"}, 3), ({"history": 0}, 1), ({"history": None}, 7)],
    ids=str,
)
def test_the_first_observation_is_in_the_task_as_long_as_history_lets_it(fields, shown, tmp_path):
    record, tokens = tmp_path / "one.jsonl", []
    with sp.Episode(HANOI, seed=1, manual="pinned", budget=sp.Budget(**fields), transcript=record, **BOTH) as episode:
        first, counter = episode.game.observation, episode.counter
        result = sp.play(episode, sp.get_player("rule"), on_turn=lambda at: tokens.append(at.view.tokens))
    assert (result.completed, result.steps, result.turns) == (True, 7, 7), "no call looks first"
    sent = list(sent_prompts(sp.read_transcript(record)))
    assert [first in text_of(each.prompt.messages[1]) for each in sent] == [at < shown for at in range(7)]
    assert all(each.sha256 == each.recorded_sha256 for each in sent)
    assert tokens == [counter.prompt(each.prompt.messages, each.prompt.tools) for each in sent]
    assert result.deviations["first_observation"] == {"paper": "call", "played": "prompt"}
    assert sp.replay(record).identical


@pytest.mark.parametrize(
    ("rules", "names"),
    [
        ({"manual": "pinned"}, ["observe", "act"]),
        ({"manual": "none"}, ["observe", "act"]),
        ({"manual": "pinned", "first_observation": "prompt"}, ["act"]),
        ({"first_observation": "prompt"}, ["act", "read_manual"]),
        ({}, ["observe", "act", "read_manual"]),
    ],
    ids=str,
)
def test_no_tool_is_offered_that_can_say_nothing_new(rules, names):
    with sp.Episode(ROCK, seed=1, offered_tools="useful", **rules) as episode:
        assert [tool.name for tool in episode.tools] == names
        told = text_of(episode.head[0])
        for name in ("observe", "act", "read_manual"):
            assert (f"`{name}`" in told) == (name in names)
            assert episode.call(name, {"action": "Rock"} if name == "act" else {}).is_error == (name not in names)


def test_what_was_needed_of_the_first_observation_is_seen_in_the_task(tmp_path):
    record = tmp_path / "one.jsonl"
    with sp.Episode("Lockers6-v0", seed=1, manual="pinned", transcript=record, **BOTH) as episode:
        assert sp.play(episode, sp.get_player("reader")).score == 6
    shares = remembered(Record.read(record))
    assert (shares["in view: observation"], shares.get("out of view")) == ([6, 6], None)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"protocol": "paper"}, "first_observation is a rule of prompts with tools"),
        ({"observation": "both"}, "is in words; leave observation"),
        ({"budgets": sp.Budget(strategy="pydantic-ai-newest", history=3)}, "the task does not age"),
    ],
    ids=str,
)
def test_a_first_prompt_that_cannot_be_is_refused(given, message):
    with pytest.raises(sp.InvalidArgumentError, match=message):
        sp.evaluate([CRAFTER], ["random"], out="nowhere", trials=1, first_observation="prompt", **given)


@pytest.mark.parametrize(
    "budget",
    [sp.Budget(prompt_tokens=700, recall_tokens=60), sp.Budget(result_tokens=20, beyond_result="offload")],
    ids=["capped", "offloaded"],
)
def test_the_budget_line_says_what_is_left_after_each_result(budget, tmp_path):
    record = tmp_path / "one.jsonl"
    with sp.Episode(ROCK, seed=3, budget=budget, budget_line="on", transcript=record) as episode:
        result = sp.play(episode, sp.get_player("rule"))
    events = sp.read_transcript(record)
    prompts = {event["turn"]: event["prompt"] for event in events if event["event"] == "usage"}
    *calls, last = [event for event in events if event["event"] == "call"]
    cap, words = budget.prompt_tokens, episode.counter.text
    for call in calls:
        if "manual" not in call["data"]:
            result_alone, line = call["text"].rsplit("\n", 1)
            of_cap = "" if cap is None else f" of {cap}"
            assert line == f"[prompt: {prompts[call['turn']]}{of_cap} tokens; steps left: {50 - call['data']['step']}]"
            assert words(result_alone) <= (budget.result_tokens if cap is None else math.inf), "cut before the line"
            assert without_budget_line(call["text"]) == result_alone
    assert "steps left" not in last["text"], "nothing is left to say once the game is over"
    assert (result.steps, result.end_reason, result.illegal_actions) == (50, "rollout", 0), "a reader reads past it"
    assert result.deviations["budget_line"] == {"paper": "off", "played": "on"}
    assert sp.replay(record).identical
    shown = [text_of(message) for sent in sent_prompts(events) for message in sent.prompt.messages]
    assert any(text.endswith("steps left: 20]") for text in shown)


def test_a_call_without_a_prompt_is_told_its_steps_and_recall_finds_results_without_lines():
    with sp.Episode(ROCK, seed=3, budget_line="on", context="host") as episode:
        assert episode.call("act", {"action": "Rock"}).text.endswith("\n[steps left: 49]")
        assert "steps left" not in episode.call("read_manual").text, "the manual becomes part of the head"
    budget = sp.Budget(prompt_tokens=700, recall_tokens=200, history=2)
    with sp.Episode(ROCK, seed=3, budget=budget, budget_line="on") as episode:
        talk = sp.Conversation(episode)
        for name, given in [("act", {"action": "Rock"})] * 5 + [("recall", {"query": "1"})]:
            talk.prompt()
            [answer] = talk.receive(sp.call(name, **given))
    assert answer.text.startswith('Step 1, after act("Rock"):\nYou chose Rock')
    assert answer.text.count("steps left") == 1
    with pytest.raises(sp.InvalidArgumentError, match="the paper's protocol has none"):
        sp.evaluate([ROCK], ["random"], out="nowhere", trials=1, budget_line="on", protocol="paper")
