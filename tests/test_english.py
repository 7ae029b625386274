"""What the project says, comments included, is plain English: phrases that a native speaker would not say stay out."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

PHRASES = {
    r"(?<!there )\b(is|are|was|were) no (?!longer\b)": "is not a, has no, there is no",
    r"\bso many (?!that\b|resamples\b)": "at most N, a number of",
    r"\bfor who\b": "for those who",
    r"\bof (this|the) moment\b": "current",
    r"\bgets on\b": "keeps up",
    r"\bbesides\b": "in addition to, apart from, also",
    r"\ball the same\b": "still",
    r"\bgoes on from\b": "continues from",
    r"\ba limit of (the )?(framework|host|Inspect|trainer|TRL)'s (?!own\b)": "an Inspect limit, a limit of the trainer",
    r"\bdoes no I/O\b": "never calls a model",
}
"""Patterns of phrases, and what to write instead."""


WRITTEN = {".css", ".j2", ".js", ".md", ".py", ".toml", ".yaml", ".yml"}
GENERATED = {"__pycache__", "_board", "_build", "jupyter_execute", "node_modules"}
FOLDERS = ("docs", "smartplay_tools", "adapters", "tests", "examples", "experiments", "benchmarks", "hub", ".ci")
BESIDE = ("", ".github", "changelog.d")
"""Folders of which the files themselves are read: README and its neighbours, templates, and what has changed."""


@pytest.mark.parametrize("folder", [*FOLDERS, *BESIDE])
def test_no_phrase_is_a_translation(folder):
    """Pages, code with its comments, templates and scripts: what people write, wherever it stands."""
    for path in sorted((ROOT / folder).glob("*" if folder in BESIDE else "**/*")):
        is_written = path.is_file() and (path.suffix in WRITTEN or folder == ".ci")
        if not is_written or path == Path(__file__) or not GENERATED.isdisjoint(path.parts):
            continue
        text = path.read_text(encoding="utf-8")
        for phrase, instead in PHRASES.items():
            match = re.search(phrase, text, flags=re.IGNORECASE)
            assert match is None, f"{path.relative_to(ROOT)}: instead of {match and match[0]!r} write {instead}"
