"""`smartplay-tools eval` and `merge` as a user runs them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from functools import partial

import pytest
from rich.console import Console

import smartplay_tools as sp
from smartplay_tools.cli.progress import showing
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import run_plan
from tests.evaluation.command import run

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


def test_a_run_ends_with_its_tables(tmp_path):
    command = ("eval", "--games", f"{BANDIT},{HANOI}", "--players", "rule", "--trials", 2, "--executor", "inline")
    code, output, progress = run(*command, "--out", tmp_path)
    assert code == 0
    for word in (BANDIT, HANOI, "% human", f"smartplay-tools report {tmp_path}"):
        assert word in output
    assert "4/4 episodes" in progress
    # The same command again plays nothing and shows the same.
    assert run(*command, "--out", tmp_path)[:2] == (0, output)
    assert run("results", tmp_path)[0] == 0


def test_a_machine_gets_json_and_nothing_else(tmp_path):
    code, output, progress = run(
        "eval", "--games", HANOI, "--trials", 1, "--executor", "inline", "--json", "--out", tmp_path
    )
    assert (code, progress) == (0, "")
    summary = json.loads(output)
    assert (summary["planned"], summary["finished"], summary["stopped"]) == (1, 1, None)
    assert summary["cells"][0]["score"]["mean"] == 3


def test_an_incomplete_run_says_so_and_is_no_success(tmp_path):
    arguments = ("eval", "--games", HANOI, "--trials", 1, "--executor", "inline", "--out", tmp_path)
    code, _, stderr = run(
        *arguments, "--players", "openai:nobody", "--base-url", "http://127.0.0.1:9/v1", "--player-option", "retries=0"
    )
    assert code == 1
    assert "1 of 1 episodes are not finished" in stderr
    assert "The same command retries them." in stderr
    assert {failure["end_reason"] for failure in RunFolder(tmp_path).failures()} == {"player_error"}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (["--suite", "icml"], "There is no suite 'icml'; the suites are paper, tools-v1."),
        (["--prompt-tokens", "50"], f"{HANOI}, rule, prompts <= 50: prompt_tokens=50 cannot hold the head"),
        (["--shard", "half"], "--shard half is invalid; write it as 1/4."),
        (["--price", "3,4"], "--price 3,4 names no player"),
        (["--price", "rule=3"], "'3' is not a price"),
        (["--price", "ruel=3,4"], "The run has no player ruel that could have a price; it has rule."),
        (["--player-option", "api_key=x"], "give it in the environment"),
        (["--player-option", "temperature"], "--player-option temperature has no value"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, wrong, sentence):
    code, _, stderr = run("eval", "--games", HANOI, "--executor", "inline", "--out", tmp_path, *wrong)
    assert code == 2
    assert sentence in stderr
    assert stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_dry_run_tells_the_price_and_plays_nothing(tmp_path):
    asked = f"--games {HANOI},{BANDIT} --players openai:gpt-5-mini --trials 10 --dry-run"
    arguments = ("eval", *asked.split(), "--out", tmp_path / "run")
    code, output, _ = run(*arguments, "--reply-tokens", 100, "--json")
    assert code == 0
    hanoi, bandit = json.loads(output)
    assert (hanoi["episodes"], hanoi["reply_length"]) == (10, [75, 100])
    assert hanoi["calls"]["low"] < 10 * 8 < 10 * 31 < hanoi["calls"]["high"]
    dollars = (bandit["prompt_tokens"]["high"] * 0.25 + bandit["reply_tokens"]["high"] * 2) / 1e6
    assert bandit["cost"]["high"] == pytest.approx(dollars, rel=0.1)
    assert 0 < bandit["cost"]["low"] < bandit["cost"]["expected"] < bandit["cost"]["high"]
    assert not (tmp_path / "run").exists()
    shards = [json.loads(run(*arguments, "--shard", f"{number}/4", "--json")[1]) for number in (1, 2, 3, 4)]
    assert sum(cell["episodes"] for shard in shards for cell in shard) == 20
    assert all(cell["episodes"] in (2, 3) for shard in shards for cell in shard)
    _, table, _ = run(*arguments)
    assert "assumed to have 75 to 300 tokens" in table
    assert "--reply-tokens makes it a cap" in table
    capped = run(*arguments, "--run-cost", 0.01, "--run-tokens", 10**9)[1]
    assert "--run-cost $0.01 will pause the run" in capped
    assert "--run-tokens 1.0G is enough for the whole run" in capped
    assert re.search(r"all +20 ", table)


def test_a_dry_run_obeys_the_caps_of_an_episode_and_the_length_that_is_assumed():
    arguments = ("eval", "--games", BANDIT, "--players", "openai:gpt-5-mini", "--trials", 1, "--dry-run", "--json")
    (free,) = json.loads(run(*arguments)[1])
    (calls,) = json.loads(run(*arguments, "--tool-calls", 10)[1])
    (short,) = json.loads(run(*arguments, "--history", 1)[1])
    (wordy,) = json.loads(run(*arguments, "--assume-reply-tokens", 900)[1])
    (tokens,) = json.loads(run(*arguments, "--episode-tokens", 5000)[1])
    assert calls["calls"]["high"] <= 10 * 1.05
    assert short["prompt_tokens"]["high"] < free["prompt_tokens"]["high"] / 2
    assert wordy["reply_length"] == [900, 900]
    assert wordy["reply_tokens"]["low"] > free["reply_tokens"]["high"]
    # Short replies leave more room for prompts, so the two upper ends are not of one episode.
    assert tokens["prompt_tokens"]["expected"] + tokens["reply_tokens"]["expected"] <= 5000
    assert max(tokens["prompt_tokens"]["high"], tokens["reply_tokens"]["high"]) <= 5000 * 1.1


@pytest.mark.slow
def test_a_person_who_leaves_ends_their_own_episodes_alone(tmp_path):
    arguments = ["--games", HANOI, "--players", "human,rule", "--trials", "2", "--out", str(tmp_path), "--quiet"]
    command = [sys.executable, "-m", "smartplay_tools", "eval", *arguments]
    subprocess.run(command, input="q\nq\n", capture_output=True, text=True, timeout=120)
    rows = (tmp_path / "results.jsonl").read_text().splitlines()
    assert [json.loads(row)["player"] for row in rows] == ["rule", "rule"]


def test_shards_are_merged_by_command(tmp_path):
    arguments = ("eval", "--games", HANOI, "--players", "random", "--trials", 4, "--executor", "inline")
    for number in (1, 2):
        assert run(*arguments, "--shard", f"{number}/2", "--out", tmp_path / str(number))[0] == 0
    code, output, _ = run("merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "whole")
    assert (code, output) == (0, f"{tmp_path / 'whole'}: 4 of 4 episodes are finished.\n")
    assert run("merge", tmp_path / "1", "--out", tmp_path / "whole")[0] == 2
    code, output, _ = run("merge", tmp_path / "1", "--out", tmp_path / "half")
    assert (code, output) == (1, f"{tmp_path / 'half'}: 2 of 4 episodes are finished.\n")


def test_a_terminal_shows_how_far_a_run_is(tmp_path, capsys):
    plan = plan_episodes(make_cells([BANDIT, HANOI], ["rule", "random"], [sp.Budget()]), trials=2)
    console = Console(force_terminal=True, width=120)
    run_plan(plan, tmp_path, options=RunOptions(executor="inline"), display=partial(showing, console))
    assert "8/8 episodes" in re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", capsys.readouterr().out)
