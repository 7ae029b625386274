"""The MineDojo engine: faulty workers, and the real package with a test double of its client."""

from __future__ import annotations

import copy
import dataclasses
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.errors import EngineError
from smartplay_tools.games.minecraft.minedojo import worker
from smartplay_tools.games.minecraft.minedojo.engine import (
    INTERPRETER,
    LOG,
    MineDojoEngine,
    _turned,
    _walked,
)
from smartplay_tools.games.minecraft.minedojo.process import WorkerProcess
from smartplay_tools.games.minecraft.observation import Observation
from smartplay_tools.games.minecraft.rules import PAPER_GOALS, Goal, Stride, strides, turn
from smartplay_tools.games.minecraft.text import describe
from smartplay_tools.games.minecraft.voxel.engine import VoxelEngine
from tests.processes import is_running, is_soon, needs_proc, needs_unix

needs_unix()
needs_proc()

GAME = "MinedojoCreative0-v0"
PLAINS = PAPER_GOALS[0]
ROOT = Path(sp.__file__).parents[1]


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """Where workers have their directories, so that a test sees what they leave behind."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def program(path: Path, *lines: str) -> str:
    """A shell script."""
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return str(path)


# A faulty worker: a program that reads requests, and these lines for each.

UNTRUSTWORTHY = {
    "a program that exits": ("sys.exit(3)", r"worker has ended \(exit code 3\)"),
    "a program that hangs": ("time.sleep(60)", "has not answered 'act' within 0.2 seconds"),
    "a program that ignores its end": (
        "signal.signal(signal.SIGTERM, signal.SIG_IGN); os.close(0); time.sleep(60)",
        "has not answered 'act' within 0.2 seconds",
    ),
    "half an answer": ("answer('{\"ok\": ')\ntime.sleep(60)", "has not answered 'act' within 0.2 seconds"),
    "no JSON": ("answer('Loaded 3131 tasks\\n')", "sent an invalid answer: b'Loaded 3131 tasks"),
    "two answers": ('answer(\'{"ok": 1}\\n{"ok": 2}\\n\')', "sent an invalid answer"),
    "a failure": ('answer(\'{"error": "EOFError: no game"}\\n\')', "has failed in 'act': EOFError: no game"),
}


def script(folder: Path, lines: str, **answers: object) -> list[str]:
    """A program that writes a word to its log, does the lines for every call of `act`, and answers the others."""
    indented = "\n".join(f"    {line}" for line in lines.splitlines())
    replies = {"make": {"minedojo": "0.1"}, "reset": 1, "close": None} | answers
    (folder / "answers.json").write_text(json.dumps({name: {"ok": value} for name, value in replies.items()}))
    path = folder / "worker.py"
    path.write_text(
        "import json, os, pathlib, signal, subprocess, sys, time\n"
        "known = json.loads(pathlib.Path(__file__).with_name('answers.json').read_text())\n"
        "def answer(text):\n    sys.stdout.write(text); sys.stdout.flush()\n"
        "print('ready', file=sys.stderr, flush=True)\n"
        "for request in sys.stdin:\n"
        "    call = json.loads(request)['call']\n"
        "    if call in known:\n"
        "        answer(json.dumps(known[call]) + '\\n'); continue\n"
        f"{indented}\n"
    )
    return [sys.executable, str(path)]


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        pytest.param(
            *how, id=name, marks=[pytest.mark.slow] * (name not in ("a program that hangs", "no JSON", "a failure"))
        )
        for name, how in UNTRUSTWORTHY.items()
    ],
)
def test_a_worker_that_fails_is_an_error_and_leaves_nothing(lines, sentence, tmp_path, temporary):
    process = WorkerProcess(script(tmp_path, lines))
    assert process.call("reset", seconds=30) == 1
    assert len(list(temporary.iterdir())) == 1
    with pytest.raises(EngineError, match=sentence) as caught:
        process.call("act", seconds=0.2 if "within" in sentence else 60)
    assert any("ready" in note for note in caught.value.__notes__)
    assert not process.alive
    assert not list(temporary.iterdir())
    process.close()


def test_an_answer_may_come_in_pieces(tmp_path):
    process = WorkerProcess(script(tmp_path, "answer('{\"ok\": [1,')\ntime.sleep(0.1)\nanswer(' 2]}\\n')"))
    assert process.call("act", seconds=30) == [1, 2]
    process.close()


def test_what_a_worker_has_started_ends_with_it(tmp_path):
    """Also processes in their own session, like the game's client, and after the end of the worker."""
    lines = (
        "child = subprocess.Popen(['sleep', '60'], start_new_session=True)\n"
        "answer(json.dumps({'ok': child.pid}) + '\\n')\n"
        "os.kill(os.getpid(), signal.SIGSTOP)"
    )
    process = WorkerProcess(script(tmp_path, lines))
    child = process.call("act", seconds=30)
    assert is_running(child)
    process.end()
    assert is_soon(lambda: not is_running(child))


def test_a_log_can_be_kept(tmp_path, temporary):
    log = tmp_path / "kept.log"
    log.write_text("before\n")
    process = WorkerProcess(script(tmp_path, "answer('1')"), log=log)
    process.call("reset", seconds=30)
    process.close()
    assert log.read_text() == "before\nready\n"
    assert not list(temporary.iterdir())


def test_a_forgotten_worker_ends(tmp_path, temporary):
    process = WorkerProcess(script(tmp_path, "answer('1')"))
    pid = process._process.pid
    del process
    assert is_soon(lambda: not is_running(pid))
    assert not list(temporary.iterdir())


def test_an_interrupt_ends_a_worker_that_would_answer_later(tmp_path):
    process = WorkerProcess(script(tmp_path, "time.sleep(60)"))
    process.call("reset", seconds=30)
    signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            process.call("act", seconds=30)
    finally:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
    assert not process.alive


KILLED = """
import subprocess, sys, time
from smartplay_tools.games.minecraft.minedojo import worker
from smartplay_tools.games.minecraft.minedojo.engine import start
process = start(sys.executable)
process.call("close", seconds=30)
mark = {}
for item in open(f"/proc/{process._process.pid}/environ", "rb").read().split(b"\\0"):
    name, _, value = item.partition(b"=")
    mark[name.decode()] = value.decode()
client = subprocess.Popen(["sleep", "60"], env={worker.FAMILY: mark[worker.FAMILY]}, start_new_session=True)
while not open(f"/proc/{client.pid}/environ", "rb").read():  # until the kernel has loaded the program
    time.sleep(0.01)
print(process._process.pid, client.pid, flush=True)
time.sleep(60)
"""
"""A program with a worker, and with a process that is of the worker's family; nothing but the worker can end that."""


def test_the_worker_ends_its_family_when_its_parent_is_killed(tmp_path, temporary):
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", KILLED]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as parent:
        script, client = map(int, parent.stdout.readline().split())
        assert is_running(script)
        assert is_running(client)
        parent.kill()
    assert is_soon(lambda: not is_running(script))
    assert is_soon(lambda: not is_running(client))
    assert is_soon(lambda: not list(temporary.iterdir()))


def test_the_worker_s_script_needs_nothing_of_this_package():
    """The worker runs isolated in MineDojo's interpreter, which does not have this package."""
    command = [sys.executable, "-I", "-S", worker.__file__]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    nowhere = {"env": {worker.FAMILY: "nobody"}, "cwd": tempfile.mkdtemp()}
    with subprocess.Popen(command, text=True, **pipes, **nowhere) as process:
        answers = []
        for request in ({"call": "close"}, {"call": "make", "task": 0, "settings": {}}):
            print(json.dumps(request), file=process.stdin, flush=True)
            answers.append(json.loads(process.stdout.readline()))
    assert answers == [{"ok": None}, {"error": "ModuleNotFoundError: No module named 'minedojo'"}]
    assert process.returncode == 0


def test_an_action_looks_for_the_goal_after_every_tick_but_that_of_its_turn():
    """The original does so, too: it walks a tick out of a goal in which the turn has ended."""
    played = []
    plains = {"pos": np.zeros(3), "yaw": [0], "pitch": [0], "biome_id": 1}
    names = ("block_name", "block_distance", "entity_name", "entity_distance")
    seen = {"location_stats": plains, "voxels": {"block_name": np.zeros(1)}, "rays": dict.fromkeys(names, np.zeros(1))}

    def step(action: np.ndarray) -> tuple[dict, float, bool, dict]:
        played.append(action.tolist())
        return seen, 0.0, False, {}

    minedojo = worker.Minedojo()
    minedojo._environment = SimpleNamespace(step=step)
    turned, *walked = _turned(90), _walked(Stride(1, jump=True)), _walked(Stride(-1, jump=False))
    assert minedojo.act([turned, *walked], goal=[1])["biome"] == 1
    minedojo.act([turned, *walked], goal=[2])
    # Forward; 1 is left and 2 is right; 1 is jump and 3 is sprint; pitch and yaw in steps of 15 degrees around 12.
    turn, left, right = [0, 0, 0, 12, 18, 0, 0, 0], [1, 1, 1, 12, 12, 0, 0, 0], [1, 2, 3, 12, 12, 0, 0, 0]
    assert played == [turn, left, turn, left, right]


# The engine, with a script instead of an interpreter.


def facts_of(seen: Observation) -> dict:
    """An observation in the worker's format."""
    rays = {
        "block_name": seen.ray_blocks,
        "block_distance": seen.ray_block_distances,
        "entity_name": seen.ray_entities,
        "entity_distance": seen.ray_entity_distances,
    }
    place = {"position": seen.position.tolist(), "yaw": seen.yaw, "pitch": seen.pitch, "biome": seen.biome}
    return {**place, "blocks": seen.blocks.tolist(), "rays": {name: array.tolist() for name, array in rays.items()}}


@pytest.fixture
def interpreter(tmp_path, monkeypatch):
    """Make an interpreter that answers a reset with the voxel world's observation, and does as told for `act`."""

    def make(lines: str) -> None:
        seen = facts_of(VoxelEngine(text="paper").reset(1, PLAINS))
        python, path = script(tmp_path, lines, reset=seen)
        monkeypatch.setenv(INTERPRETER, program(tmp_path / "python", f"exec {python} {path}"))

    return make


def test_a_crash_ends_the_episode_on_the_record_and_the_next_reset_starts_anew(interpreter, tmp_path):
    interpreter("sys.exit(1)")
    with sp.Episode(GAME, seed=1, engine="minedojo", transcript=tmp_path / "crash.jsonl") as episode:
        assert episode.call("observe").text.startswith("Coordinate (")
        result = episode.call("act", {"action": "Move North"})
        assert (result.is_error, result.done) == (True, True)
        assert episode.game.reset(seed=2)[0].startswith("Coordinate (")
    assert (episode.result.end_reason, episode.result.steps) == ("game_error", 0)
    assert episode.result.error == "EngineError: MineDojo's worker has ended (exit code 1)."
    assert "ready" in sp.read_transcript(tmp_path / "crash.jsonl")[-1]["traceback"]


def test_a_late_answer_ends_the_episode(interpreter, monkeypatch):
    interpreter("time.sleep(60)")
    monkeypatch.setattr("smartplay_tools.games.minecraft.minedojo.engine.CALL_SECONDS", 0.3)
    with sp.Episode(GAME, seed=1, engine="minedojo") as episode:
        episode.call("act", {"action": "1"})
    assert episode.result.end_reason == "game_error"
    assert "has not answered 'act' within 0.3 seconds" in episode.result.error


def test_a_late_start_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setenv(INTERPRETER, program(tmp_path / "python", "sleep 60"))
    monkeypatch.setattr("smartplay_tools.games.minecraft.minedojo.engine.START_SECONDS", 0.3)
    with pytest.raises(EngineError, match=r"has not answered 'make' within 0\.3 seconds; it was ended"):
        sp.Episode(GAME, seed=1, engine="minedojo")


def test_without_an_interpreter_the_sentence_names_the_remedy(monkeypatch):
    monkeypatch.delenv(INTERPRETER, raising=False)
    with pytest.raises(sp.InvalidArgumentError, match=r"commands in docs/minecraft\.md make"):
        sp.Episode(GAME, seed=1, engine="minedojo")


@pytest.mark.parametrize(
    ("variable", "value", "sentence"),
    [
        (INTERPRETER, "/nowhere/python", "/nowhere/python cannot be run: No such file or directory"),
        (INTERPRETER, "/", "/ cannot be run: Permission denied"),
        (LOG, "/nowhere/game.log", "/nowhere/game.log cannot be written: No such file or directory"),
    ],
)
def test_a_wrong_variable_is_one_sentence(variable, value, sentence, monkeypatch, temporary):
    monkeypatch.setenv(INTERPRETER, sys.executable)
    monkeypatch.setenv(variable, value)
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        sp.Episode(GAME, seed=1, engine="minedojo")
    assert not list(temporary.iterdir())


@pytest.mark.parametrize("copied", [copy.deepcopy, pickle.dumps])
def test_a_process_is_not_copied(copied):
    with pytest.raises(TypeError, match="is a process and cannot be copied"):
        copied(MineDojoEngine(text="paper"))


def test_only_this_engine_is_compared_with_people(interpreter):
    """Its text is the paper's, and nothing that is played differs from the paper."""
    interpreter("answer(json.dumps(known['reset']) + '\\n')")
    spec = dataclasses.replace(sp.GAMES[GAME], rollout=2)
    played = {}
    for engine in ("minedojo", "voxel"):
        with sp.Episode(spec, seed=0, engine=engine) as episode:
            played[engine] = sp.play(episode, sp.get_player("random", seed=0))
    assert (played["minedojo"].engine, played["minedojo"].normalized_score) == ("minedojo", 0.0)
    assert played["voxel"].normalized_score is None
    assert "engine" not in played["minedojo"].deviations
    assert "text" not in played["minedojo"].deviations
    assert set(played["voxel"].deviations) >= {"engine", "text"}


# The real package. The commands of docs/minecraft.md make what is needed.


@pytest.fixture
def client(tmp_path, monkeypatch):
    """Put a double of the game's client in place of Java; the function returned has it fail."""
    if not os.environ.get(INTERPRETER):
        pytest.skip(f"{INTERPRETER} does not name a Python with MineDojo")
    double = Path(__file__).with_name("malmo_double.py")
    (tmp_path / "bin").mkdir()
    program(tmp_path / "bin" / "java", f'PYTHONPATH="{ROOT}" exec {sys.executable} {double} "$@"')
    monkeypatch.setenv("PATH", f"{tmp_path}/bin", prepend=":")
    monkeypatch.delenv("JAVA_HOME", raising=False)
    monkeypatch.delenv("MINEDOJO_HEADLESS", raising=False)
    monkeypatch.setenv("MALMO_DOUBLE_GOAL", ",".join(map(str, sorted(PLAINS.biomes))))
    return lambda fault: monkeypatch.setenv("MALMO_DOUBLE_FAULT", fault)


def assert_same(seen: Observation, expected: Observation) -> None:
    """Array by array, to the bit."""
    for name, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(seen, name), value, err_msg=name)
        assert np.asarray(getattr(seen, name)).dtype.kind == np.asarray(value).dtype.kind, name
    assert describe(seen, "paper", "Move North") == describe(expected, "paper", "Move North")


@pytest.mark.slow
def test_through_the_real_package_everything_is_as_the_voxel_engine_sees_it(client, temporary):
    """Make, reset, 20 actions, a second reset, a walk that ends on a beach, and the end, with nothing left."""
    engine, expected = MineDojoEngine(text="paper"), VoxelEngine(text="paper")
    beach = Goal("beach", frozenset({16}))
    entities: set[str] = set()
    try:
        looks = [(number % 4, 4) for number in range(19)]
        for seed, goal, walks in ((24, PLAINS, [(0, 50), *looks]), (4, beach, [(1, 50)])):
            random = np.random.default_rng(seed)
            seen = expected.reset(seed, PLAINS)
            assert_same(engine.reset(seed, PLAINS), seen)
            for action, ticks in walks:
                degrees, keys = turn(action, seen.yaw), strides(random)[:ticks]
                seen = expected.act(degrees, keys, goal)
                assert_same(engine.act(degrees, keys, goal), seen)
                entities |= set(seen.ray_entities.tolist())
        assert seen.biome in beach.biomes
        assert entities - {"null"}
        assert engine.versions["minedojo"] == "0.1"
        pid = engine._worker._process.pid
    finally:
        engine.close()
    assert not is_running(pid)
    assert not list(temporary.iterdir())


@pytest.mark.slow
def test_a_client_that_breaks_down_ends_the_episode(client, temporary):
    client("exit:5")
    with sp.Episode(GAME, seed=7, engine="minedojo") as episode:
        assert episode.call("act", {"action": "Move North"}).is_error
        assert not list(temporary.iterdir())
    assert episode.result.end_reason == "game_error"
    assert "RuntimeError: the game's client has ended the episode or is gone" in episode.result.error


@pytest.mark.slow
def test_a_client_that_does_not_start_is_one_sentence_and_its_own_words_are_in_the_log(client):
    client("start")
    with pytest.raises(EngineError, match="'reset': EOFError: Minecraft process finished unexpectedly") as caught:
        sp.Episode(GAME, seed=7, engine="minedojo")
    assert "needs Java 8" in str(caught.value)
    assert "the game could not be started" in caught.value.__cause__.__notes__[0]
