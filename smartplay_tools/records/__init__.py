"""Records and the folders that hold them: read, replayed, continued, priced and added up.

record          an episode as its record tells it
prompts         every prompt rebuilt from a record and verified
driver, replays a record played again on a new game and compared
resumption      an episode continued from its record
rows            the results of episodes as plain data
prices          what tokens cost
run_folder      the folder of a run
spent, spending what episodes and runs have used
parallel        many records read by several processes

Nothing here plays: a model or a player is never called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.lazy import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.records.prices import Price
    from smartplay_tools.records.prompts import SentPrompt, recorded_turns, sent_prompts
    from smartplay_tools.records.record import Record
    from smartplay_tools.records.replays import Replay, replay
    from smartplay_tools.records.resumption import Resumed, resume
    from smartplay_tools.records.run_folder import RunFolder
    from smartplay_tools.records.seeds import trial_seed
    from smartplay_tools.records.snapshot import CellSnapshot, RunSnapshot, Spending, run_snapshot
    from smartplay_tools.records.spent import Spent

__all__ = [
    "CellSnapshot",
    "Price",
    "Record",
    "Replay",
    "Resumed",
    "RunFolder",
    "RunSnapshot",
    "SentPrompt",
    "Spending",
    "Spent",
    "recorded_turns",
    "replay",
    "resume",
    "run_snapshot",
    "sent_prompts",
    "trial_seed",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_exports(
        __name__,
        {
            "prices": ("Price",),
            "prompts": ("SentPrompt", "recorded_turns", "sent_prompts"),
            "record": ("Record",),
            "replays": ("Replay", "replay"),
            "resumption": ("Resumed", "resume"),
            "run_folder": ("RunFolder",),
            "seeds": ("trial_seed",),
            "snapshot": ("CellSnapshot", "RunSnapshot", "Spending", "run_snapshot"),
            "spent": ("Spent",),
        },
    )
