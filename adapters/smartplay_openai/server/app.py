"""The endpoint as an ASGI application: routes, errors, and the conversion between requests and players."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from smartplay_openai.chat import CHAT
from smartplay_openai.interface import Interface
from smartplay_openai.problems import RequestError, bad
from smartplay_openai.responses import RESPONSES
from smartplay_openai.server.answers import (
    HANDLERS,
    WRONG_KEY,
    event_stream,
    json_response,
    model_object,
    read_request,
    refuse,
)
from smartplay_openai.server.limits import SimulatedLimits
from smartplay_openai.tool_choice import ToolChoice
from smartplay_tools import AsyncPlayer, Message, Player, Prompt, Reply, SmartPlayError, Usage
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.players import ModelCallError
from smartplay_tools.types.messages import MessageToolCall, assistant_message, calls_of
from smartplay_tools.web import LARGEST_REQUEST, carries, guarded

PlayerLike = Player | AsyncPlayer


def endpoint_app(
    *players: PlayerLike,
    api_key: str | None = None,
    limits: SimulatedLimits | None = None,
    hosts: Sequence[str] = (),
    origins: Sequence[str] = (),
) -> ASGIApp:
    """Return an ASGI application that answers for these players; a request's `model` is a player's name.

    The state of a player (such as the draws of the random player) continues over all requests; rules and models have
    no state.

    Arguments:
        players: the players.
        api_key: a key that requests must have.
        limits: simulated limits of a paid service; requests that exceed them are refused.
        hosts: the names under which it is reached, in addition to this machine's own; with or without a port.
        origins: the web pages that may use it from a browser.
    """
    endpoint = _Endpoint(players, limits or SimulatedLimits())

    async def admit(request: Request) -> Response | None:
        return None if api_key is None or carries(request, api_key) else await refuse(request, WRONG_KEY)

    routes = [
        *(Route(interface.path, endpoint.handler(interface), methods=["POST"]) for interface in (CHAT, RESPONSES)),
        Route("/v1/models", endpoint.list_models),
        Route("/v1/models/{name:path}", endpoint.show_model),
    ]
    handlers: Any = HANDLERS
    app = Starlette(routes=routes, exception_handlers=handlers)
    return guarded(app, admit, hosts=hosts, origins=origins, largest=LARGEST_REQUEST)


@dataclass(frozen=True)
class _CompletionRequest:
    """What a request asks; `tokens` are those of the whole prompt, of which the player sees what `choice` allows."""

    player: PlayerLike
    prompt: Prompt
    choice: ToolChoice
    tokens: int
    body: Mapping[str, Any]


class _Endpoint:
    def __init__(self, players: tuple[PlayerLike, ...], limits: SimulatedLimits) -> None:
        self._players = {player.name: player for player in players}
        self._limits = limits
        self._counter = TokenCounter()

    def handler(self, interface: Interface) -> Any:
        """Return the function that answers an interface's requests."""

        async def handle(request: Request) -> Response:
            self._limits.check_rate()
            asked = await read_request(request, partial(self._read, interface))
            reply = await _ask(asked.player, asked.prompt)
            message = asked.choice.apply(assistant_message(reply.message), asked.prompt.tools)
            counted = Usage(prompt=asked.tokens, reply=self._counter.message(message))
            usage = counted.replaced_by(reply.usage)
            answer = interface.write(with_fresh_ids(message), asked.player.name, usage)
            if asked.body.get("stream"):
                events = event_stream(interface.stream(answer, asked.body))
                return StreamingResponse(events, media_type="text/event-stream")
            return json_response(answer)

        return handle

    async def list_models(self, request: Request) -> Response:
        """Answer GET /v1/models."""
        return json_response({"object": "list", "data": [model_object(name) for name in self._players]})

    async def show_model(self, request: Request) -> Response:
        """Answer GET /v1/models/NAME."""
        return json_response(model_object(self._player(request.path_params["name"]).name))

    def _read(self, interface: Interface, body: dict[str, Any]) -> _CompletionRequest:
        player = self._player(body.get("model"))
        prompt, choice = interface.read(body), interface.read_tool_choice(body)
        tokens = self._counter.prompt(prompt.messages, prompt.tools)
        self._limits.check_length(tokens, "input" if interface is RESPONSES else "messages")
        allowed = choice.restrict(prompt)
        return _CompletionRequest(player, allowed, choice, tokens, body)

    def _player(self, model: Any) -> PlayerLike:
        if not isinstance(model, str):
            raise bad("A request names its model.", "model")
        if model not in self._players:
            names = ", ".join(self._players)
            raise RequestError(404, f"There is no model {model!r} here; known: {names}.", code="model_not_found")
        return self._players[model]


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


def with_fresh_ids(message: Message) -> Message:
    """Return a message whose calls have ids that nobody has used: players repeat theirs."""
    calls = [cast(MessageToolCall, {**call, "id": f"call_{uuid.uuid4().hex[:24]}"}) for call in calls_of(message)]
    return {**message, "tool_calls": calls} if calls else message


def _failed(error: Exception) -> RequestError:
    if isinstance(error, SmartPlayError) and not isinstance(error, ModelCallError):
        return RequestError(400, str(error), code="player_refused")
    return RequestError(500, f"The player failed: {type(error).__name__}: {error}", code="player_failed")
