"""The documentation type-checks: its Python passes `mypy --strict`, as a user's program would."""

from __future__ import annotations

import sys

import pytest

from tests.processes import printed_by
from tests.test_docs import ELSEWHERE, ROOT, blocks


@pytest.mark.slow
def test_the_python_of_readme_and_docs_passes_mypy_strict(tmp_path):
    for number, (page, code) in enumerate(blocks("python")):
        if page.name in ELSEWHERE:
            continue
        (tmp_path / f"{page.stem.replace('-', '_').lower()}_{number}.py").write_text(code, encoding="utf-8")
    # With the project's own options and cache: the package is not checked again.
    options = ["--strict", "--no-error-summary", "--config-file", ROOT / "pyproject.toml"]
    printed_by(sys.executable, "-m", "mypy", *options, "--cache-dir", ROOT / ".mypy_cache", ".", cwd=tmp_path)
