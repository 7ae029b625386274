"""Every example runs as it is, without a key and without a network, and is short enough to read."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.processes import printed_by

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))
ELSEWHERE = {"16_evaluate_pydantic_ai", "20_train_a_tiny_agent"}
"""Examples that need an extra with an environment of its own in `.ci/run`, where their extra's tests run them."""


@pytest.mark.slow
@pytest.mark.parametrize("path", [path for path in EXAMPLES if path.stem not in ELSEWHERE], ids=lambda path: path.stem)
def test_it_runs(path, tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_API_KEY")}
    command = [sys.executable, "-W", "error", str(path)]
    shown = printed_by(*command, cwd=tmp_path, env=environment)
    assert shown.strip()


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_is_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) < 80
