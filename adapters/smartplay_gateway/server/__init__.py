"""The local endpoint: any player behind OpenAI's interface, on this machine.

Tests, examples and demonstrations use it instead of a paid model, through the same client and the same wire format:
chat completions and Responses, with tools, streams, usage and errors. It stores no conversations, so it can serve as
many at once as its player can.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("An endpoint", "serve"):
    from smartplay_gateway.server.app import LocalEndpoint, SimulatedLimits, endpoint_app

__all__ = ["LocalEndpoint", "SimulatedLimits", "endpoint_app"]
