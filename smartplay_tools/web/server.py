"""A server for an ASGI application: in the foreground for a command, or in a thread beside a script or a test.

Every server of the package is one of these, on a socket that `listening` opens.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Sequence
from typing import Any, Self

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.web import bodies


def listening(host: str, port: int, backlog: int = 128) -> socket.socket:
    """Return a socket that listens; an address that is taken is an `InvalidArgumentError`. Port 0 is a free one."""
    # asyncio sends small answers at once only on sockets whose protocol is named; else each may wait for 40 ms.
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        raise InvalidArgumentError(
            f"Nothing can listen on {host}:{port}: {error.strerror}; name another --port, or 0 for a free one."
        ) from error
    made.listen(backlog)
    return made


BACKLOG = 2048
"""Connections that may wait to be accepted, since a thousand agents may begin at once."""

GRACE = 1
"""Seconds that open requests get when the server stops, so that no client can delay the end."""


class Server:
    """A server for an application. Its address is bound at once; `run` serves until it is stopped, `with` in a thread.

    Arguments:
        app: the application.
        host, port: where to listen; port 0 is a free one.
        lifespan: whether the application handles the lifespan events of ASGI.
        websockets: whether it serves web sockets.
        asks: what the application asks; an object with `close_in_loop` closes its connections when the server stops.
    """

    def __init__(
        self,
        app: ASGIApp,
        host: str,
        port: int,
        *,
        lifespan: bool = False,
        websockets: bool = False,
        asks: Sequence[object] = (),
    ) -> None:
        self._socket = listening(host, port, BACKLOG)
        config = uvicorn.Config(
            app,
            log_level="warning",
            lifespan="on" if lifespan else "off",
            http=_Connection,
            ws="auto" if websockets else "none",
            ws_max_size=bodies.LARGEST_CALL,
            backlog=BACKLOG,
            timeout_graceful_shutdown=GRACE,
        )
        self._server = _Uvicorn(config, asks)
        self._thread: threading.Thread | None = None
        self.url = self.address(host)

    def address(self, host: str) -> str:
        """Return the address of the server under the name of a host."""
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self._socket.getsockname()[1]}"

    @property
    def is_stopping(self) -> bool:
        """Whether the server was told to stop; an application with endless streams checks it to end these."""
        return self._server.should_exit

    def run(self) -> None:
        """Serve until the process is told to stop."""
        self._server.run([self._socket])

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self.run, name="server", daemon=True)
        self._thread.start()
        while not self._server.started and self._thread.is_alive():
            time.sleep(0.01)
        return self

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join()
        self._socket.close()


class _Uvicorn(uvicorn.Server):
    """A server that closes the connections which the application has opened in its event loop."""

    def __init__(self, config: uvicorn.Config, asks: Sequence[object]) -> None:
        super().__init__(config)
        self._asks = asks

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await super().shutdown(sockets)
        for each in self._asks:
            if (close := getattr(each, "close_in_loop", None)) is not None:
                await close()


class _Connection(H11Protocol):
    """A connection that is closed if the head of a request does not come in time."""

    _is_late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._stop()

    def _watch(self) -> None:
        """Wait for the rest of a head, from its first byte on; an idle connection is closed by the base class."""
        is_answering = self.cycle is not None and not self.cycle.response_complete
        if is_answering or self.transport.get_protocol() is not self:  # which is then a web socket's
            self._stop()
        elif self._is_late is None:
            self._is_late = self.loop.call_later(bodies.PATIENCE, self.transport.close)

    def _stop(self) -> None:
        if self._is_late is not None:
            self._is_late.cancel()
            self._is_late = None
