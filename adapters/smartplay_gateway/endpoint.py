"""The endpoint as an ASGI application and as a server: routes, responses, and refusals as OpenAI words them.

`LocalEndpoint` runs it, in a thread beside a test or a script, or in the foreground for the command line. The responses
(JSON, streams of events, refusals) are those of the window endpoint as well.

With `context_tokens` the endpoint refuses long prompts like a paid service. It is for testing agents: whether an agent
shortens its prompt, and reports why it stopped.
"""

from __future__ import annotations

import asyncio
import json
import uuid
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from smartplay_tools.errors import extra_named

with extra_named("An endpoint", "serve"):
    import uvicorn as _uvicorn  # noqa: F401
    from starlette.applications import Starlette
    from starlette.concurrency import run_in_threadpool
    from starlette.exceptions import HTTPException
    from starlette.requests import Request
    from starlette.responses import Response, StreamingResponse
    from starlette.routing import Route
    from starlette.types import ASGIApp, Receive, Scope, Send

from smartplay_gateway.answers import GONE, while_connected
from smartplay_gateway.compaction import is_managed, managed
from smartplay_gateway.surfaces import CHAT as CHAT_SURFACE, COMPACT, MESSAGES, RESPONSES as RESPONSES_SURFACE, Surface
from smartplay_tools import (
    AsyncPlayer,
    ContextManager,
    Message,
    Player,
    Prompt,
    PromptOverflowError,
    Reply,
    SmartPlayError,
    Usage,
)
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.errors import PromptRefusedError
from smartplay_tools.players import ModelCallError, server_error
from smartplay_tools.players.wire import CHAT, RESPONSES, Event, Interface, RequestError, Streaming, ToolChoice, bad
from smartplay_tools.types.arguments import object_in
from smartplay_tools.types.messages import MessageToolCall, assistant_message, calls_of
from smartplay_tools.web import LARGEST_REQUEST, Server, carries, check_address, guarded

T = TypeVar("T")


async def read_request(request: Request, read: Callable[[dict[str, Any]], T], *, at_once: int = 0) -> T:
    """Return what a function makes of the object that a request holds; `RequestError` for anything else.

    It works in a thread, because a long conversation takes long to read, and others play meanwhile. A body of at most
    `at_once` bytes is read here, where the switch to a thread would take longer.
    """
    sent = await request.body()

    def read_body() -> T:
        body = object_in(sent)
        if body is None:
            raise RequestError(400, "The body of a request is a JSON object.")
        return checked(read, body)

    return read_body() if len(sent) <= at_once else await asyncio.to_thread(read_body)


def checked(read: Callable[[dict[str, Any]], T], body: dict[str, Any]) -> T:
    """Return what a function makes of a body; `RequestError` if it refuses it."""
    try:
        return read(body)
    except RecursionError:
        raise RequestError(400, "The body is nested too deeply.") from None
    except SmartPlayError as error:
        raise RequestError(400, str(error)) from error


WRONG_KEY = RequestError(
    401,
    "The API key is wrong or missing.",
    code="invalid_api_key",
    headers={"www-authenticate": "Bearer", "x-should-retry": "false"},
)
"""The refusal of a request without the key."""


def json_response(body: Mapping[str, Any], status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return a body as a response."""
    # ASCII, since a message may hold half a character, which UTF-8 cannot.
    return Response(json.dumps(body), status, headers, media_type="application/json")


HEAD_AFTER = 0.1
"""Seconds for which an answer is awaited before the head of a stream is sent, or the client is watched for leaving.

An error that comes before the head of a stream has a status.
"""

SILENCE = 5.0
"""Seconds after which a stream has a sign of life; load balancers close connections that are silent for 60 s."""


async def respond(
    request: Request,
    form: Streaming,
    answering: Coroutine[Any, Any, dict[str, Any]],
    body: Mapping[str, Any],
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return the response to a request, whole or as a stream, as it asks; without a client, nothing is answered.

    The head of a stream does not wait for the answer.
    """
    answer = asyncio.create_task(answering)
    await asyncio.wait({answer}, timeout=HEAD_AFTER)
    if body.get("stream") and (not answer.done() or answer.exception() is None):
        return _Stream(answer, form, body, headers)
    made = answer.result() if answer.done() else await while_connected(request, answer)
    return Response(status_code=GONE) if made is None else json_response(made, 200, headers)


class _Stream(StreamingResponse):
    """An answer as server-sent events, with signs of life until it is there."""

    def __init__(
        self,
        answer: asyncio.Task[dict[str, Any]],
        form: Streaming,
        body: Mapping[str, Any],
        headers: Mapping[str, str] | None,
    ) -> None:
        self._answer, self._form, self._body = answer, form, body
        super().__init__(self._parts(), media_type="text/event-stream", headers=headers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the stream; the request ends with it, when its client has gone, too."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._answer.cancel()

    async def _parts(self) -> AsyncIterator[str]:
        while not self._answer.done():
            yield self._form.alive
            await asyncio.wait({self._answer}, timeout=SILENCE)
        try:
            answer = self._answer.result()
        except Exception as error:
            told = error if isinstance(error, RequestError) else unexpected(error)
            yield event_text(self._form.failure(told))
            if told is not error:
                raise
            return
        for event in self._form.stream(answer, self._body):
            yield event_text(event)


def event_text(event: Event) -> str:
    """Return an event as a server-sent event."""
    name, data = event
    text = data if isinstance(data, str) else json.dumps(data)
    return f"event: {name}\ndata: {text}\n\n" if name else f"data: {text}\n\n"


async def refuse(request: Request, error: Exception) -> Response:
    """Answer a request that is refused, or at which the server failed, in the form of its interface."""
    if isinstance(error, HTTPException):  # a path or a method that is not served
        problem = f"{error.detail}: {request.method} {request.url.path}"
        error = RequestError(error.status_code, problem, headers=error.headers)
    told = error if isinstance(error, RequestError) else unexpected(error)
    surface = MESSAGES if "/messages" in request.url.path else CHAT_SURFACE
    return json_response(surface.refusal(told), told.status, told.headers)


def unexpected(error: Exception) -> RequestError:
    """Return the refusal of a request at which the server failed."""
    return RequestError(500, f"{type(error).__name__}: {error}")


def model_object(name: str) -> dict[str, Any]:
    """Return a model's entry in the list of models."""
    return {"id": name, "object": "model", "created": 0, "owned_by": "smartplay-tools"}


HANDLERS: dict[Any, Any] = dict.fromkeys((RequestError, HTTPException, Exception), refuse)
"""How an application answers exceptions."""


PlayerLike = Player | AsyncPlayer


def endpoint_app(
    *players: PlayerLike,
    api_key: str | None = None,
    context_tokens: int | None = None,
    hosts: Sequence[str] = (),
    origins: Sequence[str] = (),
) -> ASGIApp:
    """Return an ASGI application that answers for these players; a request's `model` is a player's name.

    The state of a player (such as the draws of the random player) continues over all requests; rules and models have
    no state.

    Arguments:
        players: the players.
        api_key: a key that requests must have.
        context_tokens: a longer prompt, in budget tokens, is refused as `context_length_exceeded`.
        hosts: the names under which it is reached, in addition to this machine's own; with or without a port.
        origins: the web pages that may use it from a browser.
    """
    endpoint = _Endpoint(players, context_tokens)

    async def admit(request: Request) -> Response | None:
        return None if api_key is None or carries(request, api_key) else await refuse(request, WRONG_KEY)

    routes = [
        *(Route(interface.path, endpoint.handler(interface), methods=["POST"]) for interface in (CHAT, RESPONSES)),
        Route(f"{RESPONSES.path}/compact", endpoint.compact, methods=["POST"]),
        Route("/v1/models", endpoint.list_models),
        Route("/v1/models/{name:path}", endpoint.show_model),
    ]
    app = Starlette(routes=routes, exception_handlers=HANDLERS)
    return guarded(app, admit, hosts=hosts, origins=origins, largest=LARGEST_REQUEST)


@dataclass(frozen=True)
class _CompletionRequest:
    """What a request asks; `tokens` are those of the whole prompt, of which the player sees what `choice` allows."""

    player: PlayerLike
    prompt: Prompt
    choice: ToolChoice
    tokens: int


class _Endpoint:
    def __init__(self, players: tuple[PlayerLike, ...], most: int | None) -> None:
        self._players = {player.name: player for player in players}
        self._most = most
        self._counter = TokenCounter()
        self._manager = ContextManager(most)

    def handler(self, interface: Interface) -> Any:
        """Return the function that answers an interface's requests."""

        def read(body: dict[str, Any]) -> tuple[dict[str, Any], _CompletionRequest | None]:
            is_plain = interface is not RESPONSES or not is_managed(body, RESPONSES_SURFACE)
            return body, self._read(interface, body) if is_plain else None

        async def handle(request: Request) -> Response:
            body, asked = await read_request(request, read)
            answering = self._managed(body, RESPONSES_SURFACE) if asked is None else self._answer(interface, asked)
            return await respond(request, interface, answering, body)

        return handle

    async def compact(self, request: Request) -> Response:
        """Answer POST /v1/responses/compact."""
        body = await read_request(request, dict)
        return await respond(request, RESPONSES, self._managed(body, COMPACT), {})

    async def _managed(self, body: dict[str, Any], surface: Surface) -> dict[str, Any]:
        """The answer to a request with `context_management`, or with what a compaction has left."""
        try:
            made = await managed(body, surface, "", self._manager, self._ask_here)
        except SmartPlayError as error:
            raise surface.refused(error) from error
        if made.answer is not None:
            return made.answer
        if is_managed(made.body, RESPONSES_SURFACE) or surface is COMPACT:
            problem = "A provider's own compaction item cannot be read here; send the items that it stands for."
            raise RequestError(400, problem, param="input", code="invalid_encrypted_content")
        answer = await self._answer(RESPONSES, await asyncio.to_thread(checked, self._read_response, made.body))
        return answer if made.report is None else made.report.whole(answer)

    async def _ask_here(self, body: dict[str, Any]) -> dict[str, Any]:
        """The player's answer to a request that the endpoint makes itself."""
        try:
            asked = await asyncio.to_thread(checked, self._read_response, body)
        except RequestError as error:
            if error.code != "context_length_exceeded":
                raise
            raise PromptOverflowError(str(error)) from error
        return await self._answer(RESPONSES, asked)

    def _read_response(self, body: dict[str, Any]) -> _CompletionRequest:
        return self._read(RESPONSES, body)

    async def _answer(self, interface: Interface, asked: _CompletionRequest) -> dict[str, Any]:
        reply = await _ask(asked.player, asked.prompt)
        message = asked.choice.apply(assistant_message(reply.message), asked.prompt.tools)
        counted = Usage(prompt=asked.tokens, reply=self._counter.message(message))
        usage = counted.replaced_by(reply.usage)
        return interface.write(with_fresh_ids(message), asked.player.name, usage)

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
        if self._most is not None and tokens > self._most:
            problem = f"This model's maximum context length is {self._most} tokens, the prompt has {tokens}."
            param = "input" if interface is RESPONSES else "messages"
            raise RequestError(400, problem, param=param, code="context_length_exceeded")
        allowed = choice.restrict(prompt)
        return _CompletionRequest(player, allowed, choice, tokens)

    def _player(self, model: Any) -> PlayerLike:
        if not isinstance(model, str):
            raise bad("A request names its model.", "model")
        if model not in self._players:
            names = ", ".join(self._players)
            raise RequestError(404, f"There is no model {model!r} here; known: {names}.", code="model_not_found")
        return self._players[model]


async def _ask(player: PlayerLike, prompt: Prompt) -> Reply:
    """Ask a player, in a thread that closing does not wait for if it blocks."""
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


PROMPT_CODES = {"context": "context_length_exceeded", "moderation": "content_filter"}
"""OpenAI's codes for prompts that are refused, by what the refusal is about."""


def _failed(error: Exception) -> RequestError:
    if isinstance(error, PromptRefusedError):
        return RequestError(400, str(error), code=PROMPT_CODES.get(server_error(error).about))
    if isinstance(error, SmartPlayError) and not isinstance(error, ModelCallError):
        return RequestError(400, str(error), code="player_refused")
    return RequestError(500, f"The player failed: {type(error).__name__}: {error}", code="player_failed")


class LocalEndpoint(Server):
    """A server for players; in a `with` block it runs in its own thread.

        with LocalEndpoint(sp.get_player("rule")) as endpoint:
            sp.play(episode, sp.get_player("openai:rule", base_url=endpoint.base_url))

    Arguments:
        players: the players; a request's `model` is a player's name.
        host, port: the address; port 0 is a free port. The address is bound at once.
        api_key: a key that requests must have.
        context_tokens: a longer prompt, in budget tokens, is refused as `context_length_exceeded`.
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
        context_tokens: int | None = None,
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
        app: Any = None,
    ) -> None:
        check_address(host, api_key, hosts)
        made = endpoint_app(*players, api_key=api_key, context_tokens=context_tokens, hosts=hosts, origins=origins)
        super().__init__(app or made, host, port, asks=players)
        self.base_url = f"{self.url}/v1"
