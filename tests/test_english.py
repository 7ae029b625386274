"""Documentation, docstrings and messages are plain English: phrases that a native speaker would not say stay out."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import smartplay_tools

ROOT = Path(smartplay_tools.__file__).parents[1]

PHRASES = {
    r"(?<!there )\b(is|are|was|were) no (?!longer\b)": "is not a, has no, there is no",
    r"\bso many (?!that\b|resamples\b)": "at most N, a number of",
    r"\bfor who\b": "for those who",
    r"\bof (this|the) moment\b": "current",
    r"\bgets on\b": "keeps up",
    r"\bbesides\b": "in addition to, apart from, also",
    r"\ball the same\b": "still",
    r"\bgoes on from\b": "continues from",
    r"\ba limit of \w+( \w+)?'s?(?= \W)": "an Inspect limit, a limit of the trainer",
    r"\bdoes no I/O\b": "never calls a model",
}
"""Patterns of phrases, and what to write instead."""


def texts(folder: str) -> list[tuple[str, str]]:
    """The pages of `docs`, or the docstrings and messages of the modules in a folder."""
    if folder == "docs":
        return [(page.name, page.read_text(encoding="utf-8")) for page in sorted(ROOT.glob("docs/*.md"))]
    strings: list[tuple[str, str]] = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        constants = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
        strings += [(str(path.relative_to(ROOT)), text) for text in constants if isinstance(text, str)]
    return strings


@pytest.mark.parametrize("folder", ["docs", "smartplay_tools", "adapters"])
def test_no_phrase_is_a_translation(folder):
    strings = texts(folder)
    for phrase, instead in PHRASES.items():
        pattern = re.compile(phrase, flags=re.IGNORECASE)
        written = [(name, match.group()) for name, text in strings for match in pattern.finditer(text)]
        assert not written, f"write instead: {instead}"
