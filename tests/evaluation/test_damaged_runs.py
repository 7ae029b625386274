"""Damaged run folders, of strangers too: what is wrong is said in a sentence; nothing outside is read or run."""

from __future__ import annotations

import json
import random
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

import smartplay_tools as sp
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.transcript.hashing import chained_lines
from tests.evaluation.command import run as command

pytest.importorskip("uvicorn")
COLUMNS = pytest.importorskip("smartplay_tools.web.site.listed").COLUMNS
site_runs = pytest.importorskip("smartplay_tools.web.site.site_runs")

BANDIT, HANOI = "BanditTwoArmedHighLowFixed-v0", "Hanoi3Disk-v0"

THOROUGH = 5_000
"""Commands with `--hypothesis-profile=thorough`, which take an hour."""

COMMANDS = {
    "results": ("results", "{run}", "--all"),
    "results as JSON": ("results", "{run}", "{good}", "--json"),
    "results as CSV": ("results", "{good}", "{run}", "--format", "csv", "--csv", "{out}.csv"),
    "report": ("report", "{run}", "--out", "{out}.html"),
    "compare": ("compare", "{good}", "{run}"),
    "cost": ("cost", "{run}", "{good}"),
    "export": ("export", "{run}", "--format", "sft", "--out", "{out}.jsonl"),
    "export of episodes": ("export", "{run}", "--format", "sft-chains", "--out", "{out}"),
    "replay": ("replay", "{run}", "--workers", "1"),
    "view": (),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """A run with finished, failed and running episodes, and a status file."""
    out = tmp_path_factory.mktemp("runs") / "run"
    budget = sp.Budget(tool_calls=3, prompt_tokens=900, summary_tokens=60, slack=0.5, own_words=2)
    sp.evaluate([HANOI, BANDIT], ["rule", "random"], out=out, trials=2, budgets=budget, executor="inline")
    first, second, *_ = sorted((out / "episodes").glob("*.jsonl"))
    (out / "running" / f"{first.stem}.1.jsonl").write_text("".join(first.read_text().splitlines(keepends=True)[:-2]))
    (out / "attempts" / f"{second.stem}.1.jsonl").write_bytes(second.read_bytes())
    first.unlink()
    rows = (out / "results.jsonl").read_text().splitlines(keepends=True)
    (out / "results.jsonl").write_text("".join(row for row in rows if first.stem not in row))
    return out


HOSTILE = [None, True, -1, 10**30, 1e308, float("nan"), "", "\ud800", "x" * 10_000, [], {}, [[[]]], {"a": {}}, "../x"]
"""Values that are put where others belong."""


def damage(chance: random.Random, value: object) -> object:
    """Return plain data with a hostile value somewhere in it."""
    if isinstance(value, dict) and value and chance.random() < 0.9:
        name = chance.choice(sorted(value))
        if chance.random() < 0.15:
            return {other: kept for other, kept in value.items() if other != name}
        return {**value, name: damage(chance, value[name])}
    if isinstance(value, list) and value and chance.random() < 0.9:
        at = chance.randrange(len(value))
        return [*value[:at], damage(chance, value[at]), *value[at + 1 :]]
    return chance.choice(HOSTILE)


def chained(events: list[dict[str, Any]]) -> bytes:
    """The lines of events with a chain that is right."""
    for event in events:
        event.pop("chain", None)
    return chained_lines(events, "")[0]


def spoil(chance: random.Random, folder: Path, lure: Path) -> str:
    """Damage one file of a run: a value, a line, some bytes, or the file itself; return what was done."""
    files = (path for path in folder.rglob("*.json*") if path.is_file() and not path.is_symlink())
    file = chance.choice(sorted(path for path in files if path.stat().st_size))
    data = file.read_bytes()
    match chance.randrange(6):
        case 0 | 1 | 2:
            lines = [data] if file.suffix == ".json" else data.splitlines(keepends=True)
            at = chance.randrange(len(lines))
            try:
                lines[at] = json.dumps(damage(chance, json.loads(lines[at]))).encode() + b"\n"
            except ValueError:
                lines[at] = b"{\n"
            if file.parent.name == "episodes" and chance.random() < 0.8:
                lines = [fit(lines) or b"".join(lines)]
            file.write_bytes(b"".join(lines))
            return f"{file.name}: line {at}"
        case 3:
            at = chance.randrange(len(data))
            file.write_bytes(data[:at])
            return f"{file.name}: cut at {at}"
        case 4:
            file.unlink()
            what = chance.choice(["gone", "a folder", "a link to a folder", "a link to a file", "a link to itself"])
            if what == "a folder":
                file.mkdir()
            elif what != "gone":
                to = {"a link to a folder": lure, "a link to a file": lure / "secret.jsonl"}
                file.symlink_to(to.get(what, file))
            return f"{file.name}: {what}"
    at = chance.randrange(len(data))
    file.write_bytes(data[:at] + bytes(chance.randrange(256) for _ in range(9)) + data[at + 9 :])
    return f"{file.name}: bytes at {at}"


def fit(lines: list[bytes]) -> bytes | None:
    """Events with the chain that belongs to them, as somebody makes it who knows how."""
    try:
        return chained([json.loads(line) for line in lines])
    except (AttributeError, TypeError, ValueError):
        return None


def looked_at(folder: Path) -> None:
    """Ask everything that the site answers of a run; only our own errors may be raised, and they are one sentence."""
    shown = site_runs.SiteRun(folder, "run")
    summary = shown.summary()
    assert "error" in summary or summary["planned"] >= summary["finished"]
    try:
        shown.playing()
        for episode in shown.episodes():
            assert len(episode) == len(COLUMNS)
            if episode[0] is not None:
                shown.record(episode[0])
    except SmartPlayError as error:
        sentence_of(error)


def sentence_of(error: SmartPlayError) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 2_000


def told(name: str, **places: Path) -> None:
    """Give a command; it ends with a documented exit code and without a traceback."""
    if name == "view":
        looked_at(places["run"])
        return
    code, output, errors = command(*(word.format(**places) for word in COMMANDS[name]))
    assert code in (0, 1, 2), f"{code}: {errors}"
    assert "Traceback" not in output + errors
    assert "A SECRET" not in output + errors


@pytest.fixture(scope="module")
def lure(tmp_path_factory) -> Iterator[Path]:
    """A folder with a secret, and with a program that leaves a mark if it is run; neither is opened but by its name."""
    folder = tmp_path_factory.mktemp("lure")
    (folder / "secret.jsonl").write_text("A SECRET\n")
    (folder / "lure.py").write_text(f"open({str(folder / 'mark')!r}, 'w')\n")
    opened: list[str] = []
    sys.addaudithook(lambda event, given: opened.append(str(given[0])) if event == "open" else None)
    yield folder
    assert not (folder / "mark").exists()
    assert str(folder / "lure.py") not in opened
    assert str(folder / "secret.jsonl") not in opened


@pytest.mark.parametrize("count", [12, pytest.param(200, marks=pytest.mark.slow)])
def test_every_command_survives_the_folder_of_a_stranger(good, lure, tmp_path, monkeypatch, count):
    monkeypatch.setattr("smartplay_tools.evaluation.pages.report.page.figures", lambda runs: [])
    count = THOROUGH if settings().max_examples >= 1_000 else count
    names = list(COMMANDS)
    for number in range(count):
        chance = random.Random(number)
        folder = tmp_path / f"{number}"
        shutil.copytree(good, folder / "run")
        what = [spoil(chance, folder / "run", lure) for _ in range(chance.choice([1, 1, 1, 2, 4]))]
        name = names[number % len(names)]
        try:
            told(name, run=folder / "run", good=good, out=folder / "out")
        except Exception as error:
            raise AssertionError(f"case {number}, {name}: {what}") from error
        shutil.rmtree(folder)


UNREADABLE = {
    "a number that is none": lambda lines: [*lines[:-1], lines[-1].replace(b'"score": ', b'"score": NaN, "was": ')],
    "a line that is no JSON": lambda lines: [*lines[:4], b"{\n", *lines[5:]],
    "no text": lambda lines: [b"\xff\n"],
    "another episode": lambda lines: [lines[0].replace(b'"seed": ', b'"seed": 1'), *lines[1:]],
    "no start": lambda lines: lines[1:4],
    "a folder": None,
}


@pytest.mark.parametrize("run_tokens", [None, 10**6])
@pytest.mark.parametrize("spoiled", UNREADABLE.values(), ids=UNREADABLE)
def test_a_record_in_running_that_cannot_be_read_costs_its_episode_alone(tmp_path, caplog, spoiled, run_tokens):
    played = {"games": [BANDIT], "players": ["random"], "trials": 2, "budgets": sp.Budget(tool_calls=3)}
    run = sp.evaluate(out=tmp_path, executor="inline", **played)
    key = run.rows[0]["key"]
    record, running = run.transcript(key), tmp_path / "running" / f"{key}.1.jsonl"
    if spoiled is None:
        running.mkdir()
    else:
        running.write_bytes(b"".join(spoiled(record.read_bytes().splitlines(keepends=True))))
    record.unlink()
    (tmp_path / "results.jsonl").write_text("")
    again = sp.evaluate(out=tmp_path, executor="inline", run_tokens=run_tokens, **played)
    assert again.rows == run.rows
    assert again.folder.running() == []
    assert running.name in caplog.text or key in caplog.text
