"""The endpoint as an ASGI application: routes, errors, and the way from a request to a player and back."""

from __future__ import annotations

import hmac
import json
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from smartplay_openai.server import chat, responses
from smartplay_openai.server.problems import RequestError, bad
from smartplay_tools import AsyncPlayer, Message, Player, Prompt, Reply, TokenCounter, Usage
from smartplay_tools.messages import assistant_message

PlayerLike = Player | AsyncPlayer


class _Interface(Protocol):
    """What the modules `chat` and `responses` are."""

    def read(self, body: Mapping[str, Any], /) -> Prompt: ...
    def write(self, message: Message, model: str, usage: Usage, /) -> dict[str, Any]: ...
    def stream(
        self, answer: dict[str, Any], body: Mapping[str, Any], /
    ) -> Iterator[tuple[str | None, dict[str, Any] | str]]: ...


def endpoint_app(*players: PlayerLike, api_key: str | None = None) -> Starlette:
    """Return an ASGI application that answers for these players; a request's `model` is a player's name.

    With `api_key`, requests must carry that key. Players that remember things (the random player's draws) go on from
    request to request, whoever asks; rules and models do not.
    """
    endpoint = _Endpoint(players, api_key)
    routes = [
        Route(chat.PATH, endpoint.handler(chat), methods=["POST"]),
        Route(responses.PATH, endpoint.handler(responses), methods=["POST"]),
        Route("/v1/models", endpoint.list_models),
        Route("/v1/models/{name:path}", endpoint.show_model),
    ]
    handlers: Any = {RequestError: _refuse, HTTPException: _refuse_http, Exception: _fail}
    return Starlette(routes=routes, exception_handlers=handlers)


class _Endpoint:
    def __init__(self, players: tuple[PlayerLike, ...], api_key: str | None) -> None:
        self._players = {player.name: player for player in players}
        self._api_key = api_key
        self._counter = TokenCounter()

    def handler(self, interface: _Interface) -> Any:
        """Return the function that answers an interface's requests."""

        async def handle(request: Request) -> Response:
            self._check_key(request)
            body = await _json(request)
            player = self._player(body.get("model"))
            prompt = interface.read(body)
            reply = await _ask(player, prompt)
            message = assistant_message(reply.message)
            answer = interface.write(message, player.name, self._usage(prompt, message, reply.usage))
            if body.get("stream"):
                return StreamingResponse(_sse(interface.stream(answer, body)), media_type="text/event-stream")
            return _response(answer)

        return handle

    async def list_models(self, request: Request) -> Response:
        """Answer GET /v1/models."""
        self._check_key(request)
        return _response({"object": "list", "data": [_model(name) for name in self._players]})

    async def show_model(self, request: Request) -> Response:
        """Answer GET /v1/models/NAME."""
        self._check_key(request)
        return _response(_model(self._player(request.path_params["name"]).name))

    def _player(self, model: Any) -> PlayerLike:
        if not isinstance(model, str):
            raise bad("A request names its model.", "model")
        if model not in self._players:
            known = ", ".join(self._players)
            raise RequestError(404, f"There is no model {model!r} here; known: {known}.", code="model_not_found")
        return self._players[model]

    def _check_key(self, request: Request) -> None:
        sent = request.headers.get("authorization", "").removeprefix("Bearer ")
        if self._api_key is not None and not hmac.compare_digest(sent.encode("latin-1"), self._api_key.encode()):
            raise RequestError(401, "The API key is wrong or missing.", code="invalid_api_key")

    def _usage(self, prompt: Prompt, message: Message, reported: Usage | None) -> Usage:
        """What a player says it used, or the count of budget tokens."""
        if reported is not None:
            return reported
        return Usage(prompt=self._counter.prompt(prompt.messages, prompt.tools), reply=self._counter.message(message))


async def _ask(player: PlayerLike, prompt: Prompt) -> Reply:
    if isinstance(player, AsyncPlayer):
        try:
            return await player.areply(prompt)
        except Exception as error:
            raise _failed(error) from error

    def reply() -> Reply:
        try:
            return player.reply(prompt)
        except Exception as error:  # StopIteration, too, which no coroutine may raise
            raise _failed(error) from error

    return await run_in_threadpool(reply)


def _failed(error: Exception) -> RequestError:
    return RequestError(500, f"The player failed: {type(error).__name__}: {error}", code="player_failed")


async def _json(request: Request) -> dict[str, Any]:
    try:
        body = json.loads(await request.body())
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        raise RequestError(400, "The body of a request is a JSON object.")
    return body


def _response(body: Mapping[str, Any], status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    # ASCII, since a message may hold half a character, which UTF-8 cannot.
    return Response(json.dumps(body), status, headers, media_type="application/json")


def _sse(events: Iterator[tuple[str | None, dict[str, Any] | str]]) -> Iterator[str]:
    for name, data in events:
        text = data if isinstance(data, str) else json.dumps(data)
        yield f"event: {name}\ndata: {text}\n\n" if name else f"data: {text}\n\n"


def _model(name: str) -> dict[str, Any]:
    return {"id": name, "object": "model", "created": 0, "owned_by": "smartplay-tools"}


async def _refuse(request: Request, error: RequestError) -> Response:
    # A player that has failed will fail again: clients need not ask twice.
    return _response(error.body(), error.status, {"x-should-retry": "false"})


async def _fail(request: Request, error: Exception) -> Response:
    return _response(RequestError(500, f"{type(error).__name__}: {error}").body(), 500)


async def _refuse_http(request: Request, error: HTTPException) -> Response:
    refused = RequestError(error.status_code, f"{error.detail}: {request.method} {request.url.path}")
    return _response(refused.body(), error.status_code, error.headers)
