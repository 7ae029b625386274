"""The command line, as a user types it."""

from __future__ import annotations

import json
import re
from importlib.metadata import version
from importlib.util import find_spec

import pytest

import smartplay_tools as sp
from smartplay_tools.cli import PANELS
from tests.evaluation.command import result_of as run

HANOI, RPS = "Hanoi3Disk-v0", "RockPaperScissorBasic-v0"


def test_games_lists_every_setting():
    shown = run("games").output
    assert all(name in shown for name in sp.GAMES)
    rows = json.loads(run("games", "--json").output)
    assert {row["id"]: row["challenges"] for row in rows} == {name: sp.GAMES[name].challenges for name in sp.GAMES}


def test_manual_prints_the_manual():
    assert run("manual", HANOI).output == sp.GAMES[HANOI].make().manual + "\n"


def test_play_shows_the_game_and_its_result(tmp_path):
    path = tmp_path / "play.jsonl"
    result = run("play", HANOI, "--seed", 7, "--prompt-tokens", 600, "--transcript", path)
    assert result.exit_code == 0
    assert "prompt 590/600 tokens" in result.output
    assert "turns dropped" in result.output
    assert "100% of the human score" in result.output
    assert run("replay", path).exit_code == 0


def test_play_prints_json_for_machines():
    printed = run("play", HANOI, "--player", "random", "--json").output
    assert sp.EpisodeResult.model_validate_json(printed).game == HANOI


def test_play_takes_every_episode_option():
    caps = "--history 2 --prompt-tokens 2000 --reply-tokens 100 --episode-tokens none --result-tokens auto"
    rest = "--tool-calls 50 --slack 0.5 --manual pinned --batch first_act --tokenizer approximate"
    result = sp.EpisodeResult.model_validate_json(run("play", HANOI, "--json", *caps.split(), *rest.split()).output)
    assert result.deviations["history"] == {"paper": 30, "played": 2}
    assert result.completed


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["play", "Hanoi3Disc-v0"], "did you mean Hanoi3Disk-v0"),
        (["play", "hanoi"], "did you mean Hanoi3Disk-v0 or Hanoi4Disk-v0?"),
        (["play", "Chess"], "`smartplay-tools games` lists all."),
        (["play", HANOI, "--player", "rul"], "did you mean rule"),
        (["play", HANOI, "--slack", "2"], "--slack 2.0"),
        (["play", HANOI, "--history", "few"], "--history few"),
        (["play", HANOI, "--prompt-tokens", "60"], "cannot hold the head"),
        (["play", HANOI, "--prompt-tokens", "1e3"], "it is a whole number such as 2,000, or none."),
        (["play", HANOI, "--prompt-tokens", "0,060"], "cannot hold the head"),
        (["play", HANOI, "--transcript", "none/a.jsonl"], "There is no folder none for a.jsonl."),
        (["play", HANOI, "--option", "colour"], "write it as KEY=VALUE"),
        (["eval", "--games", HANOI, "--out", ""], "--out is empty"),
        (["play", HANOI, "--option", "colour=red"], "has no option colour"),
        (["replay", "no-such-file.jsonl"], "There is no file"),
        (["serve", "mcp", HANOI, "--http", "--transcript", "a.jsonl"], "give a folder by --out"),
        (["serve", "mcp", HANOI, "--out", "runs"], "give the record's file by --transcript"),
    ],
)
def test_what_a_user_gets_wrong_is_one_sentence_and_exit_code_2(words, sentence):
    result = run(*words)
    assert result.exit_code == 2
    assert sentence in result.stderr
    assert result.stderr.startswith("smartplay-tools: ")
    assert result.stderr.count("\n") == 1


def test_replay_tells_the_first_difference_and_fails(tmp_path):
    path = tmp_path / "play.jsonl"
    run("play", HANOI, "--transcript", path, "--quiet")
    path.write_text(path.read_text().replace("[2, 1], top", "[2, 0], top", 1))
    result = run("replay", path)
    assert result.exit_code == 1
    assert "differs: Event" in result.stderr
    assert json.loads(run("replay", path, "--json").output)["differences"]


@pytest.mark.slow
def test_demo_plays_trims_and_verifies(tmp_path):
    result = run("demo", "--out", tmp_path)
    assert result.exit_code == 0
    assert result.output.count("identical") == 3
    assert len(list(tmp_path.glob("*.jsonl"))) == 3
    assert result.output.count("Hanoi3Disk-v0, rule, prompts <= 600") == 1, "nothing is printed twice"
    assert "The window left out up to" in result.output
    assert "view --play any" in result.output
    if find_spec("jinja2") is not None:
        assert (tmp_path / "demo.html").exists()


def test_the_demo_takes_a_player_with_options_and_says_how_long_it_takes(tmp_path, monkeypatch):
    monkeypatch.setattr("smartplay_tools.cli.demo.PROGRESS_SECONDS", 0)
    monkeypatch.setattr("smartplay_tools.cli.demo.GAMES", {HANOI: 600})
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow.py").write_text(
        "import smartplay_tools as sp\n"
        "class Slow:\n"
        "    name = 'slow'\n"
        "    def __init__(self, *, of): self._of = sp.get_player(of)\n"
        "    def reply(self, prompt): return self._of.reply(prompt)\n"
    )
    result = run("demo", "--out", tmp_path, "--player", "slow.py:Slow", "--player-option", "of=rule")
    assert "played by slow" in result.output
    assert re.search(r"\d+ turns in \d+ s; about 0 s left", result.output)
    refused = run("demo", "--out", tmp_path, "--player-option", "of=rule")
    assert "name one with --player" in refused.stderr


@pytest.mark.parametrize("command", ["games", "manual", "play", "replay", "demo", "serve openai"])
def test_every_command_has_help_with_an_example(command):
    assert f"Example: smartplay-tools {command}" in " ".join(run(*command.split(), "--help").output.split())


def test_the_help_has_every_group():
    listed = run("--help").output
    assert all(panel in listed for panel in PANELS)


def test_the_version():
    result = run("--version")
    assert sp.__version__ == version("smartplay-tools")
    assert (result.exit_code, result.output) == (0, f"smartplay-tools {sp.__version__}\n")


def test_a_game_is_ended_after_some_steps_and_the_record_replays(tmp_path):
    record = tmp_path / "record.jsonl"
    words = ("play", "Crafter-v0", "--player", "random", "--steps", 7, "--transcript", record, "--json")
    result = sp.EpisodeResult.model_validate_json(run(*words).output)
    assert (result.steps, result.end_reason) == (7, "rollout")
    assert result.deviations["rollout"] == {"paper": 10_000, "played": 7}
    assert sp.replay(record).identical


# A player of one's own, in a file.

PLAYERS = """
import smartplay_tools as sp
from smartplay_tools.players import call


class Stubborn:
    name = "stubborn"

    def reply(self, prompt):
        return sp.Reply(call("act", action="Rock"))


class Seeded(Stubborn):
    name = "seeded"

    def __init__(self, *, seed, action="Paper"):
        self.action = action

    def reply(self, prompt):
        return sp.Reply(call("act", action=self.action))


class Nameless:
    def reply(self, prompt):
        return sp.Reply(call("act", action="Rock"))


class Idle:
    name = "idle"
"""


@pytest.fixture
def players(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(PLAYERS, encoding="utf-8")
    return file


@pytest.mark.parametrize("name", ["Stubborn", "Seeded"])
def test_a_class_in_a_file_plays(players, name):
    result = run("play", RPS, "--player", f"{players}:{name}", "--json")
    assert sp.EpisodeResult.model_validate_json(result.output).steps == 50


@pytest.mark.slow
def test_a_class_in_a_file_plays_runs_in_worker_processes(players, tmp_path):
    name, out = f"{players}:Seeded", tmp_path / "run"
    words = ("eval", "--games", RPS, "--players", f"{name},rule", "--trials", 2, "--out", out, "--workers", 2, "--json")
    result = run(*words, "--player-option", f"{name}.action=Scissor")
    assert result.exit_code == 0, result.output
    (row, *_) = [json.loads(line) for line in (out / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    assert (row["player"], row["player_options"]) == (name, {"action": "Scissor"})


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("mine.py:Nobody", "has no class 'Nobody'"),
        ("theirs.py:Stubborn", "There is no file"),
        ("broken.py:Stubborn", "cannot be imported: ZeroDivisionError"),
        ("mine.py:Nameless", "needs a `name` attribute"),
        ("mine.py:Idle", "needs a method `reply(prompt)`"),
    ],
)
@pytest.mark.parametrize("command", ["play", "eval"])
def test_what_is_no_player_in_a_file_is_one_true_sentence(players, command, name, sentence, tmp_path):
    (tmp_path / "broken.py").write_text("1 / 0", encoding="utf-8")
    who = f"{tmp_path / name}"
    words = {"play": (RPS, "--player", who), "eval": ("--games", RPS, "--players", who, "--out", tmp_path / "run")}
    result = run(command, *words[command])
    assert result.exit_code == 2
    assert sentence in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "run" / "episodes").exists() or not list((tmp_path / "run" / "episodes").iterdir())
