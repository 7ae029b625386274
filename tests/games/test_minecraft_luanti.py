"""The Luanti engine: its contract, its reproducibility, and that it never leaves anything behind."""

from __future__ import annotations

import copy
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import smartplay_tools as sp
from smartplay_tools.errors import EngineError
from smartplay_tools.games import GameSpec
from smartplay_tools.games.minecraft.engines import ACTIONS, CORRECTED_GOALS, PAPER_GOALS, check_engines, strides, turn
from smartplay_tools.games.minecraft.luanti import server
from smartplay_tools.games.minecraft.luanti.engine import LuantiEngine
from smartplay_tools.games.minecraft.luanti.install import VARIABLE, find_installation
from smartplay_tools.games.minecraft.luanti.node_names import display_name
from smartplay_tools.games.minecraft.observation import NEAR
from smartplay_tools.games.minecraft.voxel.blocks import Block
from smartplay_tools.games.minecraft.voxel.walking import EYES, Walker
from smartplay_tools.games.minecraft.voxel.world import BOTTOM, SIDE, VoxelWorld
from tests.guides.luanti import Guide
from tests.processes import is_running, is_soon, needs_proc, needs_unix

needs_unix()
needs_proc()


def needs_server(test: Callable[..., None]) -> Callable[..., None]:
    """A test that starts the server is slow, and is skipped where there is none."""
    try:
        find_installation()
    except sp.InvalidArgumentError as missing:
        test = pytest.mark.skip(reason=str(missing))(test)
    return pytest.mark.slow(test)


FEET = NEAR // 2
"""The index of the player's own block in the cube around it."""


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The parent of the folders of a test's servers."""
    place = tmp_path / "servers"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    return place


@pytest.fixture(scope="module")
def played() -> Iterator[LuantiEngine]:
    """An engine whose player is in open country."""
    engine = LuantiEngine(text="corrected")
    plains, desert, ice_plains = 1, 2, 12
    for seed in range(20):
        if engine.reset(seed, CORRECTED_GOALS[8]).biome in (plains, desert, ice_plains):
            break
    yield engine
    engine.close()


def walk(engine: LuantiEngine, action: int, seed: int = 0, ticks: int = 50, task: int = 7):
    """One action of the contract, or its first ticks."""
    degrees = turn(action, engine._yaw)
    return engine.act(degrees, strides(np.random.default_rng(seed))[:ticks], CORRECTED_GOALS[task])


# The contract.


@needs_server
@pytest.mark.parametrize("task", [*CORRECTED_GOALS][::3])
def test_a_task_starts_outside_of_its_goal_and_is_told_in_the_contracts_words(task):
    game = sp.GAMES[f"MinedojoCreative{task}-v0"].make(engine="luanti")
    try:
        observation, _ = game.reset(seed=3)
        assert observation.startswith("Coordinate (0.50,")
        assert game._seen.biome not in CORRECTED_GOALS[task].biomes
        for action in (0, 1, 2):
            observation, reward, *_, info = game.step(action)
            assert observation in game.observation_space
            lines = observation.split("\n")
            assert lines[0] == f"You took action {ACTIONS[action]}."
            assert re.fullmatch(r"Coordinate \(-?[\d.]+,-?[\d.]+,-?[\d.]+\)\. Facing (north|east|south)\.", lines[2])
            thing = re.compile(r" - [a-z' -]+, \d+\.\d\d blocks away, [a-z -]+(, taking \d+% of screen)?")
            assert all(thing.fullmatch(line) for line in lines if line.startswith(" - "))
            assert (reward, info["score"]) == (0, info["completed"])
            if game.completed:
                break
    finally:
        game.close()


@needs_server
def test_who_is_told_the_way_gets_there(folders):
    # `benchmarks/minecraft.py` does this for more tasks and seeds.
    for task in (4, 7):
        game = sp.GAMES[f"MinedojoCreative{task}-v0"].make(engine="luanti")
        game.reset(seed=1)
        guide = Guide(game.world, seed=1)
        for _ in range(150):
            *_, terminated, _, _ = game.step(guide.best_action())
            if terminated:
                break
        assert (game.completed, game.score) == (True, 1)
        assert game._seen.biome in CORRECTED_GOALS[task].biomes
        game.close()
    assert list(folders.iterdir()) == []


@needs_server
def test_biomes_are_told_by_the_ground(folders):
    """Where the biome's id says desert there is sand, and so on; over starts of several worlds and short walks."""
    ground = {
        1: {"grass block"},
        2: {"desert sand", "sand", "silver sand"},
        4: {"grass block", "podzol"},
        12: {"snowy grass block"},
        16: {"sand", "dirt", "savanna dirt", "gravel"},
        21: {"dirt with rainforest litter"},
        30: {"snowy grass block"},
        35: {"savanna dirt with savanna grass"},
        140: {"snow block", "ice"},
    }
    trunks = re.compile("air|.* (wood|leaves)")
    agree: list[bool] = []
    seen: set[int] = set()
    engine = LuantiEngine(text="corrected")
    for seed, task in enumerate((0, 5, 7)):
        engine.reset(seed, CORRECTED_GOALS[task])
        for number in range(6):
            observation = walk(engine, (0, 0, 1, 2, 2, 3)[number], number, task=task)
            below = str(observation.blocks[FEET, FEET - 1, FEET])
            if observation.biome in ground and not trunks.fullmatch(below):
                seen.add(observation.biome)
                agree.append(below in ground[observation.biome])
    engine.close()
    assert len(seen) >= 3
    assert np.mean(agree) > 0.8


@needs_server
def test_headings_are_minecrafts_though_luantis_north_is_plus_z(played):
    for action, (axis, sign) in enumerate(((2, -1), (0, 1), (2, 1), (0, -1))):
        start = np.array(played.position)
        for seed in range(8):  # something may stand in the way
            walk(played, action, seed)
            moved = np.array(played.position) - start
            if abs(moved[axis]) > 5:
                break
        assert sign * moved[axis] > 5, ACTIONS[action]


@needs_server
def test_rays_hit_what_stands_in_the_cube_of_blocks(played):
    """Two ways to look at the same blocks, each of which converts Luanti's axes for itself."""
    compared = different = 0
    for action in range(8):
        seen = walk(played, action % 4, ticks=8)
        corner = np.floor(played.position) - FEET
        eye = np.array(played.position) + np.array([0, EYES, 0])
        inside = eye + seen.ray_directions.astype(float) * (seen.ray_block_distances[:, None].astype(float) + 0.01)
        cells = np.floor(inside - corner).astype(int)
        for name, cell in zip(seen.ray_blocks, cells, strict=True):
            if name != "air" and (cell >= 0).all() and (cell < NEAR).all():
                compared += 1
                different += name != seen.blocks[tuple(cell)]
    assert compared > 300
    assert different < 0.02 * compared  # rays that graze an edge have left the block after a hundredth


PASSABLE = ("air", "tall grass", "fern", "dead bush", "snow", "marram grass", "dandelion", "poppy", "allium")
SOLID = re.compile(r"(.* )?(block|dirt|podzol|sand|sandstone|stone|wood|leaves|gravel|clay|ore)")


@needs_server
def test_the_body_walks_as_in_the_embedded_engine(played):
    """The rules of walking are implemented twice; here both walk the same steps over the same ground."""
    compared = 0
    for number in range(32):
        onward = (2, 1, 0, 3)[number // 8]
        seen = walk(played, onward, number, ticks=1)
        names = set(seen.blocks.ravel().tolist()) - set(PASSABLE)
        if not all(SOLID.fullmatch(name) for name in names):  # water and ice have rules of their own
            walk(played, onward, number)
            continue
        world = VoxelWorld(0)
        world.blocks[:] = Block.AIR
        x, y, z = (int(np.floor(c)) - FEET for c in played.position)
        cube = np.where(np.isin(seen.blocks, PASSABLE), Block.AIR, Block.STONE)
        cells = [(np.arange(c, c + NEAR)) for c in (x, y, z)]
        world.blocks[np.ix_(cells[0] & (SIDE - 1), cells[2] & (SIDE - 1), cells[1] - BOTTOM)] = cube.transpose(0, 2, 1)
        twin = Walker(world, *played.position)
        twin.vx, twin.vy, twin.vz, grounded, sprinting = played._body[3:]
        twin.grounded, twin.sprinting = bool(grounded), bool(sprinting)
        action = (number + 1) % 4
        sine, cosine = {0: (0.0, -1.0), 1: (-1.0, 0.0), 2: (0.0, 1.0), 3: (1.0, 0.0)}[action]
        steps = strides(np.random.default_rng(100 + number))[:6]
        played.act(turn(action, played._yaw), steps, CORRECTED_GOALS[7])
        twin.tick(None, sine, cosine)
        for stride in steps:
            twin.tick(stride, sine, cosine)
        assert played.position == pytest.approx((twin.x, twin.y, twin.z), abs=1e-9)
        compared += 1
        walk(played, onward, number)
    assert compared > 8


def test_nodes_that_minecraft_has_are_called_by_its_names():
    assert display_name("default:pine_tree", "Pine Tree", "corrected") == "spruce wood"
    assert display_name("default:pine_tree", "Pine Tree", "paper") == "wood"
    assert display_name("default:dirt_with_snow", "Dirt with Snow", "paper") == "grass block"
    assert display_name("flowers:rose", "Red Rose", "paper") == "flower"


def test_other_nodes_are_called_by_their_own_titles():
    assert display_name("default:desert_sand", "Desert Sand", "corrected") == "desert sand"
    assert display_name("mod:lamp", "\x1b(T@mod)Lamp, \x1b(c@#ff0000)bright\x1b(c@#ffffff)\nGives light", "paper") == (
        "lamp bright"
    )
    assert display_name("mod:odd", "", "corrected") == "mod odd"


# Reproducibility.


SCRIPT = """
import hashlib, sys
import smartplay_tools as sp
game = sp.GAMES["MinedojoCreative8-v0"].make(engine="luanti")
observation, _ = game.reset(seed=11)
digest = hashlib.sha256(observation.encode())
for step in range(12):
    digest.update(game.step((0, 0, 1, 3, 2)[step % 5])[0].encode())
    print(step, game.state_hash(), digest.hexdigest())
game.close()
"""


@needs_server
def test_two_processes_see_the_same_bit_for_bit():
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    runs = [
        subprocess.Popen(command, env={**os.environ, "PYTHONHASHSEED": seed}, stdout=subprocess.PIPE, text=True)
        for seed in "12"
    ]
    one, other = (run.communicate(timeout=240)[0] for run in runs)
    assert one == other
    assert len(one.splitlines()) == 12


@needs_server
def test_every_server_decorates_alike():
    """The engine assigns new numbers to decorations without a name at every start."""
    seen = set()
    for _ in range(4):
        started = server.LuantiServer(find_installation(), seed=1)
        seen.add(started.decorations)
        started.close()
    assert len(seen) == 1
    assert re.fullmatch("[0-9a-f]{40}", *seen)


@needs_server
def test_a_recorded_episode_can_be_replayed(tmp_path, folders):
    spec = GameSpec(**{**vars(sp.GAMES["MinedojoCreative0-v0"]), "rollout": 8})
    record = tmp_path / "episode.jsonl"
    with sp.Episode(spec, seed=1, engine="luanti", transcript=record) as episode:
        result = sp.play(episode, sp.get_player("rule", seed=1))
    assert (result.engine, result.end_reason, result.normalized_score) == ("luanti", "rollout", None)
    assert re.match(r"\d+\.\d+", result.versions["luanti"])
    again = sp.replay(record)
    assert again.differences == []
    assert again.result.state_hash == result.state_hash != ""
    assert list(folders.iterdir()) == []


@needs_server
def test_the_paper_texts_can_be_played_too():
    engine = LuantiEngine(text="paper")
    seen = engine.reset(5, PAPER_GOALS[7])
    assert engine.way == []
    assert not any(str(name).startswith(("oak", "spruce", "birch")) for name in seen.blocks.ravel())
    engine.close()


# Nothing is left behind.


def servers(folders: Path) -> list[int]:
    """The processes whose working directory is in these folders."""
    numbers = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if str((process / "cwd").readlink()).startswith(str(folders)):
                numbers.append(int(process.name))
        except OSError:
            continue  # it has just ended, or belongs to somebody else
    return numbers


@needs_server
def test_closing_leaves_neither_process_nor_folder(folders):
    engine = LuantiEngine(text="corrected")
    engine.reset(5, CORRECTED_GOALS[0])
    guard = engine._server.process
    assert len(servers(folders)) == 1
    assert len(list(folders.iterdir())) == 1
    engine.close()
    engine.close()
    assert not is_running(guard)
    assert servers(folders) == list(folders.iterdir()) == []


@needs_server
def test_an_engine_that_is_forgotten_cleans_up_as_well(folders):
    engine = LuantiEngine(text="corrected")
    engine.reset(5, CORRECTED_GOALS[0])
    del engine
    assert servers(folders) == list(folders.iterdir()) == []


HELD = """
import os, sys, time
import smartplay_tools as sp
game = sp.GAMES["MinedojoCreative0-v0"].make(engine="luanti")
game.reset(seed=5)
print(game.world._server.process, flush=True)
{then}
"""


@needs_server
@pytest.mark.parametrize(
    ("then", "code"),
    [
        ("time.sleep(600)", -signal.SIGKILL),
        ("raise RuntimeError('a bug')", 1),
        ("os._exit(3)", 3),
    ],
    ids=["killed", "exception", "exit without cleaning up"],
)
@pytest.mark.slow
def test_however_python_ends_nothing_is_left(folders, then, code):
    command = [sys.executable, "-c", HELD.format(then=then)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        guard = int(process.stdout.readline())
        if code == -signal.SIGKILL:
            assert len(servers(folders)) == 1
            process.kill()
        assert process.wait(20) == code
    assert is_soon(lambda: not is_running(guard) and not servers(folders) and not list(folders.iterdir()))


@needs_server
def test_a_server_that_is_killed_ends_the_episode_on_the_record(folders):
    with sp.Episode("MinedojoCreative0-v0", seed=5, engine="luanti") as episode:
        (victim,) = servers(folders)
        os.kill(victim, signal.SIGKILL)
        result = episode.call("act", {"action": "Move North"})
        assert result.is_error
        assert episode.end_reason == "game_error"
        assert "The Luanti server ended" in episode.result.error
    assert list(folders.iterdir()) == []


@needs_server
def test_a_reset_after_a_crash_starts_another_server(folders):
    game = sp.GAMES["MinedojoCreative0-v0"].make(engine="luanti")
    first, _ = game.reset(seed=5)
    os.kill(*servers(folders), signal.SIGKILL)
    with pytest.raises(EngineError, match="The Luanti server ended"):
        game.step(0)
    with pytest.raises(EngineError, match="reset starts another one"):
        game.step(0)
    assert game.reset(seed=5)[0] == first
    game.close()


# Faulty and missing servers, which are replaced by scripts, so no server is needed.


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Replaces the server by a shell script."""

    def install(script: str) -> None:
        home = tmp_path / "installed"
        (home / "games" / "minetest_game").mkdir(parents=True)
        (home / "games" / "minetest_game" / "game.conf").touch()
        path = home / "luantiserver"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setenv(VARIABLE, str(path))

    return install


READY = (
    """exec 9> /dev/fd/$(sed -n 's/smartplay_answers = //p' "$4"); """
    """echo '{"version":"0","decorations":""}' >&9; read line"""
)


def failure(folders: Path) -> str:
    """The error of a reset."""
    engine = LuantiEngine(text="corrected")
    with pytest.raises(EngineError) as caught:
        engine.reset(0, CORRECTED_GOALS[0])
    assert servers(folders) == list(folders.iterdir()) == []
    return str(caught.value)


def test_a_server_that_does_not_start_is_given_up(program, folders, monkeypatch):
    monkeypatch.setattr(server, "START_SECONDS", 0.3)
    program("exec sleep 600")
    assert failure(folders) == "The Luanti server did not start within 0.3 s and was stopped."


@pytest.mark.slow
def test_a_server_that_does_not_answer_is_given_up(program, folders, monkeypatch):
    monkeypatch.setattr(server, "ANSWER_SECONDS", 0.3)
    program(f"{READY}; exec sleep 600")
    assert failure(folders) == "The Luanti server did not answer within 0.3 s and was stopped."


@pytest.mark.slow
def test_a_server_that_ends_at_once_is_quoted(program, folders):
    program("echo 'listening'; echo 'ERROR[Main]: no such game' >&2; exit 1")
    assert failure(folders) == "The Luanti server ended: ERROR[Main]: no such game"


def test_a_mod_that_fails_is_quoted(program, folders):
    program(f"""{READY}; echo '{{"error":"init.lua:1: oops"}}' >&9; exec sleep 600""")
    assert failure(folders) == "The Luanti server failed: init.lua:1: oops"


@pytest.mark.slow
def test_a_server_that_hangs_is_ended_when_python_is_killed(program, folders):
    program("trap '' TERM HUP INT; while true; do sleep 1; done")
    script = "from smartplay_tools.games.minecraft.luanti.engine import *\nLuantiEngine(text='paper').reset(0, None)"
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        assert is_soon(lambda: bool(servers(folders)))
        process.kill()
    assert is_soon(lambda: not servers(folders) and not list(folders.iterdir()))


def test_without_a_server_the_remedy_is_named(monkeypatch):
    monkeypatch.setenv(VARIABLE, "/nowhere")
    with pytest.raises(
        sp.InvalidArgumentError, match="SMARTPLAY_LUANTI is '/nowhere', where there is no Luanti server"
    ):
        sp.Episode("MinedojoCreative0-v0", seed=0, engine="luanti")
    check = next(check for check in check_engines() if check.engine == "luanti")
    assert not check.works
    assert check.detail.endswith("set it to the server's program.")


@needs_server
def test_the_doctor_names_the_servers_version():
    check = next(check for check in check_engines() if check.engine == "luanti")
    assert check.works
    assert re.fullmatch(r"a new world in \d+\.\d\d s \(luanti \d+\.\d+\.\d+.*\)", check.detail)


@needs_server
def test_an_engine_cannot_be_copied():
    with pytest.raises(TypeError, match="cannot be copied"):
        copy.deepcopy(LuantiEngine(text="paper"))
