"""The context endpoint: a server between a client and its model, which fits every prompt and passes on the rest.

    client -> http://127.0.0.1:8000/v1 -> upstream

A request to chat completions, Responses or Messages is read as far as its prompt. If all of it fits, its bytes go
upstream as they came; otherwise the list of messages is another, and the rest of the body is the same. Every other
request, every header and every answer, streams included, passes as it is. The endpoint keeps nothing: a fitted prompt
follows from the request alone. With a manager that records, each prompt is written down, and the tokens that an answer
reports for it; nothing else of a request is, and no header. It listens on this machine only and sends to the upstream
only, with the client's key.
"""

from __future__ import annotations

import asyncio
import json
import warnings
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import urlsplit

from smartplay_tools.errors import extra_named

with extra_named("smartplay_gateway", "gateway"):
    import httpx2
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response, StreamingResponse
    from starlette.routing import Route
    from starlette.types import ASGIApp

from smartplay_gateway.answers import GONE, Report, while_connected
from smartplay_gateway.compaction import is_managed, managed, opened
from smartplay_gateway.endpoint import HANDLERS, event_text, json_response, refuse
from smartplay_gateway.surfaces import CHAT, COUNTED, MESSAGES, Json, Surface, surface_of
from smartplay_gateway.usage import PromptTokens
from smartplay_gateway.window.messages_format import MESSAGES_FORMAT
from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError, PromptOverflowError
from smartplay_tools.errors import SmartPlayWarning, TranscriptError
from smartplay_tools.players.wire import RESPONSES, RequestError, Streaming
from smartplay_tools.types.arguments import object_in
from smartplay_tools.web import Server, check_address, guarded

LARGEST = 32 * 1024 * 1024
"""The most bytes of a request, which is what Anthropic takes."""

CONNECT_SECONDS = 10.0
"""Seconds in which the upstream has to take a connection; answers may take as long as they do."""

OF_A_CONNECTION = {"connection", "content-length", "host", "keep-alive", "proxy-authenticate", "proxy-authorization"}
OF_A_CONNECTION |= {"proxy-connection", "te", "trailer", "transfer-encoding", "upgrade"}
"""Headers that concern one connection, which are not passed on."""

Told = Callable[[str, FittedPrompt], None]
"""Is told the path of a request and its prompt."""

Counted = Callable[[PromptTokens], None]
"""Is told what an answer has reported of its prompt; called in a thread."""


def passing_app(
    upstream: str, manager: ContextManager, *, hosts: Sequence[str] = (), told: Told | None = None
) -> ASGIApp:
    """Return the endpoint as an ASGI application.

    Arguments:
        upstream: the base URL of the model's server, as a client would have it.
        manager: the budget of every prompt.
        hosts: names under which it is reached, in addition to this machine's own.
        told: is told every prompt.
    """
    base = checked_address(upstream)
    client = httpx2.AsyncClient(timeout=httpx2.Timeout(None, connect=CONNECT_SECONDS), follow_redirects=False)
    client.headers.clear()  # nothing is sent that the client has not sent

    async def pass_on(request: Request) -> Response:
        surface = surface_of(request.url.path) if request.method == "POST" else None
        exchange = _Exchange(client, request, base, surface or CHAT, manager, told)
        content = await request.body()
        try:
            if surface is None or (body := _object(content)) is None:
                return exchange.passed(await exchange.sent(_countable(request, content)))
            return await exchange.fitted(body, content)
        except (PromptOverflowError, InvalidArgumentError, TranscriptError) as error:
            raise exchange.surface.refused(error) from error
        except _UnansweredError as error:
            return error.response

    async def admit(request: Request) -> Response | None:
        return None

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        await client.aclose()

    route = Route("/{path:path}", pass_on, methods=["GET", "POST", "PUT", "PATCH", "DELETE", "HEAD"])
    app = Starlette(routes=[route], exception_handlers={**HANDLERS, Exception: _fail}, lifespan=lifespan)
    return guarded(app, admit, hosts=hosts, largest=LARGEST)


class ContextEndpoint(Server):
    """The endpoint on an address of this machine; `run` serves until it is stopped, `with` serves in a thread.

        with ContextEndpoint("https://api.openai.com/v1", sp.ContextManager(8_000)) as endpoint:
            client = OpenAI(base_url=endpoint.base_url)

    Arguments:
        upstream: the base URL of the model's server, as a client would have it.
        manager: the budget of every prompt.
        port: where to listen; 0 is a free port.
        hosts, told: as for `passing_app`.
    """

    def __init__(
        self,
        upstream: str,
        manager: ContextManager,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        hosts: Sequence[str] = (),
        told: Told | None = None,
    ) -> None:
        check_address(host, None, hosts)
        super().__init__(passing_app(upstream, manager, hosts=hosts, told=told), host, port, lifespan=True)
        self.base_url = f"{self.url}/v1"


def checked_address(upstream: str) -> str:
    """Return the base URL of an upstream; one that is none is an `InvalidArgumentError`."""
    parts = urlsplit(upstream)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InvalidArgumentError(
            f"{upstream!r} is no base URL; write it with its scheme, as in https://api.openai.com/v1."
        )
    return upstream.rstrip("/")


def _object(content: bytes) -> Json | None:
    """The object that a body holds; one that its server may read, and that cannot be counted here, is refused."""
    try:
        value = json.loads(content)
    except RecursionError:
        raise InvalidArgumentError("The request is nested too deeply to be counted.") from None
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


def _countable(request: Request, content: bytes) -> bytes:
    """A request to count a prompt, as the upstream can read it: with our own compactions as words."""
    surface = next((surface for end, surface in COUNTED.items() if request.url.path.endswith(end)), None)
    body = None if surface is None or request.method != "POST" else object_in(content)
    if surface is None or body is None:
        return content
    made = opened(body, surface, _betas(request))
    return content if made is body else json.dumps(made).encode()


async def _fail(request: Request, error: Exception) -> Response:
    """Answer a request at which the endpoint failed; its client may try again, as with a server that fails."""
    problem = RequestError(500, f"{type(error).__name__}: {error}", headers={"x-should-retry": "true"})
    return await refuse(request, problem)


def _betas(request: Request) -> str:
    return ",".join(request.headers.getlist("anthropic-beta"))


def _record_count(manager: ContextManager, prompt: FittedPrompt, managed: bool, reader: PromptTokens) -> None:
    """Record the tokens that an answer has reported; it has passed, so a record that cannot be written is a warning."""
    try:
        if (tokens := reader.count()) is not None:
            manager.reported(prompt, tokens, managed=managed)
    except TranscriptError as error:
        warnings.warn(str(error), SmartPlayWarning, stacklevel=2)


class _UnansweredError(Exception):
    """The upstream has not answered as asked; what it has said is the client's answer."""

    def __init__(self, response: Response) -> None:
        super().__init__(response.status_code)
        self.response = response


@dataclass(frozen=True)
class _Exchange:
    """A request of a client, and what it takes to send it on."""

    client: httpx2.AsyncClient
    request: Request
    base: str
    surface: Surface
    manager: ContextManager
    told: Told | None

    async def fitted(self, body: Json, content: bytes) -> Response:
        """Return the answer to a request whose prompt is read."""
        made = await managed(body, self.surface, _betas(self.request), self.manager, self.ask)
        if made.answer is not None:
            if not body.get("stream"):
                return json_response(made.answer)
            form: Streaming = MESSAGES_FORMAT if self.surface is MESSAGES else RESPONSES
            events = map(event_text, form.stream(made.answer, {}))
            return Response("".join(events), media_type="text/event-stream")
        given = made.body.get(self.surface.messages)
        messages, counted = await self.fit(made.body)
        if isinstance(given, str):
            messages = given
        if made.body is not body or messages != given:
            content = json.dumps({**made.body, self.surface.messages: messages}).encode()
        is_read = made.report is not None
        return self.passed(await self.sent(content, is_read=is_read), counted, made.report, is_read=is_read)

    async def fit(self, body: Json) -> tuple[Any, Counted | None]:
        """Return the messages that are sent for a body, and who is told what an answer reports for them."""
        prompt = await asyncio.to_thread(self.surface.fitted, body, self.manager)
        if prompt is None:
            return body.get(self.surface.messages), None
        if self.told is not None:
            self.told(self.request.url.path, prompt)
        counted = partial(_record_count, self.manager, prompt, is_managed(body, self.surface))
        return prompt.messages, None if prompt.recorded_as is None else counted

    async def ask(self, body: Json) -> Json:
        """Return the upstream's whole answer to a request that the endpoint makes itself.

        Once the client has gone, nothing is asked any more.
        """
        if (answer := await while_connected(self.request, self._ask(body))) is None:
            raise _UnansweredError(Response(status_code=GONE))
        return answer

    async def _ask(self, body: Json) -> Json:
        messages, counted = await self.fit(body)
        answer = await self.sent(json.dumps({**body, self.surface.messages: messages}).encode(), is_read=True)
        passed = self.passed(answer, counted, is_read=True)
        try:
            read = b"".join([piece async for piece in passed.body_iterator if isinstance(piece, bytes)])
        except (httpx2.TransportError, httpx2.DecodingError) as error:
            problem = f"The upstream's answer to the question for a summary broke off: {type(error).__name__} {error}"
            raise RequestError(502, problem.rstrip()) from None
        value, status = object_in(read), answer.status_code
        if status != 200 or value is None:
            headers = {"content-type": answer.headers.get("content-type", "")}
            raise _UnansweredError(Response(read, status if status != 200 else 502, headers))
        return value

    async def sent(self, content: bytes, *, is_read: bool = False) -> httpx2.Response:
        """Return the upstream's answer to the request with this content; one that `is_read` comes as it can be read."""
        left_out = OF_A_CONNECTION | ({"accept-encoding"} if is_read else set())
        headers = _without(left_out, self.request.headers.raw)
        target = self._target.replace("/responses/compact", "/responses") if is_read else self._target
        sent = self.client.build_request(self.request.method, target, headers=headers, content=content or None)
        try:
            return await self.client.send(sent, stream=True)
        except httpx2.TransportError as error:
            where = urlsplit(target).netloc.rpartition("@")[2]  # without a password
            problem = f"The upstream {where} does not answer: {type(error).__name__} {error}".rstrip()
            raise RequestError(502, problem, headers={"x-should-retry": "true"}) from None

    @property
    def _target(self) -> str:
        """The upstream's address of the request: a base URL that has a path has the version in it."""
        path: str = self.request.scope["raw_path"].decode("ascii")
        if urlsplit(self.base).path:
            path = path.removeprefix("/v1")
        return self.base + path + (f"?{self.request.url.query}" if self.request.url.query else "")

    def passed(
        self,
        answer: httpx2.Response,
        counted: Counted | None = None,
        report: Report | None = None,
        *,
        is_read: bool = False,
    ) -> StreamingResponse:
        """Return the upstream's answer, piece by piece as it comes; `counted` is told what it reports, at its end.

        With a report it says what was done to its prompt, if it is an answer at all.
        """
        incoming = answer.aiter_bytes() if is_read else answer.aiter_raw()

        async def taken(reader: PromptTokens) -> AsyncIterator[bytes]:
            async for piece in incoming:
                yield piece
                if counted is not None:
                    reader.take(piece)

        async def pieces() -> AsyncIterator[bytes]:
            reader = PromptTokens(self.surface.form, passed.headers)
            is_stream = passed.headers.get("content-type", "").startswith("text/event-stream")
            try:
                async for piece in (
                    taken(reader) if report is None else report.passed(taken(reader), is_stream=is_stream)
                ):
                    yield piece
            finally:
                if counted is not None:
                    # In a thread, and not awaited: the end of the answer does not wait for a disk.
                    asyncio.get_running_loop().run_in_executor(None, counted, reader)
                await answer.aclose()

        passed = StreamingResponse(pieces(), answer.status_code)
        passed.raw_headers = _without(
            OF_A_CONNECTION | ({"content-encoding"} if is_read else set()), answer.headers.raw
        )
        return passed


def _without(left_out: Collection[str], headers: Iterable[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    """Headers but some, by their names in lower case."""
    return [(name.lower(), value) for name, value in headers if name.decode().lower() not in left_out]
