"""The site as an ASGI application: pages, JSON, and a stream of what is being played.

    /                                 the list of runs and of the episodes of one
    /api/runs                         every run: counts, spending, the time that is left
    /api/runs/RUN/episodes            every episode of a run, an array each
    /api/live                         server-sent events: the same counts, and what is being played, when they change
    /episode/RUN/KIND/STEM            the replay page of one record, finished or still being written
    /api/episode/RUN/KIND/STEM        the same episode for the open page, as soon as its record has grown
    /static/NAME                      scripts and styles, some of them the replay page's own

RUN is the name of a run: the path of its folder below the one that the site was started with. A request is refused
unless its Host and Origin are expected and, where there is a token, it carries it: as a bearer token, or in a cookie
that the first visit sets. Nothing can be changed through the site, unless a person plays in it (`playing`): such a
request has to come from a page of the site and to show the page's key.

`ViewServer` serves it on this machine's address by default; any other needs a token and the names it is reached by.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import time
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.players.environment import is_loopback
from smartplay_tools.web import Server, carries
from smartplay_tools.web.guard import Guard, is_from_own_page
from smartplay_tools.web.site.browser_play import BrowserGames
from smartplay_tools.web.site.http_answers import HEADERS, AsciiJson, missing, page, static
from smartplay_tools.web.site.listed import COLUMNS
from smartplay_tools.web.site.playing import LONGEST_WAIT, LOOK_SECONDS, play_routes, refused
from smartplay_tools.web.site.served_pages import ServedPages
from smartplay_tools.web.site.site_runs import RunList, ViewedRun

PERIOD = 1.0
"""Seconds between two looks at the folders."""

STEPS = 5
"""How often in a period a stream checks whether the server is stopping."""

COOKIE = "smartplay_view"

KEY = "x-smartplay-key"
"""The header with the key of a page that plays, which other sites cannot read."""


def _routes(site: _Site, play: BrowserGames | None, key: str | None, is_stopping: Callable[[], bool]) -> list[Route]:
    """Return the routes; those that change something ask for the `key` of a page."""

    async def index(request: Request) -> Response:
        return page("index.html.j2", games=None if play is None else play.games)

    routes = [
        Route("/", index),
        Route("/episode/{run:path}/{kind}/{stem}", site.episode),
        Route("/api/runs", site.runs),
        Route("/api/runs/{run:path}/episodes", site.episodes),
        Route("/api/episode/{run:path}/{kind}/{stem}", site.news),
        Route("/api/live", site.live),
        Route("/static/{name}", static),
    ]
    if play is not None and key is not None:
        return [*routes, *play_routes(play, key, is_stopping)]
    return [*routes, *(Route(path, _no_games) for path in ("/play", "/play/{game}"))]


def _entry(request: Request, token: str | None) -> Response | None:
    """Refuse a request without the token; the first visit, which has it in its address, gets a cookie."""
    if token is None or carries(request, token) or _same(request.cookies.get(COOKIE, ""), token):
        return None
    if _same(request.query_params.get("token", ""), token):
        entered = RedirectResponse("/", 303, HEADERS)
        entered.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return entered
    return PlainTextResponse("Open the address that smartplay-tools view has printed.", 401, HEADERS)


def _change(request: Request, key: str | None) -> Response | None:
    """Refuse a change that does not come from a page of the site: a browser also sends requests of other sites."""
    if request.method in ("GET", "HEAD") or key is None:
        return None
    origin, site, host = (request.headers.get(name) for name in ("origin", "sec-fetch-site", "host"))
    if is_from_own_page(origin, site, host) and _same(request.headers.get(KEY, ""), key):
        return None
    return PlainTextResponse("Only the site's own page may do this; reload it.", 403, HEADERS)


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


async def _no_games(request: Request) -> Response:
    return missing("No game is played in this site. Start one where that is possible: smartplay-tools view --play any")


class _Site:
    """The answers that need the runs."""

    def __init__(self, runs: RunList, is_stopping: Callable[[], bool], *, plugins: bool) -> None:
        self._runs, self._is_stopping = runs, is_stopping
        self._pages = ServedPages(plugins=plugins)

    async def runs(self, request: Request) -> Response:
        """Answer with every run."""
        summaries = await run_in_threadpool(lambda: [run.summary() for run in self._runs.current()])
        return AsciiJson(summaries, headers=HEADERS)

    async def episodes(self, request: Request) -> Response:
        """Answer with every episode of a run."""
        run = await run_in_threadpool(self._named, request.path_params["run"])
        rows = await run_in_threadpool(run.episodes)
        return AsciiJson({"columns": COLUMNS, "episodes": rows}, headers=HEADERS)

    async def episode(self, request: Request) -> Response:
        """Answer with the replay page of a record."""
        made = await run_in_threadpool(lambda: self._pages.episode(*self._record(request)))
        # The page's own policy, by the hashes of its scripts, is in its head.
        headers = {**HEADERS, "Content-Security-Policy": "frame-ancestors 'self'"}
        return Response(made.encode("utf-8", errors="replace"), media_type="text/html", headers=headers)

    async def news(self, request: Request) -> Response:
        """Answer with an episode as its open page needs it, as soon as its record is another than `after`."""
        after, until = request.query_params.get("after", ""), time.monotonic() + LONGEST_WAIT
        while True:
            run_and_record = await run_in_threadpool(self._record, request)
            version, is_playing = await run_in_threadpool(self._pages.version, *run_and_record)
            if version != after or not is_playing or time.monotonic() >= until or self._is_stopping():
                break
            await asyncio.sleep(LOOK_SECONDS)
        news = await run_in_threadpool(self._pages.news, *run_and_record, is_new=version != after)
        return AsciiJson({"version": version, "playing": is_playing, **news}, headers=HEADERS)

    async def live(self, request: Request) -> Response:
        """Answer with a stream of events, one whenever something has changed."""
        headers = {**HEADERS, "X-Accel-Buffering": "no"}
        return StreamingResponse(self._events(request), media_type="text/event-stream", headers=headers)

    async def _events(self, request: Request) -> AsyncIterator[str]:
        last = None
        while not await request.is_disconnected():
            now = json.dumps(await run_in_threadpool(lambda: list(map(_now, self._runs.current()))))
            # A comment now and then lets the server notice that nobody is listening.
            yield f"data: {now}\n\n" if now != last else ": nothing new\n\n"
            last = now
            for _ in range(STEPS):
                if self._is_stopping():
                    return
                await asyncio.sleep(PERIOD / STEPS)

    def _named(self, name: str) -> ViewedRun:
        run = self._runs.named(name)
        if run is None:
            raise InvalidArgumentError(f"There is no run {name!r} here now. The list of runs is at /.")
        return run

    def _record(self, request: Request) -> tuple[ViewedRun, str]:
        return self._named(request.path_params["run"]), "{kind}/{stem}".format(**request.path_params)


def _now(run: ViewedRun) -> dict[str, Any]:
    """Return how far a run is and what is being played; what is damaged does not keep the others from being shown."""
    try:
        return {**run.summary(), "playing": run.playing()}
    except SmartPlayError as error:
        return {"name": run.name, "error": str(error), "playing": []}


class ViewServer(Server):
    """A server of the site; `run` serves until it is stopped, `with` serves in a thread.

    Arguments:
        runs: the runs that it shows, of which new ones are found while it serves.
        host, port: where to listen; port 0 is a free one.
        token: what a request has to carry, drawn here for an address that is not local; with None, everybody who
            reaches the server may read.
        hosts: the names under which the server is reached, in addition to this machine's own.
        play: the games that a person plays in the browser; their runs are among `runs`.
        plugins: whether games of installed packages that records name are imported, to draw them.
    """

    def __init__(
        self,
        runs: RunList,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        hosts: Sequence[str] = (),
        play: BrowserGames | None = None,
        plugins: bool = False,
    ) -> None:
        is_open = not is_loopback(host)
        if is_open and not hosts:
            raise InvalidArgumentError(
                f"Other machines can reach {host}: give the host names under which it is reached (--allow-host)."
            )
        if is_open and token is None:
            token = secrets.token_urlsafe(24)
        key = None if play is None else secrets.token_urlsafe(24)

        def is_stopping() -> bool:  # streams would not end by themselves
            return self.is_stopping

        async def admit(request: Request) -> Response | None:
            return _entry(request, token) or _change(request, key)

        site = _Site(runs, is_stopping, plugins=plugins)
        routes = _routes(site, play, key, is_stopping)
        app = Starlette(routes=routes, exception_handlers={SmartPlayError: refused})
        # A stream that is compressed waits for its compressor, so the middleware leaves event streams as they are.
        compressed = GZipMiddleware(app, minimum_size=10_000)
        super().__init__(Guard(compressed, admit, hosts, headers=HEADERS), host, port)
        self.url = f"{self.address(hosts[0]) if is_open else self.url}/"
        self.entry = self.url if token is None else f"{self.url}?token={token}"
        """The address that a browser opens first; the token is kept in a cookie from then on."""
