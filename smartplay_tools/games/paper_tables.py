"""The paper's tables: capabilities, the settings of its results, and what people and models scored.

The numbers are in `paper_tables.json`; here each table is labelled with its place in the paper (arXiv 2310.01557).
"""

from __future__ import annotations

import json
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

_TABLES = json.loads(pkgutil.get_data(__package__, "paper_tables.json") or b"")

CAPABILITIES: tuple[str, ...] = tuple(_TABLES["capabilities"])
"""The nine capabilities, in the order of the paper's table 3."""

PAPER_SETTINGS: tuple[str, ...] = tuple(_TABLES["settings"])
"""The seven settings of the paper's result tables, in their order."""


@dataclass(frozen=True)
class PaperResult:
    """One player's row in the paper: mean scores by setting, raw and as the paper normalises them."""

    player: str
    raw: Mapping[str, float]
    normalized: Mapping[str, float]


def _by_setting(numbers: Iterable[float]) -> Mapping[str, float]:
    return MappingProxyType(dict(zip(PAPER_SETTINGS, numbers, strict=True)))


PAPER_RESULTS = tuple(
    PaperResult(player, _by_setting(scores["raw"]), _by_setting(scores["normalized"]))
    for player, scores in _TABLES["results"].items()
)
"""The human baseline and the eight models of the paper, in its order (`table:llm_perf_absolute`, `table:llm_perf`)."""

MIN_SCORES = _by_setting(_TABLES["min_scores"])
"""The lowest score of the settings that have a human baseline (paper, appendix)."""

HUMAN_SCORES: Mapping[str, float] = PAPER_RESULTS[0].raw
"""The human scores: means of three practised players, over 9 episodes of the bandit and Rock Paper Scissors, 15 of
MESSENGER and 3 of the others. A setting that is not in this table has no normalised score."""


def normalize(score: float, human_score: float, min_score: float) -> float:
    """Score relative to a human's: (score - min) / (human - min).

    The paper's appendix prints another formula, but its tables follow this one.
    """
    return (score - min_score) / (human_score - min_score)
