"""Records of engines that have gone: they are read and reported, and played again where another engine has the worlds.

`luanti_run.tar.xz` is a run that version 0.1.0 played on Luanti 5.6.1: four episodes of three calls.
`pypi_crafter.jsonl.xz` is an episode of 60 calls that it played on PyPI's package crafter.
"""

from __future__ import annotations

import lzma
import tarfile
from pathlib import Path

import pytest

import smartplay_tools as sp
from tests.evaluation.command import run

DATA = Path(__file__).parents[1] / "data" / "luanti_run.tar.xz"
CRAFTER = DATA.parent / "pypi_crafter.jsonl.xz"
REFUSED = "This version has no engine 'luanti', so nothing can be played on it again"


@pytest.fixture(scope="module")
def luanti(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("former")
    with tarfile.open(DATA) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 and later
        archive.extractall(folder)
    return folder / "luanti"


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        (("results", "{run}", "--all"), "MinedojoCreative0-v0 (luanti)"),
        (("compare", "{run}", "--reference", "random"), "rule"),
        (("cost", "{run}"), "rule"),
        (("report", "{run}", "--out", "{out}.html"), "open it in a browser"),
        (("export", "{run}", "--format", "sft", "--out", "{out}"), "4 episodes, 12 rows"),
    ],
)
def test_they_are_read(luanti, tmp_path, command, shown):
    code, printed, _ = run(*(word.format(run=luanti, out=tmp_path / "out") for word in command))
    assert (code, shown in printed) == (0, True), printed


def test_they_are_not_played_again(luanti):
    code, _, said = run("replay", next((luanti / "episodes").glob("*.jsonl")))
    assert (code, REFUSED in said, said.count("\n")) == (3, True, 1)
    code, _, said = run("replay", luanti, "--workers", "1")
    assert (code, "4 of 4 episodes were not replayed" in said, said.count(REFUSED)) == (3, True, 1)


def test_what_pypi_crafter_played_is_played_again_by_the_engine_with_the_same_worlds(tmp_path):
    (record := tmp_path / "crafter.jsonl").write_bytes(lzma.decompress(CRAFTER.read_bytes()))
    replay = sp.replay(record)
    assert replay.identical
    assert replay.result.engine == "crafter"
