"""OpenEnv: the games as an environment server.

    app = new_app("Hanoi3Disk-v0")                                # uvicorn module:app

The server is for hosts that manage the context themselves.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_openenv", "openenv"):
    import openenv as _openenv  # noqa: F401

from smartplay_openenv.environment import SPLITS, ResetObservation, SmartPlayEnvironment, SmartPlayState, new_app

__all__ = [
    "SPLITS",
    "ResetObservation",
    "SmartPlayEnvironment",
    "SmartPlayState",
    "new_app",
]
