"""The site on an address: this machine's own by default; any other needs a token and the names it is reached by."""

from __future__ import annotations

import secrets
from collections.abc import Sequence

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.pages.view.app import view_app
from smartplay_tools.evaluation.pages.view.playing import PlayedGames
from smartplay_tools.evaluation.pages.view.run_list import RunList
from smartplay_tools.evaluation.pages.view.site_runs import ViewedRun
from smartplay_tools.web import Server, is_loopback


class ViewServer(Server):
    """A server of the site; `run` serves until it is stopped, `with` serves in a thread."""

    def __init__(
        self,
        runs: RunList | Sequence[ViewedRun],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        hosts: Sequence[str] = (),
        play: PlayedGames | None = None,
        plugins: bool = False,
        annotate: bool = False,
    ) -> None:
        is_open = not is_loopback(host)
        if is_open and not hosts:
            raise InvalidArgumentError(
                f"Other machines can reach {host}: give the host names under which it is reached."
            )
        if is_open and token is None:
            token = secrets.token_urlsafe(24)
        app = view_app(
            runs,
            token=token,
            hosts=hosts,
            play=play,
            plugins=plugins,
            annotate=annotate,
            is_stopping=lambda: self.is_stopping,
        )
        super().__init__(app, host, port)
        self.url = f"{self.address(hosts[0]) if is_open else self.url}/"
        self.entry = self.url if token is None else f"{self.url}?token={token}"
        """The address that a browser opens first; the token is kept in a cookie from then on."""
