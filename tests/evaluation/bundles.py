"""Bundles for tests: prepared from runs that are really played, and changed as somebody would who cheats."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.board.submissions.prepare import prepare_submission
from smartplay_tools.transcript.hashing import chained_lines

HANOI, BANDIT = "Hanoi3Disk-v0", "BanditTwoArmedHighLowFixed-v0"

FACTS = {
    "model_name": "An agent",
    "model_organization": "Its makers",
    "submitting_organization": "Its friends",
    "submission_date": "2026-01-31",
    "submission_type": "custom",
}

Files = dict[str, bytes]


def play_bundle(folder: Path, player: str = "rule", seed: int = 0, **facts: Any) -> Path:
    """Play a small run and return its bundle."""
    sp.evaluate([HANOI, BANDIT], [player], out=folder / "run", trials=2, seed=seed, executor="inline")
    prepare_submission(folder / "run", folder / "bundle.zip", {**FACTS, **facts})
    return folder / "bundle.zip"


def read(bundle: Path) -> Files:
    with zipfile.ZipFile(bundle) as files:
        return {name: files.read(name) for name in files.namelist()}


def write(path: Path, files: Files) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, data in files.items():
            bundle.writestr(name, data)
    return path


def changed(bundle: Path, path: Path, change: Callable[[Files], None]) -> Path:
    """Return a copy of a bundle whose files were changed."""
    files = read(bundle)
    change(files)
    return write(path, files)


def edit_json(files: Files, name: str, change: Callable[[Any], None]) -> None:
    value = json.loads(files[name])
    change(value)
    files[name] = json.dumps(value).encode()


def records(files: Files, game: str) -> list[str]:
    """Return the names of the records of a game."""
    start = b'"game": "' + game.encode()
    return [name for name, data in files.items() if name.startswith("episodes/") and start in data.split(b"\n")[0]]


def edit_record(files: Files, name: str, change: Callable[[list[dict[str, Any]]], None]) -> None:
    """Change the events of a record and compute its chain anew, as somebody does who knows how."""
    events = [json.loads(line) for line in files[name].splitlines()]
    change(events)
    files[name] = chained(events)


def chained(events: list[dict[str, Any]]) -> bytes:
    for event in events:
        event.pop("chain", None)
    return chained_lines(events, "")[0]
