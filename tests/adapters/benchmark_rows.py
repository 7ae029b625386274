"""The rows that `benchmarks/training_rows.py` counts in a record, for the trainers that make them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from smartplay_tools.records import Record

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "training_rows.py"


def rows_of(record: Path) -> int:
    spec: Any = importlib.util.spec_from_file_location("training_rows", BENCHMARK)
    benchmark: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    return int(benchmark.rows_of(Record.read(record)).rows)
