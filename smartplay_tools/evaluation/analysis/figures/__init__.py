"""Figures of a run. They need the extra `evaluation`; `save_figure` writes PNG, SVG and PDF."""

from smartplay_tools.evaluation.analysis.figures.capability_dots import capability_dots
from smartplay_tools.evaluation.analysis.figures.curves import (
    areas_under_curves,
    effects_of_slack,
    score_against_history,
    score_against_prompt_tokens,
)
from smartplay_tools.evaluation.analysis.figures.frontier import frontier
from smartplay_tools.evaluation.analysis.figures.prompt_figures import prompt_rows, tokens_by_part
from smartplay_tools.evaluation.analysis.figures.run import run_figures, write_figures
from smartplay_tools.evaluation.analysis.figures.style import save_figure

__all__ = [
    "areas_under_curves",
    "capability_dots",
    "effects_of_slack",
    "frontier",
    "prompt_rows",
    "run_figures",
    "save_figure",
    "score_against_history",
    "score_against_prompt_tokens",
    "tokens_by_part",
    "write_figures",
]
