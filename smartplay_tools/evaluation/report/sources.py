"""Sources: which episodes a page shows. A run folder, a folder of transcripts, or one transcript.

What is shown comes from the transcripts, which exist from an episode's first event on; `results.jsonl` adds what only
the run knows: the order of the plan, the trial, the price.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from smartplay_tools.errors import InvalidArgumentError

ROWS, EPISODES, MANIFEST = "results.jsonl", "episodes", "manifest.json"


@dataclass(frozen=True)
class Source:
    """An episode: its key in the page, its transcript, and its row if the run has one."""

    key: str
    transcript: Path
    row: dict[str, Any] = field(default_factory=dict)


def find_episodes(path: Path) -> list[Source]:
    """Return the episodes of a run folder, of a folder of transcripts or of one file, in their order."""
    if path.is_file():
        return [Source(path.stem, path)]
    if not path.exists():
        raise InvalidArgumentError(f"There is no {path}; name a run folder or a transcript.")
    folder = path / EPISODES if (path / EPISODES).is_dir() else path
    rows = {row["key"]: row for row in _rows(path / ROWS)}
    files = {file.stem: file for file in sorted(folder.glob("*.jsonl")) if file != path / ROWS}
    # Rows first, in the order of the plan; what failed or is still under way has none and comes after them.
    keys = [key for key in rows if key in files] + [key for key in files if key not in rows]
    sources = [Source(key, files[key], rows.get(key, {})) for key in keys if files[key].stat().st_size]
    if not sources:
        raise InvalidArgumentError(f"{path} holds no transcripts; name a run folder or a transcript.")
    return sources


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the manifest of a run folder; empty where there is none."""
    file = path / MANIFEST
    manifest: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return manifest


def _rows(file: Path) -> list[dict[str, Any]]:
    if not file.is_file():
        return []
    rows = []
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue  # torn by whatever ended the run; the transcript says how far the episode came
    return rows
