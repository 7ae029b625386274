"""The command `doctor`, which uses the parts that it checks, so the tests really break them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import smartplay_tools as sp
from smartplay_tools.cli import doctor as checkup
from smartplay_tools.cli.doctor import PartCheck, check_modules
from smartplay_tools.installation import install_command
from tests.evaluation.command import refused

ROOT = Path(sp.__file__).parents[1]


def package(folder: Path, name: str, version: str, code: str, *, module: str | None = None) -> None:
    """An installed distribution of one module, which by default has the same name."""
    file = f"{module or name}.py"
    (folder / file).write_text(code)
    information = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Name: {name}\nVersion: {version}\n")
    (information / "RECORD").write_text(f"{file},,\n")


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder from which this process and its children import."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return tmp_path


def test_requirements_are_those_of_the_installed_package():
    assert {need.name for need in checkup.requirements()} >= {"numpy", "tiktoken", "typer"}
    assert Requirement("gymnasium>=1.1") in checkup.requirements()
    agents = {need.name: str(need.specifier) for need in checkup.requirements("agents")}
    assert agents["openai-agents"].startswith(">=")
    assert "openai" in agents
    assert "numpy" not in agents


def test_a_requirement_for_another_system_is_not_missing_here(monkeypatch):
    declared = ['mapmaker>=2; extra == "maps"', 'map-of-nowhere; sys_platform == "nowhere" and extra == "maps"']
    monkeypatch.setattr(metadata, "requires", lambda package: declared)
    assert [need.name for need in checkup.requirements("maps")] == ["mapmaker"]


def test_extras_for_developers_are_not_listed(monkeypatch):
    monkeypatch.setattr(checkup, "check_modules", lambda kind, name, needed: PartCheck(kind, name, True, ""))
    listed = {finding.name for finding in checkup.check_extras()}
    assert "docs" not in listed
    assert listed == set(metadata.metadata("smartplay-tools").get_all("Provides-Extra")) - checkup.NOT_FEATURES


def test_a_module_may_have_another_name_than_its_distribution(site):
    package(site, "Map-Maker-Slim", "2.1", "", module="mapmaker")
    package(site, "compass_api", "0.3", "raise RuntimeError('no north')", module="compass")
    assert check_modules("extra", "maps", [Requirement("map-maker-slim>=2")]).works
    finding = check_modules("extra", "maps", [Requirement("map-maker-slim>=2"), Requirement("compass-api")])
    assert finding.detail.startswith("compass: RuntimeError: no north;")


def test_an_extra_that_is_there_works_and_shows_its_versions(site):
    package(site, "mapmaker", "2.1", "")
    package(site, "compass", "0.3", "")
    needed = [Requirement("mapmaker>=2.0"), Requirement("compass")]
    assert check_modules("extra", "maps", needed) == PartCheck("extra", "maps", True, "mapmaker 2.1, compass 0.3")


def test_the_adapter_that_an_extra_is_for_has_to_work_too(site):
    package(site, "mapmaker", "2.1", "")
    late = "__all__ = ['Map']\ndef __getattr__(name):\n    if name == 'Map': from mapmaker import Atlas"
    (site / "smartplay_maps.py").write_text(late)
    finding = check_modules("extra", "maps", [Requirement("mapmaker>=2.0")])
    assert not finding.works
    assert finding.detail.startswith("smartplay_maps: ImportError: cannot import name 'Atlas' from 'mapmaker'")


def test_what_is_not_installed_is_named_with_the_remedy():
    finding = check_modules("extra", "maps", [Requirement("mapmaker-of-nowhere")])
    assert not finding.works
    assert finding.detail == f"mapmaker-of-nowhere is not installed; {install_command('maps')}"


def test_a_version_that_is_too_old_does_not_work(site):
    package(site, "mapmaker", "1.9.2", "")
    assert check_modules("extra", "maps", [Requirement("mapmaker>=1.9")]).works
    finding = check_modules("extra", "maps", [Requirement("mapmaker>=1.10")])
    assert finding.detail.startswith("mapmaker is 1.9.2, but >=1.10 is needed; ")


@pytest.mark.parametrize(
    ("code", "wrong"),
    [
        ("raise RuntimeError('no screen')", "mapmaker: RuntimeError: no screen"),
        ("import mapmaker_of_nowhere", "mapmaker_of_nowhere is not installed"),
        ("import os; os.abort()", "importing mapmaker ends with code -6"),
        ("import time; time.sleep(60)", "importing mapmaker takes longer than 0.3 seconds"),
    ],
)
def test_being_installed_is_not_enough(code, wrong, site, monkeypatch):
    if "takes longer" in wrong:
        monkeypatch.setattr(checkup, "IMPORT_SECONDS", 0.3)
    package(site, "mapmaker", "2.0", code)
    finding = check_modules("extra", "maps", [Requirement("mapmaker>=1.0")])
    assert not finding.works
    assert finding.detail == f"{wrong}; {install_command('maps')}"


def test_the_core_works_here():
    assert checkup.check_games().works
    assert checkup.check_vocabulary().works


def test_a_damaged_vocabulary_is_found(monkeypatch):
    monkeypatch.setattr("smartplay_tools.context.tokens.o200k.UNPACKED_SHA256", "0" * 64)
    finding = checkup.check_vocabulary()
    assert not finding.works
    assert finding.detail.startswith("The vocabulary of o200k_base is damaged: ")


def doctor(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("SMARTPLAY_")}
    command = [sys.executable, "-m", "smartplay_tools", "doctor", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=inherited | environment)


@pytest.mark.slow
def test_the_command_tells_of_everything_and_fails_for_nothing_optional():
    shown = doctor("--json")
    assert shown.returncode == 0
    rows = {(row["kind"], row["name"]): row for row in json.loads(shown.stdout)}
    assert all(row["works"] for (kind, _), row in rows.items() if kind == "core")
    assert rows["engine", "voxel"]["works"]
    assert not rows["engine", "minedojo"]["works"]
    assert all(row["detail"] for row in rows.values())


@pytest.mark.slow
def test_the_command_fails_if_the_core_does(tmp_path):
    (tmp_path / "crafter.py").write_text("raise ImportError('no such game')")
    shown = doctor("--only", "core", PYTHONPATH=f"{tmp_path}{os.pathsep}{ROOT}", COLUMNS="200")
    assert shown.returncode == 1
    assert "crafter: ImportError: no such game; " in shown.stdout
    assert "yes" in shown.stdout


def test_what_cannot_be_looked_at_is_refused():
    assert "--only house: known are core, engine, extra." in refused("doctor", "--only", "house")
