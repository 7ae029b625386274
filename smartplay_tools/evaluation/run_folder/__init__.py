"""The folder of a run: what it says, and how far the run is.

folder     the manifest (what a run plays, its seeds and shards), rows, records, people's notes about turns
follower   how far a run is
time_left  an estimate of the rest
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.evaluation.run_folder.folder import (
        Manifest as Manifest,
        RunFolder as RunFolder,
        Until as Until,
        trial_seed as trial_seed,
    )
    from smartplay_tools.evaluation.run_folder.follower import (
        CellSnapshot as CellSnapshot,
        RunSnapshot as RunSnapshot,
        Spending as Spending,
        run_snapshot as run_snapshot,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "smartplay_tools.evaluation.run_folder.folder": "RunFolder Manifest Until trial_seed",
            "smartplay_tools.evaluation.run_folder.follower": "run_snapshot CellSnapshot RunSnapshot Spending",
        },
    )
