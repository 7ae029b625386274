"""The site as an ASGI application: pages, JSON, and a stream of what is being played.

    /                                 the list of runs and of the episodes of one
    /api/runs                         every run: counts, spending, the time that is left
    /api/runs/N/episodes              every episode of a run, an array each
    /api/live                         server-sent events: the same counts, and what is being played, when they change
    /episode/N/KIND/STEM              the replay page of one record, as far as it goes
    /watch/N/KIND/STEM                that page in a frame, made anew as the record grows
    /compare                          two such pages side by side
    /report?run=N                     the report page of a run, of several their comparison
    /static/NAME                      scripts and styles, some of them the replay page's own

A request is refused unless its Host and Origin are expected and, where there is a token, it carries it: as a bearer
token, or in a cookie that the first visit sets. Nothing can be changed through the site, unless a person plays in it
(`playing`): such a request has to come from the page of the play and to show the page's key.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from smartplay_tools.errors import SmartPlayError
from smartplay_tools.evaluation.pages.report import render_report
from smartplay_tools.evaluation.pages.view.answers import HEADERS, missing, page, static
from smartplay_tools.evaluation.pages.view.playing import PlayedRun, play_routes
from smartplay_tools.evaluation.pages.view.runs import COLUMNS, ViewedRun
from smartplay_tools.web import Guard, Names, carries, is_from_own_page

PERIOD = 1.0
"""Seconds between two looks at the folders."""

STEPS = 5
"""How often in a period a stream looks whether the server stops."""

EPISODES = 50
"""The episodes of a run that a report page holds; the site opens the others."""

COOKIE = "smartplay_view"

KEY = "x-smartplay-key"
"""The header with the key of a page that plays, which other sites cannot read."""


def view_app(
    runs: Sequence[ViewedRun],
    *,
    token: str | None = None,
    hosts: Sequence[str] = (),
    play: PlayedRun | None = None,
    plugins: bool = False,
    is_stopping: Callable[[], bool] = lambda: False,
) -> ASGIApp:
    """Return the site as an ASGI application.

    Arguments:
        runs: the runs that it shows.
        token: what a request has to carry; with None, everybody who reaches the server may read.
        hosts: the names under which the server is reached, beside this machine's own.
        play: what a person plays in the browser; its run is the first of `runs`.
        plugins: whether games of installed packages that records name are imported, to draw them.
        is_stopping: asked by streams, which would not end by themselves.
    """
    site = _Site(runs, is_stopping, plugins=plugins)
    routes = [
        Route("/", page("index.html.j2", game=None if play is None else play.game)),
        Route("/compare", page("compare.html.j2")),
        Route("/watch/{run:int}/{kind}/{stem}", page("watch.html.j2")),
        Route("/episode/{run:int}/{kind}/{stem}", site.episode),
        Route("/api/runs", site.runs),
        Route("/api/runs/{run:int}/episodes", site.episodes),
        Route("/api/live", site.live),
        Route("/report", site.report),
        Route("/static/{name}", static),
    ]
    key = None
    if play is not None:
        key = secrets.token_urlsafe(24)
        routes += play_routes(play, key, is_stopping)
    # A stream that is compressed waits for its compressor, so the middleware leaves event streams as they are.
    app = GZipMiddleware(Starlette(routes=routes), minimum_size=10_000)
    return Guard(app, _Conditions(token, key).admit, Names(hosts), headers=HEADERS)


class _Conditions:
    """What a request is asked before it comes in, beside its Host and its Origin."""

    def __init__(self, token: str | None, key: str | None) -> None:
        self._token, self._key = token, key

    async def admit(self, request: Request) -> Response | None:
        return self._entry(request) or self._change(request)

    def _change(self, request: Request) -> Response | None:
        """What changes something comes from the page that plays; a browser sends much for other sites, too."""
        if request.method in ("GET", "HEAD") or self._key is None:
            return None
        origin, site, host = (request.headers.get(name) for name in ("origin", "sec-fetch-site", "host"))
        if is_from_own_page(origin, site, host) and _same(request.headers.get(KEY, ""), self._key):
            return None
        return PlainTextResponse("Only the page of the play may do this; load it again.", 403, HEADERS)

    def _entry(self, request: Request) -> Response | None:
        if self._token is None or carries(request, self._token):
            return None
        if _same(request.cookies.get(COOKIE, ""), self._token):
            return None
        if _same(request.query_params.get("token", ""), self._token):
            entered = RedirectResponse("/", 303, HEADERS)
            entered.set_cookie(COOKIE, self._token, httponly=True, samesite="strict")
            return entered
        return PlainTextResponse("Open the address that smartplay-tools view has printed.", 401, HEADERS)


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


class _Site:
    """The answers that need the runs."""

    def __init__(self, runs: Sequence[ViewedRun], is_stopping: Callable[[], bool], *, plugins: bool) -> None:
        self._runs, self._is_stopping, self._plugins = runs, is_stopping, plugins

    async def runs(self, request: Request) -> Response:
        """Answer with every run."""
        return JSONResponse(await run_in_threadpool(self._summaries), headers=HEADERS)

    def _summaries(self) -> list[dict[str, Any]]:
        return [run.summary() for run in self._runs]

    async def episodes(self, request: Request) -> Response:
        """Answer with every episode of a run."""
        run = self._of(request)
        if run is None:
            return missing("There is no such run.")
        try:
            rows = await run_in_threadpool(run.episodes)
        except SmartPlayError as error:
            return missing(str(error))
        return JSONResponse({"columns": COLUMNS, "episodes": rows}, headers=HEADERS)

    async def episode(self, request: Request) -> Response:
        """Answer with the replay page of a record."""
        run = self._of(request)
        if run is None:
            return missing("There is no such run.")
        try:
            record = run.record("{kind}/{stem}".format(**request.path_params))
        except SmartPlayError as error:
            return missing(str(error))
        return await self._replay_page(record, open_first=True)

    async def report(self, request: Request) -> Response:
        """Answer with the report page of a run, or of several; it holds some episodes of each, since all open here."""
        asked = request.query_params.getlist("run")
        runs = [
            self._runs[int(number)]
            for number in asked
            if number.isascii() and number.isdigit() and int(number) < len(self._runs)
        ]
        if not runs or len(runs) < len(asked):
            return missing("There is no such run.")
        return await self._replay_page([run.path for run in runs], episodes=str(EPISODES * len(runs)))

    async def _replay_page(self, what: Path | Sequence[Path], **options: Any) -> Response:
        try:
            page = await run_in_threadpool(render_report, what, plugins=self._plugins, **options)
        except SmartPlayError as error:
            return missing(str(error))
        # The page's own policy, by the hashes of its scripts, is in its head.
        headers = {**HEADERS, "Content-Security-Policy": "frame-ancestors 'self'"}
        body = page.encode("utf-8", errors="replace")
        return Response(body, media_type="text/html", headers=headers)

    async def live(self, request: Request) -> Response:
        """Answer with a stream of events, one whenever something has changed."""
        headers = {**HEADERS, "X-Accel-Buffering": "no"}
        return StreamingResponse(self._events(request), media_type="text/event-stream", headers=headers)

    async def _events(self, request: Request) -> AsyncIterator[str]:
        last = None
        while not await request.is_disconnected():
            now = json.dumps(await run_in_threadpool(self._state))
            # A comment now and then lets the server notice that nobody listens any more.
            yield f"data: {now}\n\n" if now != last else ": nothing new\n\n"
            last = now
            for _ in range(STEPS):
                if self._is_stopping():
                    return
                await asyncio.sleep(PERIOD / STEPS)

    def _state(self) -> list[dict[str, Any]]:
        return list(map(_now, self._runs))

    def _of(self, request: Request) -> ViewedRun | None:
        number = request.path_params["run"]
        return self._runs[number] if number < len(self._runs) else None


def _now(run: ViewedRun) -> dict[str, Any]:
    """Return how far a run is and what is being played; what is damaged does not keep the others from being shown."""
    try:
        return {**run.summary(), "playing": run.playing()}
    except SmartPlayError as error:
        return {"name": run.name, "error": str(error), "playing": []}
