"""The routes of the site by which a person plays; the only ones that change anything.

/play                             the page
/api/play?after=N                 what is to be shown, as soon as it is something else than number N
/api/play/reply                   POST: the answer to a prompt
/api/play/picture                 POST: a picture of the game, which the record notes
/api/play/next                    POST: another episode
/api/play/beside                  what others score: the paper's models, and players of ours in the same world
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any, Protocol
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.evaluation.pages.view.answers import HEADERS, page
from smartplay_tools.games.paper import PAPER_RESULTS
from smartplay_tools.players.human.browser import BrowserPlayer, PassedError
from smartplay_tools.records.run_folder import RunFolder

LONGEST_WAIT = 15.0
"""Seconds after which a page that waits is answered in any case."""

LOOK_SECONDS = 0.05


class PlayedRun(Protocol):
    """What a person plays in the browser: `evaluation.runs.browser_play.BrowserPlay`."""

    game: str
    player: BrowserPlayer
    folder: RunFolder

    @property
    def number(self) -> int:
        """Version of the displayed state; clients poll for a new value."""
        ...

    def state(self) -> dict[str, Any]:
        """Return what the page shows, as JSON."""
        ...

    def next(self) -> None:
        """Begin another episode, once one is over."""
        ...

    def beside(self) -> dict[str, float | None]:
        """Return what other players score in the same world."""
        ...

    def challenge(self) -> str:
        """Return the command that plays the same worlds."""
        ...


def play_routes(play: PlayedRun, key: str, is_stopping: Callable[[], bool]) -> list[Route]:
    """Return the routes; the page carries the `key` that its requests have to show."""
    site = _Playing(play, is_stopping)
    return [
        Route("/play", page("play.html.j2", game=play.game, key=key)),
        Route("/api/play", site.state),
        Route("/api/play/reply", site.reply, methods=["POST"]),
        Route("/api/play/picture", site.picture, methods=["POST"]),
        Route("/api/play/next", site.next, methods=["POST"]),
        Route("/api/play/beside", site.beside),
    ]


class _Playing:
    def __init__(self, play: PlayedRun, is_stopping: Callable[[], bool]) -> None:
        self._play, self._is_stopping = play, is_stopping

    async def state(self, request: Request) -> Response:
        """Answer with what is to be shown, when it has changed."""
        shown, waited = request.query_params.get("after", ""), 0.0
        while shown == str(self._play.number) and waited < LONGEST_WAIT and not self._is_stopping():
            await asyncio.sleep(LOOK_SECONDS)
            waited += LOOK_SECONDS
        state = await run_in_threadpool(self._play.state)
        return JSONResponse({**state, "over": self._over(state["over"])}, headers=HEADERS)

    async def beside(self, request: Request) -> Response:
        """Answer with the scores of others: the paper's people and models, and ours in the same world."""
        ours = await run_in_threadpool(self._play.beside)
        paper = {result.player: result.normalized.get(self._play.game) for result in PAPER_RESULTS}
        scores = {name: score for name, score in {**paper, **ours}.items() if score is not None}
        return JSONResponse({"scores": scores, "challenge": self._play.challenge()}, headers=HEADERS)

    async def reply(self, request: Request) -> Response:
        """Take the answer to a prompt."""
        return await self._take(request, lambda given: self._play.player.answer(given))

    async def picture(self, request: Request) -> Response:
        """Answer with a picture of the game."""
        return await self._take(request, lambda given: {"image": self._play.player.picture(given)})

    async def next(self, request: Request) -> Response:
        """Begin another episode."""
        return await self._take(request, lambda given: self._play.next())

    async def _take(self, request: Request, do: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Response:
        try:
            given = await json_body(request)
            return JSONResponse(await run_in_threadpool(do, given) or {}, headers=HEADERS)
        except PassedError as error:
            return PlainTextResponse(str(error), 409, HEADERS)
        except SmartPlayError as error:
            return PlainTextResponse(str(error), 400, HEADERS)

    def _over(self, row: dict[str, Any] | None) -> dict[str, Any] | None:
        if row is None:
            return None
        facts = {name: row[name] for name in ("score", "normalized_score", "steps", "end_reason")}
        return {
            **facts,
            "pictures": "pictures" in row["deviations"],
            "replay": f"/episode/{quote(self._play.folder.path.resolve().name)}/episodes/{row['key']}",
        }


async def json_body(request: Request) -> dict[str, Any]:
    """Return the JSON object of a request, which is small."""
    try:
        given = json.loads(await request.body())
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise InvalidArgumentError("An answer is a JSON object.")
    return given
