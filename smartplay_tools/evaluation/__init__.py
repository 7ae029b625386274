"""Evaluation: runs of many episodes that are kept on disk, statistics with intervals, pages and submissions.

runs/      plays episodes and keeps their records
analysis/  computes statistics from rows, and draws them
pages/     shows runs and records: the replay page, the site, notebooks
board/     submissions, and the leaderboard of those that were verified
suites     the fixed lists of games and budgets that results are compared on

`analysis` and `pages` play nothing; `board` does not import what plays. What all of them read, records and the folders
that hold them, is `smartplay_tools.records`. Names are imported at first use, so that reading a run does not load the
code that plays one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.evaluation.runs.players import PlayerConfig as PlayerConfig
    from smartplay_tools.evaluation.runs.run_options import (
        RunFile as RunFile,
        RunOptions as RunOptions,
        read_run_file as read_run_file,
    )
    from smartplay_tools.evaluation.runs.runner import Run as Run, evaluate as evaluate
    from smartplay_tools.evaluation.runs.sweeps import Sweep as Sweep, sweep as sweep

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.evaluation.runs.players": "PlayerConfig",
            "smartplay_tools.evaluation.runs.run_options": "RunFile read_run_file RunOptions",
            "smartplay_tools.evaluation.runs.runner": "Run evaluate",
            "smartplay_tools.evaluation.runs.sweeps": "Sweep sweep",
        },
    )
