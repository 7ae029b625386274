"""A rule of an episode and a field of its budget are defined once; whatever lists them has them all."""

from __future__ import annotations

from dataclasses import fields

import pytest
from typer.main import get_command

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.cli.episode_options import BUDGET, OF_RUNS
from smartplay_tools.episode.config import RULES, Rules
from smartplay_tools.evaluation.runs.run_options import RunKeywords, RunOptions, read_run_file

HANOI, CRAFTER = "Hanoi3Disk-v0", "Crafter-v0"
OWN = {"manual": "pinned", "batch": "first_act", "protocol": "paper", "observation": "both", "carry": "notes"}
"""A value of every rule that a run can have; `chain` is a number that belongs to `carry`."""
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
    assert set(OWN) == set(RULES) - {"context", "chain"}, "a run decides the context by itself"
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


@pytest.mark.parametrize("name", OWN)
def test_every_rule_can_be_set_in_a_run_file(name, tmp_path):
    path = tmp_path / "run.toml"
    path.write_text(f'games = ["{HANOI}"]\n{name} = "{OWN[name]}"\n')
    assert read_run_file(path)[0].rules == {name: OWN[name]}
    path.write_text(f'games = ["{HANOI}"]\n{name} = "telepathy"\n')
    with pytest.raises(sp.InvalidArgumentError, match=f"{name} must be one of"):
        read_run_file(path)


def test_what_is_no_rule_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="A run has no argument colour; the rules are manual, batch"):
        sp.evaluate([HANOI], out="nowhere", colour="red")
    with pytest.raises(sp.InvalidArgumentError, match="`play` takes it"):
        sp.Episode(HANOI, seed=1, protocol="paper")
