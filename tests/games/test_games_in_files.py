"""Games in files: `FILE.py:NAME` wherever a game is named, with the file's digest on record, which imports no file."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.summary import summarize
from smartplay_tools.evaluation.runs.plan import make_cells
from smartplay_tools.games import GAMES, get_spec, specs
from smartplay_tools.records import Record, replay, resume
from tests.evaluation.command import result_of as command

CODE = (Path(__file__).parents[1] / "data" / "nim.py").read_text(encoding="utf-8")
NIM = "nim.py:SPEC"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with the file, known to nobody yet."""
    monkeypatch.setattr(specs.IN_FILES, "read", {})
    monkeypatch.chdir(tmp_path)
    Path("nim.py").write_text(CODE, encoding="utf-8")
    return tmp_path


def forget():
    """Forget every game in a file, as another process would."""
    specs.IN_FILES.read.clear()
    GAMES._specs.pop("Nim-v0", None)


def played(game=NIM):
    events = []
    with sp.Episode(game, seed=2, transcript=events) as episode:
        sp.play(episode, sp.get_player("random"))
    return events


def test_a_record_names_the_file_without_its_folders_and_has_its_digest(folder):
    config = played(f"{folder}/nim.py:SPEC")[0]["config"]
    assert (config["game"], config["game_file"]) == ("Nim-v0", NIM)
    assert config["game_sha256"] == sha256(CODE.encode()).hexdigest()
    assert "game_file" not in played("Hanoi3Disk-v0")[0]["config"]


def test_a_record_imports_no_file_by_itself():
    events = played()
    assert replay(events).identical
    forget()
    for play_again in (replay, lambda record: resume(record, transcript=[])):
        with pytest.raises(sp.InvalidArgumentError, match=r"played with the game nim\.py:SPEC; name it with --game"):
            play_again(events)
    Path("nim.py").rename("moved.py")
    get_spec("moved.py:SPEC")
    assert replay(events).identical
    forget()
    Path("nim.py").write_text(f"{CODE}\n# changed\n", encoding="utf-8")
    get_spec(NIM)
    with pytest.raises(sp.InvalidArgumentError, match="has changed since the record was made"):
        replay(events)


def test_two_files_with_one_id_are_two_games_and_a_run_of_them_is_replayed_with_both():
    Path("other.py").write_text(CODE.replace("10 +", "20 +"), encoding="utf-8")
    run = sp.evaluate([NIM, "other.py:SPEC"], ["random"], trials=2, out="run", executor="inline")
    assert {row["game"] for row in run.rows} == {"Nim-v0"}
    assert len({row["key"] for row in run.rows}) == 4
    assert [each.cell.game_sha256 for each in summarize(run.rows).cells] == [
        sha256(Path(file).read_bytes()).hexdigest() for file in ("nim.py", "other.py")
    ]
    firsts = [Record.read(run.transcript(row["key"])).config.spec.load() for row in run.rows]
    assert len(set(firsts)) == 2

    def replayed(*options):
        forget()
        done = command("replay", "run", "--workers", 1, *options)
        return done.exit_code, done.output

    code, output = replayed("--game", NIM)
    assert code == 3
    assert "2 of 4 episodes were not replayed" in output
    assert "Nim-v0: The record was played with the game other.py:SPEC; name it with --game" in output
    found = json.loads(replayed("--game", NIM, "--json")[1])
    assert (
        sorted((each["differences"], each["not_replayed"] is None) for each in found)
        == [([], False)] * 2 + [([], True)] * 2
    )
    for file in ("nim.py", "other.py"):
        Path(file).rename(f"moved_{file}")
    both = ("--game", "moved_nim.py:SPEC", "--game", "moved_other.py:SPEC")
    assert replayed(*both) == (0, "identical: all 4 episodes of run\n")
    rows = Path("run/results.jsonl")
    rows.write_text(rows.read_text().replace('"steps": ', '"steps": 9', 1))
    code, output = replayed("--game", "moved_nim.py:SPEC")
    assert code == 1
    assert "1 of 4 episodes differ" in output
    assert "2 of 4 episodes were not replayed" in output


@pytest.mark.parametrize(
    ("game", "sentence"),
    [
        ("nowhere.py:SPEC", "There is no file nowhere.py; name a game of your own as FILE.py:SETTING."),
        ("nim.py:Nim", "nim.py has no setting 'Nim'; name a game of it as nim.py:SETTING."),
        ("raises.py:SPEC", "raises.py cannot be imported: ZeroDivisionError: division by zero."),
        ("taken.py:SPEC", "Hanoi3Disk-v0 is a setting of the benchmark; give yours another id."),
    ],
)
def test_what_cannot_be_loaded_is_one_sentence(game, sentence):
    Path("raises.py").write_text("1 / 0", encoding="utf-8")
    Path("taken.py").write_text(CODE.replace("Nim-v0", "Hanoi3Disk-v0"), encoding="utf-8")
    with pytest.raises(sp.InvalidArgumentError) as caught:
        sp.Episode(game, seed=1)
    assert str(caught.value) == sentence


@pytest.mark.slow
def test_the_commands_take_it():
    assert command("manual", NIM).output.startswith("Take the last match.")
    assert command("play", NIM, "--player", "random", "--quiet", "--transcript", "a.jsonl").exit_code == 0
    asked = ("--games", NIM, "--players", "random", "--trials", 2, "--workers", 1, "--quiet")
    assert command("eval", *asked, "--out", "run").exit_code == 0
    swept = command("sweep", *asked, "--history", "1,5", "--out", "swept")
    assert swept.exit_code == 0, swept.output
    for command_of_another_process in (
        ("results", "run"),
        ("report", "run", "--out", "run.html", "--game", NIM),
        ("replay", "run", "--game", NIM),
        ("replay", "a.jsonl", "--game", NIM),
    ):
        forget()
        done = command(*command_of_another_process)
        assert done.exit_code == 0, done.output
    forget()
    assert command("replay", "run").exit_code == 3
    assert command("replay", "a.jsonl").exit_code == 3


@pytest.mark.parametrize("executor", ["inline", "async", pytest.param("processes", marks=pytest.mark.slow)])
def test_workers_of_every_executor_load_it_from_where_it_is(executor, folder, monkeypatch):
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    run = sp.evaluate([f"../{NIM}"], ["random"], trials=2, executor=executor, workers=2, out=folder / "run")
    assert len(run.rows) == 2
    assert run.folder.manifest().game_files == {sha256(CODE.encode()).hexdigest(): "../nim.py"}
    assert all("elsewhere" not in run.transcript(row["key"]).read_text(encoding="utf-8") for row in run.rows)


def test_a_run_continues_with_the_file_that_it_was_planned_with_or_plays_another_game():
    first = sp.evaluate([NIM], ["random"], trials=1, out="run", executor="inline")
    config = Record.read(first.transcript(first.rows[0]["key"])).config
    Path("nim.py").write_text(f"{CODE}\n# changed\n", encoding="utf-8")
    forget()
    with pytest.raises(sp.InvalidArgumentError, match="has changed since its episodes were planned"):
        specs.load_game(NIM, config.game_sha256)
    second = make_cells([NIM], ["random"], [sp.Budget()])[0].with_seed(config.seed)
    assert second.key != config.key


def test_a_person_plays_it_in_a_browser_and_a_host_of_mcp_continues_it(folder):
    pytest.importorskip("starlette")
    from smartplay_mcp import open_episode

    from smartplay_tools.web.site import BrowserGames

    assert BrowserGames([NIM], "played").games == ("Nim-v0",)
    with open_episode(NIM, seed=3, transcript=folder / "a.jsonl") as first:
        first.call("act", {"action": "Take 3"})
    forget()
    with open_episode(NIM, seed=3, transcript=folder / "a.jsonl") as again:
        assert again.stats.steps == 1
