"""The endpoint of the operator, `/episodes`: open an episode, read its result, close it."""

from __future__ import annotations

import asyncio
import json

from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from smartplay_tools import Budget, InvalidArgumentError, SmartPlayError
from smartplay_tools.web import EpisodeStore, FullError, hosted_or_refusal


def operator_routes(store: EpisodeStore) -> list[Route]:
    """Return the routes of the episodes in a store."""

    async def open_episode(request: Request) -> Response:
        try:
            handle = await asyncio.to_thread(_opened, store, await request.body())
        except FullError as error:
            return PlainTextResponse(str(error), 503)
        except SmartPlayError as error:
            return PlainTextResponse(str(error), 400)
        return JSONResponse({"episode": handle, "path": f"/mcp/{handle}"}, 201)

    async def show_episode(request: Request) -> Response:
        hosted = await hosted_or_refusal(store.find, request.path_params["handle"])
        if isinstance(hosted, Response):
            return hosted
        result = hosted.episode.result
        return JSONResponse({"done": hosted.episode.done, "result": result and result.model_dump()})

    async def close_episode(request: Request) -> Response:
        result = await hosted_or_refusal(store.close, request.path_params["handle"])
        return result if isinstance(result, Response) else JSONResponse({"done": True, "result": result.model_dump()})

    return [
        Route("/episodes", open_episode, methods=["POST"]),
        Route("/episodes/{handle}", show_episode, methods=["GET"]),
        Route("/episodes/{handle}", close_episode, methods=["DELETE"]),
    ]


def _opened(store: EpisodeStore, body: bytes) -> str:
    """Open the episode of an operator's request."""
    try:
        wanted = json.loads(body)
        game, seed, budget = str(wanted.pop("game")), wanted.pop("seed"), wanted.pop("budget", {})
        if reserved := wanted.keys() & {"transcript", "context", "self"}:
            raise InvalidArgumentError(f"These fields cannot be set: {', '.join(sorted(reserved))}.")
        return store.open(game, seed=seed, budget=Budget(**budget), **wanted)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InvalidArgumentError(f"The budget cannot be read: {where}: {first['msg']}.") from error
    except SmartPlayError:
        raise
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise InvalidArgumentError("Send a JSON object with game and seed.") from error
