"""The documentation is correct: its Python runs, and its links lead somewhere; `test_commands.py` runs its commands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(path for path in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")] if path.exists())
BLOCK = re.compile(r"^```(python|python continued)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)


ELSEWHERE = {
    "inspect.md": "inspect_ai",
    "openenv.md": "openenv",
    "pydantic-ai.md": "pydantic_ai",
    "traces.md": "opentelemetry.sdk",
    "trl.md": "trl",
    "verifiers.md": "verifiers",
}
"""Pages whose Python needs a framework that has an environment of its own in `.ci/run`, and the framework's module."""


def blocks(kind: str) -> list[tuple[Path, str]]:
    """The blocks of one kind; a `python continued` block continues the block before it."""
    pieces: list[tuple[Path, str]] = []
    for page in PAGES:
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if language == f"{kind} continued":
                pieces[-1] = (page, pieces[-1][1] + "\n" + text)
            elif language == kind:
                pieces.append((page, text))
    return pieces


PYTHON = [
    pytest.param(page, code, id=page.name, marks=() if page.name == "README.md" else pytest.mark.slow)
    for page, code in blocks("python")
]
"""Of all pages, the one that everybody reads is run with every change."""


@pytest.mark.parametrize(("page", "code"), PYTHON)
def test_the_python_runs_as_printed(page, code, tmp_path, monkeypatch):
    if page.name in ELSEWHERE:
        pytest.importorskip(ELSEWHERE[page.name], reason="`.ci/run` has an environment with it")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, page.name, "exec"), {"__name__": "__main__"})


def test_every_link_leads_somewhere():
    for page in PAGES:
        prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for target in re.findall(r"\]\(([^)#]+)\)", prose):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_readme_s_example_is_ten_lines():
    _, code = blocks("python")[0]
    assert len(code.strip().splitlines()) <= 10
