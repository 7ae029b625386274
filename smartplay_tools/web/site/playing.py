"""The routes of the site by which a person plays; the only ones that change anything.

/play                             the games to choose from; the page of the game, if there is one only
/play/GAME                        the page of a game
/api/play/GAME?after=N            the state to show, as soon as it is not number N
/api/play/GAME/reply              POST: the answer to a prompt
/api/play/GAME/picture            POST: a picture of the game, which the record notes
/api/play/GAME/next               POST: another episode
/api/play/GAME/beside             the scores of others: the paper's models, and our players in the same world
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Any
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
from smartplay_tools.games.minecraft.rules import PAPER_GOALS
from smartplay_tools.games.paper_tables import PAPER_RESULTS
from smartplay_tools.games.specs import GAMES, get_spec
from smartplay_tools.types.arguments import object_in
from smartplay_tools.web.site.browser_play import BrowserGames, BrowserPlay
from smartplay_tools.web.site.browser_player import PassedError
from smartplay_tools.web.site.http_answers import HEADERS, AsciiJson, missing, page

LONGEST_WAIT = 15.0
"""Seconds after which a page that waits is answered in any case."""

LOOK_SECONDS = 0.05

FAMILIES: Mapping[str, tuple[str, str]] = {
    "bandit": ("Two-armed bandit", "Find the machine that pays."),
    "rock_paper_scissors": ("Rock Paper Scissors", "Exploit an opponent who has a habit."),
    "hanoi": ("Tower of Hanoi", "Move the whole tower to rod C."),
    "messenger": ("MESSENGER", "Read the manual, meet the right one, flee the others."),
    "crafter": ("Crafter", "Survive, and unlock 22 achievements."),
    "minecraft": ("Minecraft", "Find a biome in a 3D world."),
}
"""The name of each family of games, and its task in a sentence."""


def play_routes(play: BrowserGames, key: str, is_stopping: Callable[[], bool]) -> list[Route]:
    """Return the routes; the page carries the `key` that its requests have to show."""
    site = _Playing(play, key, is_stopping)
    api = "/api/play/{game}"
    return [
        Route("/play", site.games),
        Route("/play/{game}", site.of_run(site.page)),
        Route(api, site.of_run(site.state)),
        Route(f"{api}/reply", site.of_run(site.reply), methods=["POST"]),
        Route(f"{api}/picture", site.of_run(site.picture), methods=["POST"]),
        Route(f"{api}/next", site.of_run(site.next), methods=["POST"]),
        Route(f"{api}/beside", site.of_run(site.beside)),
    ]


class _Playing:
    def __init__(self, play: BrowserGames, key: str, is_stopping: Callable[[], bool]) -> None:
        self._play, self._key, self._is_stopping = play, key, is_stopping

    async def games(self, request: Request) -> Response:
        """Answer with the games to choose from; the page of the game, if there is one only."""
        if len(self._play.games) == 1:
            return RedirectResponse(f"/play/{quote(self._play.games[0])}", 303, HEADERS)
        families: dict[str, list[str]] = {family: [] for family in FAMILIES}
        for game in self._play.games:
            families.setdefault(GAMES[game].family, []).append(game)
        shown = [(family, *FAMILIES.get(family, (family, "")), games) for family, games in families.items() if games]
        return page("games.html.j2", families=shown)

    def of_run(
        self, answer: Callable[[Request, BrowserPlay], Awaitable[Response]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """Return a route that answers about the run of the game in its address."""

        async def route(request: Request) -> Response:
            try:
                run = await run_in_threadpool(self._play.run_of, request.path_params["game"])
            except SmartPlayError as error:
                return missing(str(error))
            return await answer(request, run)

        return route

    async def page(self, request: Request, run: BrowserPlay) -> Response:
        """Answer with the page of a game."""
        several = len(self._play.games) > 1
        name = request.path_params["game"]
        spec = get_spec(run.game)
        _, aim = FAMILIES.get(spec.family, ("", ""))
        if spec.family == "minecraft":
            aim = f"Find this biome: {PAPER_GOALS[spec.kwargs['task']].name}."
        return page("play.html.j2", game=run.game, aim=aim, name=name, key=self._key, several=several)

    async def state(self, request: Request, run: BrowserPlay) -> Response:
        """Answer with what is to be shown, when it has changed."""
        shown, waited = request.query_params.get("after", ""), 0.0
        while shown == str(run.player.number) and waited < LONGEST_WAIT and not self._is_stopping():
            await asyncio.sleep(LOOK_SECONDS)
            waited += LOOK_SECONDS
        state = await run_in_threadpool(run.state)
        return AsciiJson({**state, "over": _over(state["over"], run)}, headers=HEADERS)

    async def beside(self, request: Request, run: BrowserPlay) -> Response:
        """Answer with the scores of others: the paper's people and models, and ours in the same world."""
        ours = await run_in_threadpool(run.beside)
        paper = {result.player: result.normalized.get(run.game) for result in PAPER_RESULTS}
        scores = {name: score for name, score in {**paper, **ours}.items() if score is not None}
        return AsciiJson({"scores": scores, **await run_in_threadpool(run.gone)}, headers=HEADERS)

    async def reply(self, request: Request, run: BrowserPlay) -> Response:
        """Take the answer to a prompt."""
        return await _take(request, run.player.answer)

    async def picture(self, request: Request, run: BrowserPlay) -> Response:
        """Answer with a picture of the game."""
        return await _take(request, lambda given: {"image": run.player.picture(given)})

    async def next(self, request: Request, run: BrowserPlay) -> Response:
        """Begin another episode."""
        return await _take(request, lambda given: run.next())


async def _take(request: Request, do: Callable[[dict[str, Any]], dict[str, Any] | None]) -> Response:
    given = object_in(await request.body())
    if given is None:
        raise InvalidArgumentError("An answer is a JSON object.")
    return AsciiJson(await run_in_threadpool(do, given) or {}, headers=HEADERS)


async def refused(request: Request, error: Exception) -> Response:
    """Answer with what is wrong with a request; what a page asks for is then missing."""
    if request.method != "POST":
        return missing(str(error))
    return PlainTextResponse(str(error), 409 if isinstance(error, PassedError) else 400, HEADERS)


def _over(row: dict[str, Any] | None, run: BrowserPlay) -> dict[str, Any] | None:
    if row is None:
        return None
    facts = {name: row[name] for name in ("score", "normalized_score", "steps", "end_reason")}
    return {
        **facts,
        "pictures": "pictures" in row["deviations"],
        "replay": f"/episode/{quote(run.folder.path.resolve().name)}/episodes/{row['key']}",
    }
