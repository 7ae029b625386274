"""Games of installed packages: a name in a record imports nothing, unless the user asks for it."""

from __future__ import annotations

import json
import sys

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import UnknownNameError
from smartplay_tools.evaluation.pages.report.drawings import draw
from smartplay_tools.games.game_registry import importing_packages
from smartplay_tools.records import Record

pytest.importorskip("jinja2")
report = pytest.importorskip("smartplay_tools.evaluation.pages.report.page")

HANOI = "Hanoi3Disk-v0"

PLUGIN = """
from dataclasses import replace
import smartplay_tools as sp
spec = replace(sp.GAMES["Hanoi3Disk-v0"], id="Foreign-v0")
"""


@pytest.fixture
def record(tmp_path, monkeypatch):
    """The record of a game that an installed package declares."""
    package = tmp_path / "packages"
    about = package / "foreign-1.0.dist-info"
    about.mkdir(parents=True)
    (package / "foreign.py").write_text(PLUGIN)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[smartplay_tools.games]\nForeign-v0 = foreign:spec\n")
    monkeypatch.syspath_prepend(package)
    path = tmp_path / "hanoi.jsonl"
    with sp.Episode(HANOI, seed=1, transcript=path, budget=sp.Budget(tool_calls=2)) as episode:
        sp.play(episode, sp.get_player("rule"))
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines[0]["config"]["game"] = lines[-1]["result"]["game"] = "Foreign-v0"
    foreign = tmp_path / "foreign.jsonl"
    foreign.write_text("".join(json.dumps(line) + "\n" for line in lines))
    yield foreign
    sys.modules.pop("foreign", None)
    sp.GAMES._specs.pop("Foreign-v0", None)


def test_a_setting_is_imported_only_where_that_is_allowed(record):
    with importing_packages(False):
        assert sp.GAMES.get("Foreign-v0") is None
        with pytest.raises(UnknownNameError, match="a game of the package foreign; --plugins imports it"):
            sp.GAMES["Foreign-v0"]
    assert "foreign" not in sys.modules
    assert sp.GAMES["Foreign-v0"].family == "hanoi"


@pytest.mark.slow
def test_a_page_names_the_game_and_imports_it_when_asked(record):
    assert "Foreign-v0" in report.render_report(record)
    assert "foreign" not in sys.modules
    report.render_report(record, plugins=True)
    assert "foreign" in sys.modules


def test_numbers_that_no_setting_has_are_not_played():
    with sp.Episode(HANOI, seed=1, transcript=(events := [])) as episode:
        sp.play(episode, sp.get_player("first"))
    assert draw(Record(events))["kind"] == "hanoi"
    events[0]["config"]["setting"]["kwargs"] = {"disks": 10**9}
    with importing_packages(False):
        drawing = draw(Record(events))
    assert "has other numbers here; --plugins draws it" in drawing["source"]
