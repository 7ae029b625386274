"""Statistics of the rows of a run: pure functions over plain data, which read no files and play nothing.

    summarize        turns the rows of a run into scores with intervals, counts, tokens, cost, capabilities, baselines
    compare          compares runs, pair by pair
    compare_windows  compares the cells of a sweep with full context
    write_csv        writes rows as a table (`write_parquet`: with types; `summary_json`: a summary as JSON)

`grouping` decides which episodes are averaged together, `intervals` estimates means.
"""

from smartplay_tools.evaluation.analysis.capabilities import Capabilities, capability_scores
from smartplay_tools.evaluation.analysis.comparison import Comparison, Overall, Pairing, Side, compare
from smartplay_tools.evaluation.analysis.comparison_tables import comparison_tables
from smartplay_tools.evaluation.analysis.decisions import Margin, Verdict, decide
from smartplay_tools.evaluation.analysis.details import details
from smartplay_tools.evaluation.analysis.formats import TextTable, to_html, to_latex, to_markdown
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.intervals import Bounds, MeanEstimate, Method, mean_estimate
from smartplay_tools.evaluation.analysis.pairs import MEASURES, differences, paired_difference
from smartplay_tools.evaluation.analysis.summary import (
    CellSummary,
    Failures,
    Profile,
    RunSummary,
    summarize,
)
from smartplay_tools.evaluation.analysis.tables import summary_json, write_csv, write_parquet
from smartplay_tools.evaluation.analysis.window_tables import windows_table
from smartplay_tools.evaluation.analysis.windows import WindowComparison, compare_windows, pareto_front
from smartplay_tools.records.rows import Row

__all__ = [
    "MEASURES",
    "Bounds",
    "Capabilities",
    "CellSummary",
    "Comparison",
    "Failures",
    "Margin",
    "MeanEstimate",
    "Method",
    "Overall",
    "Pairing",
    "Profile",
    "Row",
    "RunSummary",
    "Side",
    "TextTable",
    "Verdict",
    "WindowComparison",
    "by_cell",
    "capability_scores",
    "compare",
    "compare_windows",
    "comparison_tables",
    "decide",
    "details",
    "differences",
    "headline",
    "mean_estimate",
    "paired_difference",
    "pareto_front",
    "summarize",
    "summary_json",
    "to_html",
    "to_latex",
    "to_markdown",
    "windows_table",
    "write_csv",
    "write_parquet",
]
