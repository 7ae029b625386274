"""Running the endpoint: in a thread beside a test or a script, or in the foreground for the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from smartplay_openai.server.app import PlayerLike, endpoint_app
from smartplay_openai.server.limits import SimulatedLimits
from smartplay_tools.web import Server, check_address


class LocalEndpoint(Server):
    """A server for players; in a `with` block it runs in a thread of its own.

        with LocalEndpoint(sp.get_player("rule")) as endpoint:
            sp.play(episode, sp.get_player("openai:rule", base_url=endpoint.base_url))

    Arguments:
        players: the players; a request's `model` is a player's name.
        host, port: the address; port 0 is a free port. The address is bound at once.
        api_key: a key that requests must have.
        limits: simulated limits of a paid service, on the length of prompts and the rate of requests.
        hosts, origins: names under which it is reached, and web pages that may use it. An address that other machines
            reach needs the names and a key.
        app: an ASGI application to serve instead, such as one around `endpoint_app`.
    """

    def __init__(
        self,
        *players: PlayerLike,
        host: str = "127.0.0.1",
        port: int = 0,
        api_key: str | None = None,
        limits: SimulatedLimits | None = None,
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
        app: Any = None,
    ) -> None:
        check_address(host, api_key, hosts)
        made = endpoint_app(*players, api_key=api_key, limits=limits, hosts=hosts, origins=origins)
        super().__init__(app or made, host, port)
        self.base_url = f"{self.url}/v1"
