"""Settings are found by id: the benchmark's, those a program registers, those that installed packages declare."""

from __future__ import annotations

import dataclasses
import pickle
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import gymnasium
import pytest

import smartplay_tools as sp
from smartplay_tools.errors import MissingExtraError, UnknownNameError
from smartplay_tools.evaluation.exports.export import FORMATS
from smartplay_tools.evaluation.runs.executors import EXECUTORS
from smartplay_tools.games.game_registry import Games
from smartplay_tools.games.minecraft.engines import ENGINES
from smartplay_tools.players.player_registry import PLAYERS
from smartplay_tools.registry import resolve

HANOI = sp.GAMES["Hanoi3Disk-v0"]
TOWER = dataclasses.replace(HANOI, id="Tower-v0", kwargs={"disks": 5}, rollout=40)


def listed(games: Games) -> list[str]:
    """Return the settings of a registry without the lockers, which every registry has."""
    return [game for game in games if not game.startswith("Lockers")]


MODULE = """
import dataclasses
import smartplay_tools as sp

TOWER = dataclasses.replace(sp.GAMES["Hanoi3Disk-v0"], id="Tower-v0", kwargs={"disks": 5}, rollout=40)
"""

PLACES = {**PLAYERS, **EXECUTORS.places, **ENGINES.places, **FORMATS}
IMPORT_A_FRAMEWORK = ("smartplay_anthropic", "smartplay_langchain", "smartplay_openai", EXECUTORS.places["ray"])
NEED_THEIR_OWN_ENVIRONMENT = ("smartplay_inspect", "smartplay_local")

Install = Callable[..., None]


@pytest.mark.parametrize(
    "place",
    [
        pytest.param(place, marks=pytest.mark.slow if place.startswith(IMPORT_A_FRAMEWORK) else ())
        for place in PLACES.values()
        if not place.startswith(NEED_THEIR_OWN_ENVIRONMENT)
    ],
)
def test_everything_that_is_named_by_its_place_is_there(place):
    assert callable(resolve(place))


@pytest.fixture
def games() -> Games:
    return Games([HANOI])


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a package of one module that declares settings, as a package index's client would leave it."""

    def write(entry_points: dict[str, str], module: str = MODULE) -> None:
        (tmp_path / "tower_pack.py").write_text(module, encoding="utf-8")
        metadata = tmp_path / "tower_pack-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: tower-pack\nVersion: 1.0\n", encoding="utf-8")
        lines = ["[smartplay_tools.games]", *(f"{name} = {value}" for name, value in entry_points.items())]
        (metadata / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "tower_pack", raising=False)

    return write


def test_a_registered_setting_is_known_by_its_id(games):
    with pytest.raises(UnknownNameError, match="did you mean"):
        games["Hanoi5Disk-v0"]
    assert games.register(TOWER) is TOWER
    assert games["Tower-v0"] is TOWER
    assert listed(games) == ["Hanoi3Disk-v0", "Tower-v0"]
    assert len(games) == len(list(games))
    assert gymnasium.make("smartplay/Tower-v0").spec.max_episode_steps == 40


def test_registering_again_replaces(games):
    """A notebook's cell may be run more than once."""
    games.register(TOWER)
    games.register(dataclasses.replace(TOWER, rollout=50))
    assert games["Tower-v0"].rollout == 50
    assert gymnasium.make("smartplay/Tower-v0").spec.max_episode_steps == 50


@pytest.mark.parametrize("name", ["Tower", "a/b-v0", "../x-v0", "", "Tower -v0", "smartplay/Tower-v0"])
def test_an_id_can_be_a_file_name_and_has_a_version(games, name):
    with pytest.raises(sp.InvalidArgumentError, match="Nim-v0"):
        games.register(dataclasses.replace(TOWER, id=name))


def test_the_benchmark_s_settings_stay_what_they_are(games, install):
    with pytest.raises(sp.InvalidArgumentError, match="a setting of the benchmark"):
        games.register(dataclasses.replace(TOWER, id="Hanoi3Disk-v0"))
    install({"Hanoi3Disk-v0": "tower_pack:TOWER"})
    assert Games([HANOI])["Hanoi3Disk-v0"] is HANOI
    assert listed(Games([HANOI])) == ["Hanoi3Disk-v0"]


def test_an_installed_setting_is_listed_without_importing_it(install):
    install({"Tower-v0": "tower_pack:TOWER"})
    games = Games([HANOI])
    assert listed(games) == ["Hanoi3Disk-v0", "Tower-v0"]
    with pytest.raises(UnknownNameError, match="did you mean Tower-v0"):
        games["Towers-v0"]
    assert "tower_pack" not in sys.modules
    assert games["Tower-v0"] == TOWER
    assert "tower_pack" in sys.modules


def test_the_settings_of_a_pack_are_known_everywhere_and_listed_where_they_can_be_played():
    game = "popgym-RepeatPreviousEasy-v0"
    spec = sp.GAMES[game]
    assert (spec.memory, spec.worst_step) == (3, -1 / 48)
    assert sp.GAMES.is_loaded(game)
    assert game not in sp.GAMES.benchmark
    if find_spec("popgym") is None:
        assert game not in list(sp.GAMES)
        with pytest.raises(MissingExtraError, match="popgym"):
            spec.make()
    else:
        assert game in list(sp.GAMES)


def test_gymnasium_knows_an_installed_setting_from_the_start(install):
    install({"Tower-v0": "tower_pack:TOWER"})
    Games([HANOI]).tell_gymnasium()  # as it does when both packages are imported
    assert "tower_pack" not in sys.modules
    before = gymnasium.spec("smartplay/Tower-v0")
    for _ in ("the first one imports the package", "from then on it is as if it had always been there"):
        environment = gymnasium.make("smartplay/Tower-v0", render_mode="ansi")
        assert environment.spec.max_episode_steps == 40
        environment.reset(seed=1)
        ends = [environment.step(0)[2:4] for _ in range(40)]
        assert ends == [(False, False)] * 39 + [(False, True)]
        assert gymnasium.spec("smartplay/Tower-v0") == before


@pytest.mark.parametrize(
    ("value", "module", "complaint"),
    [
        (
            "tower_pack:TOWER",
            "import a_package_that_is_not_installed",
            "cannot be loaded; repair or remove the package: No module named",
        ),
        ("tower_pack:TOWR", MODULE, "has no attribute 'TOWR'"),
        ("tower_pack:sp", MODULE, "tower_pack:sp is not a GameSpec of that id"),
    ],
)
def test_a_declaration_that_does_not_hold_is_told_in_one_sentence(install, value, module, complaint):
    install({"Tower-v0": value}, module)
    with pytest.raises(sp.InvalidArgumentError, match="Tower-v0") as raised:
        Games([HANOI])["Tower-v0"]
    assert "the package tower-pack" in str(raised.value)
    assert complaint in str(raised.value)


def test_a_setting_may_name_its_class_by_the_class_itself():
    spec = dataclasses.replace(HANOI, entry_point=HANOI.load())
    assert pickle.loads(pickle.dumps(spec)).load() is HANOI.load()
    with sp.Episode(spec, seed=1) as episode:
        assert sp.play(episode, sp.get_player("rule")).completed
