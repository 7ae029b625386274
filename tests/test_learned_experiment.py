"""The tables of models that play agree with the published rows, of which nothing has to be trained or played again."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

import smartplay_tools as sp
from smartplay_tools.records.rows import read_rows, row_fault

ROOT = Path(__file__).parents[1]
EXPERIMENTS = ROOT / "experiments"

pytestmark = pytest.mark.skipif(not EXPERIMENTS.exists(), reason="not in a checkout")


def script(name):
    spec = importlib.util.spec_from_file_location(f"experiment_{name}", EXPERIMENTS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_of_the_tiny_agent_has_the_tables_of_the_rows():
    learned = script("learned")
    page = (ROOT / "docs" / "train-a-tiny-agent.md").read_text(encoding="utf-8")
    tables = learned.tables(learned.Played(learned.PUBLISHED / "episodes.csv"))
    assert len(tables) == 2
    assert all(f"<!-- table: {name} -->\n\n{table}\n\n<!-- end -->" in page for name, table in tables.items())


def test_every_cell_has_every_world_once():
    learned = script("learned")
    played = learned.Played(learned.PUBLISHED / "episodes.csv")
    assert set(played.rows) <= set(learned.cells())
    assert all([row["trial"] for row in rows] == list(range(learned.WORLDS)) for rows in played.rows.values())


def test_the_page_of_local_models_has_the_table_of_the_rows():
    local = script("local")
    rows = [row for path in local.PUBLISHED.glob("*/results.jsonl") for row in read_rows(path)]
    assert not any(map(row_fault, rows))
    page = (ROOT / "docs" / "local.md").read_text(encoding="utf-8")
    assert f"<!-- table: local -->\n\n{local.table(rows)}\n\n<!-- end -->" in page


def test_a_published_record_replays():
    assert sp.replay(EXPERIMENTS / "learned" / "records" / "full-0.600.drop.jsonl").identical
