"""Damaged run folders: `view`, `report` and `results` say what is wrong in a sentence; nothing else is raised."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.errors import SmartPlayError
from tests.evaluation.test_hostile_bundles import damage

pytest.importorskip("uvicorn")
site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")
report = pytest.importorskip("smartplay_tools.evaluation.pages.report.page")

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A run with finished, failed and running episodes, and a status file."""
    out = tmp_path_factory.mktemp("runs") / "run"
    budget = sp.Budget(tool_calls=3, prompt_tokens=900)
    sp.evaluate([HANOI, BANDIT], ["rule"], out=out, trials=2, budgets=budget, executor="inline")
    first, second, *_ = sorted((out / "episodes").glob("*.jsonl"))
    (out / "running" / f"{first.stem}.1.jsonl").write_text("".join(first.read_text().splitlines(keepends=True)[:-2]))
    (out / "attempts" / f"{second.stem}.1.jsonl").write_bytes(second.read_bytes())
    first.unlink()
    rows = (out / "results.jsonl").read_text().splitlines(keepends=True)
    (out / "results.jsonl").write_text("".join(row for row in rows if first.stem not in row))
    return out


def spoiled(chance: random.Random, run: Path, folder: Path) -> str:
    """Copy a run and damage one of its files: a value, a line or some bytes; return what was done."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(run, folder)
    file = chance.choice(sorted(path for path in folder.rglob("*.json*")))
    data = file.read_bytes()
    match chance.randrange(4):
        case 0 if file.suffix == ".json":
            file.write_text(json.dumps(damage(chance, json.loads(data))))
            return f"{file.name}: a value"
        case 0 | 1:
            lines = data.splitlines(keepends=True)
            at = chance.randrange(len(lines))
            try:
                lines[at] = json.dumps(damage(chance, json.loads(lines[at]))).encode() + b"\n"
            except ValueError:
                lines[at] = b"{\n"
            file.write_bytes(b"".join(lines))
            return f"{file.name}: line {at}"
        case 2:
            at = chance.randrange(len(data))
            file.write_bytes(data[:at])
            return f"{file.name}: cut at {at}"
    at = chance.randrange(len(data))
    file.write_bytes(data[:at] + bytes(chance.randrange(256) for _ in range(9)) + data[at + 9 :])
    return f"{file.name}: bytes at {at}"


def looked_at(folder: Path) -> None:
    """Ask everything that the site answers of a run; only our own errors may be raised, and they are one sentence."""
    shown = site_runs.SiteRun(folder, "run")
    summary = shown.summary()
    assert "error" in summary or summary["planned"] >= summary["finished"]
    try:
        shown.playing()
        for episode in shown.episodes():
            assert len(episode) == len(site_runs.COLUMNS)
            if episode[0] is not None:
                shown.record(episode[0])
    except SmartPlayError as error:
        sentence_of(error)


def sentence_of(error: SmartPlayError) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 2_000


@pytest.mark.parametrize("count", [15, pytest.param(300, marks=pytest.mark.slow)])
def test_the_site_says_what_is_wrong_with_a_damaged_run(run, tmp_path, count):
    for number in range(count):
        chance = random.Random(number)
        what = spoiled(chance, run, tmp_path / "run")
        try:
            looked_at(tmp_path / "run")
        except Exception as error:
            raise AssertionError(f"case {number}, {what}") from error


@pytest.mark.slow
def test_a_report_says_what_is_wrong_with_a_damaged_run(run, tmp_path, monkeypatch):
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.page.figures", lambda runs: [])
    for number in range(40):
        chance = random.Random(number)
        what = spoiled(chance, run, tmp_path / "run")
        try:
            report.render_report(tmp_path / "run")
        except SmartPlayError as error:
            sentence_of(error)
        except Exception as error:
            raise AssertionError(f"case {number}, {what}") from error
