"""A control of `experiments/learned.py`: Rock Paper Scissors with the manual of the slot machines.

Worlds, observations, actions and the rest of every prompt are those of Rock Paper Scissors. Who plays by the manual has
to play worse with this one; who only calls `read_manual` because its teacher did may not.
"""

from __future__ import annotations

from dataclasses import replace

import smartplay_tools as sp
from smartplay_tools.games.rock_paper_scissors import RockPaperScissors


class SwappedManual(RockPaperScissors):
    """Rock Paper Scissors, whose manual is about something else."""

    def _reset(self) -> str:
        observation = super()._reset()
        self.manual = sp.GAMES["BanditTwoArmedHighLowFixed-v0"].make().manual
        return observation


SWAPPED = replace(
    sp.GAMES["RockPaperScissorBasic-v0"], id="RockPaperScissorSwappedManual-v0", entry_point=SwappedManual
)
"""A setting of its own, which is not registered: nothing outside the experiment knows it."""
