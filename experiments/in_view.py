"""Does what was in view say what an episode scores? Their rank correlation over all ways of docs/compaction.md.

    python experiments/in_view.py         # of the published rows, in seconds
    python experiments/in_view.py FILE    # of rows that were played: JSON lines with stage, way and questions_up_to

In view is the share of the answers for which all that is needed stood in the prompt. An answer that an early end has
left out counts as out of view. Beside it is the same for observations alone, shown whole.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from page_tables import HERE, markdown_table, read_rows

from smartplay_tools.evaluation.analysis.pairs import score
from smartplay_tools.records.contents import OBSERVATION
from smartplay_tools.records.remembered import IN_PLACE, SEEN, UNSEEN
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped


def answered(row: Row, *names: str) -> int:
    """Return how many answers of an episode have one of these names in its `memory`."""
    return sum(row["memory"].get(name, (0, 0))[1] for name in names)


def rank_correlation(pairs: Iterable[tuple[float, float]]) -> float:
    """Return Spearman's rho of pairs, equal values with their mean rank; not a number if one side is constant."""
    ranks = [_ranks(np.array(side).round(9)) for side in zip(*pairs, strict=True)]
    return float(np.corrcoef(*ranks)[0, 1]) if all(np.ptp(each) for each in ranks) else math.nan


def _ranks(values: np.ndarray) -> np.ndarray:
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[places]


def in_view_table(rows: Iterable[Row]) -> str:
    """Return the correlations in each game of rows that say what was in view."""
    stages = grouped((row for row in rows if row.get("memory")), lambda row: (row["stage"], row.get("cap", "")))
    lines = [line for (stage, _), members in stages.items() if (line := _line(stage, members))]
    return markdown_table(("game", "ways", "in view", "observations alone"), lines)


def _line(stage: str, rows: Sequence[Row]) -> list[str]:
    """Return the line of a game; an empty one if nothing is needed in it."""
    worlds = grouped(rows, lambda row: row["seed"])
    asked = {seed: max(answered(row, SEEN, UNSEEN) for row in members) for seed, members in worlds.items()}
    ways = list(grouped(rows, lambda row: (row["way"], row["questions_up_to"])).values())
    if not all(asked.values()) or len(ways) < 3:
        return []

    def correlation(seen: Callable[[Row], int]) -> str:
        rho = rank_correlation((_share(own, seen, asked), _mean(own)) for own in ways)
        return "none differ" if math.isnan(rho) else f"{rho:.2f}"

    has_places = any(name.startswith(IN_PLACE) for row in rows for name in row["memory"])
    whole = IN_PLACE + OBSERVATION if has_places else SEEN
    content = correlation(lambda row: answered(row, SEEN)) if has_places else ""
    return [stage, str(len(ways)), content, correlation(lambda row: answered(row, whole))]


def _share(rows: Sequence[Row], seen: Callable[[Row], int], asked: Mapping[int, int]) -> float:
    return sum(map(seen, rows)) / sum(asked[row["seed"]] for row in rows)


def _mean(rows: Sequence[Row]) -> float:
    return math.fsum(map(score, rows)) / len(rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="?", type=Path, help="rows; by default the published ones")
    file = parser.parse_args().file
    lines = file.read_text(encoding="utf-8").splitlines() if file else []
    print(in_view_table(map(json.loads, lines) if file else read_rows(HERE / "compaction" / "rows.jsonl.xz")))


if __name__ == "__main__":
    main()
