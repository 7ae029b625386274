"""The questions of the experiment of `docs/experiments.md`: a sweep for each."""

from __future__ import annotations

from typing import Any

import smartplay_tools as sp

SMALL_GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0")

CONTROL = "random"

QUESTIONS: dict[str, dict[str, Any]] = {
    "history": {
        "games": SMALL_GAMES,
        "players": ("rule", CONTROL),
        "vary": {"history": (0, 1, 2, 5, 10, 20, 50)},
        "trials": 100,
    },
    "prompt-tokens": {
        "games": SMALL_GAMES,
        "players": ("rule",),
        "vary": {"prompt_tokens": (500, 600, 800, 1000, 1500, None)},
        "trials": 100,
    },
    "slack": {
        "games": SMALL_GAMES,
        "players": ("rule",),
        "vary": {
            "history": (10,),
            "slack": (0, 0.1, 0.25, 0.5, 0.75, 1),
        },
        "trials": 100,
    },
    "crafter": {
        "games": ("Crafter-v0",),
        "players": ("rule", "rule-notes"),
        "vary": {"history": (2, 5, 10)},
        # With notes the player lives for the paper's 10,000 steps; fewer are enough to show the effect of notes.
        "budget": sp.Budget(tool_calls=1000),
        "trials": 20,
    },
    "messenger": {
        "games": ("MessengerL1-v0", "MessengerL2-v0", "MessengerL3-v0"),
        "players": ("rule", "rule-notes"),
        # The rules use the newest four observations: the latest one and three past ones.
        "vary": {"history": (0, 1, 2, 3)},
        "trials": 20,
    },
    "strategies": {
        "games": ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0"),
        # A memory is written only where a strategy offers a place for it.
        "players": ("rule-notes",),
        "player_options": {"words": False},
        "vary": {
            "history": (10,),
            "prompt_tokens": (700, 1000),
            "slack": (0.5,),
            "beyond_history": ("drop", "mask"),
            "notes_tokens": (None, 200),
            "summary_tokens": (None, 100),
        },
        "trials": 20,
    },
    "money": {
        "games": ("BanditTwoArmedHighLowFixed-v0", "Crafter-v0"),
        "players": ("rule",),
        "vary": {
            "history": (None,),
            "prompt_tokens": (1200, 2400, 8000),
            "slack": (0, 0.5),
        },
        "budget": sp.Budget(tool_calls=300),
        "trials": 10,
    },
}
"""A sweep for each question."""
