"""The last section of docs/compaction.md is followed: a compactor of one's own beside the published rows."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.processes import printed_by

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "compaction.md"
GAMES = 2
"""Those that need no package: Lockers and Rock Paper Scissors."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (ROOT / "experiments").exists(), reason="not in a checkout"),
]


def run(command, folder, *more):
    script, *given = command.split()[1:]
    program = [sys.executable, ROOT / script, *given, *more]
    return printed_by(*program, cwd=folder)


def test_a_compactor_in_a_file_is_played_beside_the_published_rows_and_proved_without_it(tmp_path):
    section = PAGE.read_text(encoding="utf-8").partition("## Play yours in ten minutes\n")[2].partition("\n## ")[0]
    [written] = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    play, prove = re.findall(r"^python experiments/.*$", section, re.MULTILINE)
    mine = tmp_path / "mine.py"
    mine.write_text(written, encoding="utf-8")
    told = run(play, tmp_path, "--trials", "2")
    tables, row = told.split("The row to send in a pull request:\n")
    assert row.startswith("| mine.py:Mine |")
    assert row.count("[") >= GAMES
    assert row in tables
    assert "| LangChain, summary |" in tables
    assert (tmp_path / "runs" / "compaction" / "alone" / "compaction.svg").exists()
    mine.unlink()
    records = [*(tmp_path / "runs").rglob("episodes/*.jsonl")]
    assert len(records) >= 2 * GAMES
    assert run(prove, tmp_path) == f"{len(records)} of {len(records)} records are identical.\n"
    record = next(each for each in records if "Lockers" in each.read_text(encoding="utf-8"))
    text = record.read_text(encoding="utf-8")
    record.write_text(text.replace('"reward": 0.0', '"reward": 1.0', 1), encoding="utf-8")
    with pytest.raises(AssertionError):
        run(prove, tmp_path)
