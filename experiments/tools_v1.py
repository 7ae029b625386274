"""The suite tools-v1 played by the included players, and held against its reference rows.

    python experiments/tools_v1.py --out build/tools-v1

Git holds the rows and the plan of each run (`experiments/tools-v1`), not its records: they follow from the seed. This
script plays the runs and holds the rows against those in git. What was played before is kept, so a second call only
compares. `--record` writes the rows to git's folder instead, which is right only when a new suite is made.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path

import smartplay_tools as sp

PLAYERS = ("rule", "random", "first")

HERE = Path(__file__).parent / "tools-v1"
KEPT = ("seed", "cells", "episodes")
"""What is compared of a manifest; the rest says where and with which versions it was played."""


def play(player: str, out: Path, workers: int) -> Path:
    """Play the suite with a player, or what is left of it, and return the run's folder."""
    run = sp.evaluate([], [player], out=out / "runs" / player, suite="tools-v1", workers=workers)
    if not run.complete:
        sys.exit(f"{player}: {run.planned - len(run.rows)} episodes are not finished.")
    return run.folder.path


def rows(path: Path) -> list[dict]:
    """Return rows without versions, which say where they were played."""
    results = [json.loads(line) for line in path.read_text(encoding="ascii").splitlines()]
    return [{name: value for name, value in row.items() if name != "versions"} for row in results]


def compare(player: str, run: Path) -> None:
    """Hold a run against the reference in git."""
    played, published = rows(run / "results.jsonl"), rows(HERE / player / "results.jsonl")
    # Rows of later versions say more than those in git.
    if [{name: own.get(name) for name in row} for own, row in zip(played, published, strict=True)] != published:
        sys.exit(f"{player}: the rows are not those of {HERE / player}.")
    plans = [json.loads((folder / "manifest.json").read_bytes()) for folder in (run, HERE / player)]
    if any(plans[0][name] != plans[1][name] for name in KEPT):
        sys.exit(f"{player}: the plan is not that of {HERE / player}.")


def record(player: str, run: Path) -> None:
    """Copy rows and plan to git's folder."""
    (HERE / player).mkdir(parents=True, exist_ok=True)
    for name in ("results.jsonl", "manifest.json"):
        shutil.copyfile(run / name, HERE / player / name)


def main() -> None:
    """Play and compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("build/tools-v1"))
    parser.add_argument("--players", nargs="+", choices=PLAYERS, default=[*PLAYERS])
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--record", action="store_true", help="write the reference rows")
    asked = parser.parse_args()
    for player in asked.players:
        run = play(player, asked.out, asked.workers)
        if asked.record:
            record(player, run)
        compare(player, run)
        print(f"{player}: as in {HERE.name}", flush=True)


if __name__ == "__main__":
    main()
