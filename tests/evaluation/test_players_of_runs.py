"""Players with options of their own, and that no credential comes to be on disk."""

from __future__ import annotations

import codecs
import json
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.plan import make_cells, plan_episodes
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.evaluation.runs.run_options import RunOptions
from smartplay_tools.evaluation.runs.runner import run_plan
from smartplay_tools.registry import read_file
from tests.evaluation.command import run
from tests.evaluation.players import Waiting
from tests.evaluation.servers import calling, completion, serving

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"
SECRET = "sk-Ab3dE6gH9jK2mN5pQ8sT1vW4"


@pytest.mark.slow
def test_an_option_and_a_server_can_be_one_players(tmp_path):
    reply = completion(calling("act", action="1"))
    with serving(lambda body, number: reply) as (one, first), serving(lambda body, number: reply) as (other, second):
        code, _, stderr = run(
            *("eval", "--games", HANOI, "--players", "openai:gpt-4.1,openai:b,rule", "--trials", 1),
            *("--base-url", f"openai:gpt-4.1={one}", "--base-url", f"openai:b={other}", "--out", tmp_path),
            *("--history", 3, "--player-option", 'openai:gpt-4.1.parameters={"temperature": 1}'),
        )
    assert code == 0, stderr
    assert {body["model"] for body in first} == {"gpt-4.1"}
    assert {body["model"] for body in second} == {"b"}
    assert {body.get("temperature") for body in first} == {1}
    assert {body.get("temperature") for body in second} == {None}


def test_one_player_has_so_many_episodes_at_a_time(tmp_path):
    Waiting.most_at_once = 0
    config = PlayerConfig(name="waiting", factory=Waiting, concurrency=2)
    cells = make_cells([HANOI], [config], [sp.Budget()])
    run_plan(plan_episodes(cells, trials=6), tmp_path, [config], RunOptions(workers=6))
    assert Waiting.most_at_once == 2


@pytest.mark.parametrize(
    "option",
    [
        ("--player-option", f"api_key={SECRET}"),
        ("--player-option", f'default_headers={{"Authorization": "Bearer {SECRET}"}}'),
        ("--player-option", f'parameters={{"extra": "{SECRET}"}}'),
        ("--player-option", 'parameters={"extra": "the-value-of-my-variable"}'),
        ("--base-url", "http://host/v1?key=0123456789"),
        ("--base-url", "http://me:password@host/v1"),
    ],
)
def test_a_credential_in_an_option_is_refused_before_anything_is_written(tmp_path, monkeypatch, option):
    monkeypatch.setenv("SOME_SERVICE_TOKEN", "the-value-of-my-variable")
    code, _, stderr = run("eval", "--games", HANOI, "--players", "openai:m", *option, "--out", tmp_path / "run")
    assert code == 2
    assert "looks like a credential" in stderr
    assert SECRET not in stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_key_from_the_environment_is_in_no_file_of_a_run(tmp_path, monkeypatch):
    monkeypatch.setenv("MY_SERVERS_KEY", SECRET)
    with serving(lambda body, number: completion(calling("act", action="1"))) as (url, _):
        model = PlayerConfig(name="openai:m", options={"base_url": url}, api_key_env="MY_SERVERS_KEY")
        sp.evaluate([HANOI], [model], budgets=sp.Budget(history=5), trials=1, out=tmp_path / "run")
    assert run("report", tmp_path / "run", "--out", tmp_path / "run" / "page.html")[0] == 0
    files = [path for path in (tmp_path / "run").rglob("*") if path.is_file()]
    assert len(files) > 4
    for path in files:
        assert SECRET.encode() not in path.read_bytes(), path


def test_a_variable_that_is_not_set_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.delenv("MY_SERVERS_KEY", raising=False)
    model = PlayerConfig(name="openai:m", api_key_env="MY_SERVERS_KEY")
    with pytest.raises(sp.InvalidArgumentError, match="taken from the variable MY_SERVERS_KEY, which is not set"):
        sp.evaluate([HANOI], [model], trials=1, out=tmp_path / "run")


def test_ordinary_options_are_no_credentials():
    PlayerConfig(name="openai:m")
    ordinary = {
        "max_tokens": 5,
        "pad_token": "<pad>",
        "limit_field": "max_tokens",
        "base_url": "https://host:8000/v1?v=2",
    }
    (cell,) = make_cells([HANOI], [PlayerConfig(name="openai:m", options=ordinary)], [sp.Budget()])
    assert json.loads(json.dumps(cell.player_options)) == ordinary


def test_a_byte_order_mark_is_skipped_in_a_file_that_a_user_writes(tmp_path):
    """Windows' editors put one in front of text in UTF-8."""
    (tmp_path / "nim.py").write_bytes(codecs.BOM_UTF8 + Path("tests/data/nim.py").read_bytes())
    assert read_file(f"{tmp_path / 'nim.py'}:SPEC", is_one=lambda held: True).value.id == "Nim-v0"
