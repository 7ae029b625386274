"""The paper's tables, as data: capabilities, the settings of its results, and what people and models scored.

Every number is labelled with the table that it comes from (arXiv 2310.01557).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

CAPABILITIES = (
    "long text understanding",
    "reasoning",
    "instruction following",
    "planning",
    "generalization",
    "understanding the odds",
    "learning from interactions",
    "error handling",
    "spatial reasoning",
)
"""The nine capabilities, in the order of the paper's table 3."""


PAPER_SETTINGS = (
    "BanditTwoArmedHighLowFixed-v0",
    "RockPaperScissorBasic-v0",
    "Hanoi3Disk-v0",
    "MessengerL1-v0",
    "MessengerL2-v0",
    "Crafter-v0",
    "MinedojoCreative0-v0",
)
"""The seven settings of the paper's result tables, in their order."""


@dataclass(frozen=True)
class PaperResult:
    """One player's row in the paper: mean scores by setting, raw and as the paper normalises them."""

    player: str
    raw: Mapping[str, float]
    normalized: Mapping[str, float]


def _paper_result(player: str, raw: tuple[float, ...], normalized: tuple[float, ...]) -> PaperResult:
    return PaperResult(
        player,
        MappingProxyType(dict(zip(PAPER_SETTINGS, raw, strict=True))),
        MappingProxyType(dict(zip(PAPER_SETTINGS, normalized, strict=True))),
    )


PAPER_RESULTS: tuple[PaperResult, ...] = (
    # Tables `table:llm_perf_absolute` and `table:llm_perf`.
    _paper_result("human", (45, 43, 3, 1, 1, 2680, 1), (1.00, 1.00, 1.00, 1.00, 1.00, 1.00, 1.00)),
    _paper_result("GPT-4-0613", (45.09, 39.25, 2.5, 0.8, 0.85, 700, 0.61), (1.00, 0.91, 0.83, 0.90, 0.93, 0.26, 0.61)),
    _paper_result(
        "GPT-4-0314",
        (43.86, 42.05, 2.7, 0.74, 0.93, 845.6, 0.592),
        (0.97, 0.98, 0.90, 0.87, 0.97, 0.32, 0.59),
    ),
    _paper_result(
        "text-davinci-003",
        (46.92, 17.0, 1.5, 0.24, -0.07, 186.25, 0.449),
        (1.04, 0.40, 0.50, 0.62, 0.46, 0.07, 0.45),
    ),
    _paper_result("Claude", (32.43, 20.3, 2, -0.12, 0.2, 143.3, 0.5), (0.72, 0.47, 0.67, 0.44, 0.60, 0.05, 0.50)),
    _paper_result("Bard", (38.85, 12.9, 2, 0.22, -0.21, 112.3, 0.54), (0.86, 0.30, 0.67, 0.61, 0.40, 0.04, 0.54)),
    _paper_result(
        "llama-2-13b",
        (22.33, 15.05, 1.1, -0.76, -0.745, 115.3, 0.606),
        (0.50, 0.35, 0.37, 0.12, 0.13, 0.04, 0.61),
    ),
    _paper_result("llama-13b", (30.5, 21.4, 1, -0.68, -0.885, 100.2, 0.5), (0.68, 0.50, 0.33, 0.16, 0.06, 0.04, 0.50)),
    _paper_result("vicuna-13b", (28.81, 7.1, 0.2, -1, -0.76, 56.7, 0.43), (0.64, 0.17, 0.07, 0.00, 0.12, 0.02, 0.43)),
)
"""The human baseline and the eight models of the paper, in its order."""

MIN_SCORES: Mapping[str, float] = MappingProxyType(dict(zip(PAPER_SETTINGS, (0, 0, 0, -1, -1, 0, 0), strict=True)))
"""The lowest score of the settings that have a human baseline (paper, appendix)."""

HUMAN_SCORES: Mapping[str, float] = PAPER_RESULTS[0].raw
"""The human scores: means of three practised players, over 9 episodes of the bandit and Rock Paper Scissors, 15 of
MESSENGER and 3 of the others. A setting that is not in this table has no normalised score."""


def normalize(score: float, human_score: float, min_score: float) -> float:
    """Score relative to a human's: (score - min) / (human - min).

    The paper's appendix prints another formula, but its tables follow this one.
    """
    return (score - min_score) / (human_score - min_score)
