"""OpenEnv: the games as an environment server, and a harness that shows a trained model the exact context window.

    app = new_app("Hanoi3Disk-v0")                                # uvicorn module:app
    sessions = SmartPlaySessions("Hanoi3Disk-v0", budget=sp.Budget(prompt_tokens=1500, slack=0.5))
    SmartPlayHarness().run_white_box(model_step, sessions.create(None, seed=7))

`SmartPlayEnvironment` is for hosts that manage the context themselves. With `SmartPlayHarness`, a trainer samples one
reply at a time, and each prompt is the window.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openenv", "openenv"):
    import openenv as _openenv  # noqa: F401

from smartplay_openenv.environment import SPLITS, ResetObservation, SmartPlayEnvironment, SmartPlayState, new_app
from smartplay_openenv.harness import SmartPlayHarness, SmartPlaySession, SmartPlaySessions

__all__ = [
    "SPLITS",
    "ResetObservation",
    "SmartPlayEnvironment",
    "SmartPlayHarness",
    "SmartPlaySession",
    "SmartPlaySessions",
    "SmartPlayState",
    "new_app",
]
