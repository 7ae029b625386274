"""The environment as a server: `server`, or `uvicorn server.app:app`, which does not end half-sent requests.

`SMARTPLAY_GAME` and `SMARTPLAY_REWARD` choose what is played, and for what.
"""

from __future__ import annotations

import os

from smartplay_openenv import new_app

from smartplay_tools.web import Server

app = new_app(
    os.environ.get("SMARTPLAY_GAME", "Hanoi3Disk-v0"), reward=os.environ.get("SMARTPLAY_REWARD", "normalized")
)


def main() -> None:
    """Serve on port 8000."""
    Server(app, "0.0.0.0", 8000, lifespan=True, websockets=True).run()
