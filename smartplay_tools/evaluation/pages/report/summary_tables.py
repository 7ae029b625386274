"""The summary of a run for the page: the statistics of `analysis`, formatted as tables.

The figures of a run, as images in the page.

They are images, not markup, because an SVG in an `img` element cannot run scripts.
"""

from __future__ import annotations

import base64
import functools
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from smartplay_tools.episode.budgets import usual_tool_calls
from smartplay_tools.episode.config import Rules
from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.analysis.figures.run import write_figures
from smartplay_tools.evaluation.analysis.grouping import by_cell, differing
from smartplay_tools.evaluation.analysis.summary import CellSummary, RunSummary
from smartplay_tools.evaluation.pages.report.sources import ShownRun
from smartplay_tools.games.paper_tables import HUMAN_SCORES, PAPER_RESULTS
from smartplay_tools.games.specs import GAMES
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types import MISTAKES, Budget, ResolvedBudget

AXIS, MARGIN = 150, 6
AXIS_SCORES = (0.0, 1.2)
"""The normalised scores at the two ends of the axis."""


def failed_row(key: str, episode: Mapping[str, Any]) -> Row:
    """Return the row of a failed attempt that is not part of a run."""
    reason = "exception" if episode["result"] is None else episode["result"]["end_reason"]
    return {"key": key, "end_reason": reason, **{name: episode[name] for name in ("game", "player", "error")}}


def lines(summary: RunSummary) -> Iterator[dict[str, Any]]:
    """Yield a line of the table for every cell."""
    for cell in summary.cells:
        counted = {name: total / cell.episodes for name, total in cell.counts.items()}
        yield {
            "game": cell.cell.game,
            "player": cell.cell.player + "*" * cell.privileged,
            "rules": ", ".join([rules({**asdict(cell.cell), **cell.cell.rules}), *_made(cell, summary)]),
            "episodes": cell.episodes,
            "score": cell.score,
            "normalized": cell.normalized_score,
            "completion": cell.completion,
            "steps": counted["steps"],
            "prompt_tokens": cell.tokens.prompt / cell.episodes,
            "stable": cell.tokens.prefix_share,
            "mistakes": sum(counted[name] for name in MISTAKES),
            "scale": scale(cell),
        }


def _made(cell: CellSummary, summary: RunSummary) -> list[str]:
    """The tokenizer and the options of a player, where they tell its cells apart."""
    own, rivals = cell.cell, [each.cell for each in summary.cells if each.cell.player == cell.cell.player]
    tokenizers = {rival.tokenizer for rival in rivals}
    counted = [f"tokenizer {own.tokenizer}"] if len(tokenizers) > 1 else []
    return [*counted, *differing(own.player_options, [rival.player_options for rival in rivals])]


def scale(cell: CellSummary) -> dict[str, Any] | None:
    """Return the places of a score and the paper's scores on an axis; None if they are not comparable."""
    if cell.normalized_score is None or cell.cell.game not in HUMAN_SCORES:
        return None
    game, ends = cell.cell.game, interval(cell.normalized_score)
    human, *models = [paper.normalized[game] for paper in PAPER_RESULTS]
    return {
        "human": _place(human),
        "models": models,
        "places": [_place(model) for model in models],
        "ends": None if ends is None else [_place(end) for end in ends],
        "here": _place(cell.normalized_score.mean),
    }


def _place(normalized: float) -> float:
    """The place of a normalised score on an axis of `AXIS` pixels, limited to its ends."""
    low, high = AXIS_SCORES
    return round(MARGIN + (min(max(normalized, low), high) - low) / (high - low) * (AXIS - 2 * MARGIN), 1)


def interval(estimate: MeanEstimate) -> tuple[float, float] | None:
    """Return the ends of an interval; None if there is none to print."""
    if estimate.low is None or estimate.high is None:
        return None
    return estimate.low, estimate.high


def rules(facts: Mapping[str, Any]) -> str:
    """Return a short description of the budget and protocol of an episode."""
    words = [_budget_in_words(json.dumps(facts["budget"]), _usual_calls(facts["game"]))]
    words += [f"{name} {facts[name]}" for name, usual in Rules() if facts[name] != usual]
    words += [f"engine {facts['engine']}"] if facts["engine"] else []
    words += [f"{name} {value}" for name, value in sorted((facts["options"] or {}).items())]
    return ", ".join(words)


@functools.lru_cache(64)
def _budget_in_words(numbers: str, usual_calls: int | None) -> str:
    """What differs from the usual budget; a run has few budgets."""
    usual = Budget(result_tokens=None, tool_calls=usual_calls)
    return ResolvedBudget(**json.loads(numbers)).describe(beside=usual)


def _usual_calls(game: str) -> int | None:
    """The default cap on tool calls of a game; None if the game is not registered here."""
    return usual_tool_calls(GAMES[game].rollout) if game in GAMES else None


def totals(summary: RunSummary) -> dict[str, Any]:
    """Return the totals of a run's results; the cost is None if that of any result is not known."""
    costs = [cell.cost for cell in summary.cells]
    return {
        "finished": sum(cell.episodes for cell in summary.cells),
        "steps": sum(cell.counts["steps"] for cell in summary.cells),
        "prompt": sum(cell.tokens.prompt for cell in summary.cells),
        "reply": sum(cell.tokens.reply for cell in summary.cells),
        "cost": None if None in costs else sum(cost or 0.0 for cost in costs),
    }


FOLDER = "figures"
"""The folder of a run's figures, as SVG."""


def figures(runs: Sequence[ShownRun]) -> Iterator[dict[str, str]]:
    """Yield name and image of the figures of runs: those in a run's folder, or else those that can be drawn now.

    Several runs share their figures, so that what is to be compared stands in one. There are none without a run,
    without the extra `evaluation`, or for games that are not known here.
    """
    runs = [run for run in runs if run.sources.manifest]
    drawn_before = sorted((runs[0].path / FOLDER).glob("*.svg")) if len(runs) == 1 else []
    with tempfile.TemporaryDirectory() as folder:
        # A link could lead to any file of this machine, and the page is for others.
        for file in [file for file in drawn_before if not file.is_symlink()] or _draw(runs, Path(folder)):
            image = base64.b64encode(file.read_bytes()).decode("ascii")
            yield {"name": file.stem.replace("-", " "), "image": f"data:image/svg+xml;base64,{image}"}


def _draw(runs: Sequence[ShownRun], folder: Path) -> list[Path]:
    rows = [row for run in runs for row in run.sources.rows]
    try:
        if len(runs) > 1 and len(by_cell(rows)) < sum(len(by_cell(run.sources.rows)) for run in runs):
            # Two runs have played the same: they are told apart by their letters.
            rows = [{**row, "player": f"{run.letter} {row['player']}"} for run in runs for row in run.sources.rows]
        return write_figures(rows, folder, formats=["svg"])
    except SmartPlayError:
        return []
