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
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
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
from smartplay_gateway.compaction import NoSummaryError, is_managed, managed, opened
from smartplay_gateway.endpoint import json_response
from smartplay_gateway.surfaces import CHAT, COUNTED, Json, Surface, surface_of
from smartplay_gateway.usage import PromptTokens
from smartplay_tools import ContextManager, FittedPrompt, InvalidArgumentError, PromptOverflowError
from smartplay_tools.errors import SmartPlayWarning, TranscriptError
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

Counted = Callable[[int], None]
"""Is told the tokens of a prompt that an answer has reported; called in a thread."""


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
        content = await request.body()
        surface = surface_of(request.url.path) if request.method == "POST" else None
        body, form = None if surface is None else object_in(content), surface or CHAT
        try:
            if surface is None or body is None:
                if surface is not None and _is_too_deep(content):
                    raise InvalidArgumentError("The request is nested too deeply to be counted.")
                content = _countable(request, content)
                return await _passed(await _sent(client, request, _target(base, request), content), surface)
            return await _managed(_Exchange(client, request, base, surface, manager, told), body, content)
        except (PromptOverflowError, InvalidArgumentError) as error:
            return json_response(form.refusal(error), 400)
        except NoSummaryError as error:
            return json_response(form.refusal(error), 500, {"x-should-retry": "false"})
        except TranscriptError as error:
            return json_response(form.refusal(error), 500)
        except _UnansweredError as error:
            return error.response

    async def admit(request: Request) -> Response | None:
        return None

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        await client.aclose()

    methods = ["GET", "POST", "PUT", "PATCH", "DELETE", "HEAD"]
    app = Starlette(routes=[Route("/{path:path}", pass_on, methods=methods)], lifespan=lifespan)
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


def _target(base: str, request: Request) -> str:
    """The upstream's address of a request: a base URL that has a path has the version in it."""
    path: str = request.scope["raw_path"].decode("ascii")
    if urlsplit(base).path:
        path = path.removeprefix("/v1")
    return base + path + (f"?{request.url.query}" if request.url.query else "")


def _record_count(manager: ContextManager, prompt: FittedPrompt, managed: bool, tokens: int) -> None:
    """Record the tokens of a prompt; its answer has passed, so that a record that cannot be written is a warning."""
    try:
        manager.reported(prompt, tokens, managed=managed)
    except TranscriptError as error:
        warnings.warn(str(error), SmartPlayWarning, stacklevel=2)


def _is_too_deep(content: bytes) -> bool:
    """Whether a body may be JSON that its server can read, but that cannot be read here."""
    try:
        json.loads(content)
    except RecursionError:
        return True
    except ValueError:
        pass
    return False


def _countable(request: Request, content: bytes) -> bytes:
    """A request to count a prompt, as the upstream can read it: with our own compactions as words."""
    surface = next((surface for end, surface in COUNTED.items() if request.url.path.endswith(end)), None)
    body = None if surface is None or request.method != "POST" else object_in(content)
    if surface is None or body is None:
        return content
    made = opened(body, surface, ",".join(request.headers.getlist("anthropic-beta")))
    return content if made is body else json.dumps(made).encode()


class _UnansweredError(Exception):
    """The upstream has not answered as asked; what it has said is the client's answer."""

    def __init__(self, response: Response) -> None:
        super().__init__(response.status_code)
        self.response = response


@dataclass(frozen=True)
class _Exchange:
    """A request of a client whose prompt is read, and what it takes to send it on."""

    client: httpx2.AsyncClient
    request: Request
    base: str
    surface: Surface
    manager: ContextManager
    told: Told | None

    async def fitted(self, body: Json) -> tuple[FittedPrompt | None, Counted | None]:
        """Return the prompt of a body, and who is told what an answer reports for it."""
        prompt = await asyncio.to_thread(self.surface.fitted, body, self.manager)
        if prompt is not None and self.told is not None:
            self.told(self.request.url.path, prompt)
        if prompt is None or prompt.recorded_as is None:
            return prompt, None
        return prompt, partial(_record_count, self.manager, prompt, is_managed(body, self.surface))

    async def ask(self, body: Json) -> Json:
        """Return the upstream's whole answer to a request that the endpoint makes itself.

        Once the client has gone, nothing is asked any more.
        """
        if (answer := await while_connected(self.request, self._ask(body))) is None:
            raise _UnansweredError(Response(status_code=GONE))
        return answer

    async def _ask(self, body: Json) -> Json:
        prompt, counted = await self.fitted(body)
        messages = body[self.surface.messages] if prompt is None else prompt.messages
        content = json.dumps({**body, self.surface.messages: messages}).encode()
        target = _target(self.base, self.request).replace("/responses/compact", "/responses")
        answer = await _sent(self.client, self.request, target, content, is_read=True)
        passed = await _passed(answer, self.surface, counted, is_read=True)
        try:
            read = b"".join([piece async for piece in passed.body_iterator if isinstance(piece, bytes)])
        except (httpx2.TransportError, httpx2.DecodingError) as error:
            problem = f"The upstream's answer to the question for a summary broke off: {type(error).__name__} {error}"
            told = self.surface.refusal(InvalidArgumentError(problem.rstrip()))
            raise _UnansweredError(json_response(told, 502, {"x-should-retry": "false"})) from None
        value = object_in(read)
        if answer.status_code != 200 or value is None:
            headers = {"content-type": answer.headers.get("content-type", "")}
            raise _UnansweredError(Response(read, answer.status_code if answer.status_code != 200 else 502, headers))
        return value


async def _managed(exchange: _Exchange, body: Json, content: bytes) -> Response:
    """The answer to a request whose prompt is read."""
    surface, request = exchange.surface, exchange.request
    betas = ",".join(request.headers.getlist("anthropic-beta"))
    made = await managed(body, surface, betas, exchange.manager, exchange.ask)
    if made.answer is not None and made.report is not None:
        if not body.get("stream"):
            return json_response(made.answer, 200)
        events = [f"event: {each['type']}\ndata: {json.dumps(each)}\n\n" for each in made.report.stream(made.answer)]
        return Response("".join(events), media_type="text/event-stream")
    prompt, counted = await exchange.fitted(made.body)
    given = made.body.get(surface.messages)
    is_other = prompt is not None and not isinstance(given, str) and prompt.messages != given
    if made.body is not body or is_other:
        messages = given if prompt is None or isinstance(given, str) else prompt.messages
        content = json.dumps({**made.body, surface.messages: messages}).encode()
    is_read = made.report is not None
    answer = await _sent(exchange.client, request, _target(exchange.base, request), content, is_read=is_read)
    return await _passed(answer, surface, counted, made.report, is_read=is_read)


async def _sent(
    client: httpx2.AsyncClient, request: Request, target: str, content: bytes, *, is_read: bool = False
) -> httpx2.Response:
    """The upstream's answer to a client's request with this content; one that `is_read` comes as it can be read."""
    headers = [(name, value) for name, value in request.headers.raw if name.decode().lower() not in OF_A_CONNECTION]
    if is_read:
        headers = [(name, value) for name, value in headers if name.lower() != b"accept-encoding"]
    sent = client.build_request(request.method, target, headers=headers, content=content or None)
    try:
        return await client.send(sent, stream=True)
    except httpx2.TransportError as error:
        where = urlsplit(target).netloc.rpartition("@")[2]  # without a password
        problem = f"The upstream {where} does not answer: {type(error).__name__} {error}".rstrip()
        form = surface_of(request.url.path) or CHAT
        raise _UnansweredError(json_response(form.refusal(InvalidArgumentError(problem)), 502)) from None


async def _passed(
    answer: httpx2.Response,
    surface: Surface | None,
    counted: Counted | None = None,
    report: Report | None = None,
    *,
    is_read: bool = False,
) -> StreamingResponse:
    """The upstream's answer, piece by piece as it comes; `counted` is told what it reports, once it has passed.

    With a report it says what was done to its prompt, if it is an answer at all.
    """
    told: Mapping[str, str] = answer.headers
    incoming: AsyncIterator[bytes] = answer.aiter_raw()
    left_out = OF_A_CONNECTION
    if is_read:
        told, left_out = {"content-type": told.get("content-type", "")}, OF_A_CONNECTION | {"content-encoding"}
        incoming = answer.aiter_bytes()
    reader = PromptTokens(surface.form, told) if surface is not None and counted is not None else None

    async def taken() -> AsyncIterator[bytes]:
        async for piece in incoming:
            yield piece
            if reader is not None:
                reader.take(piece)

    async def pieces() -> AsyncIterator[bytes]:
        is_stream = told["content-type"].startswith("text/event-stream") if is_read else False
        try:
            async for piece in taken() if report is None else report.passed(taken(), is_stream=is_stream):
                yield piece
        finally:
            if reader is not None and counted is not None:
                # In a thread, and not awaited: the end of the answer does not wait for a disk.
                asyncio.get_running_loop().run_in_executor(None, _tell, reader, counted)
            await answer.aclose()

    passed = StreamingResponse(pieces(), answer.status_code)
    kept = [(name.lower(), value) for name, value in answer.headers.raw if name.decode().lower() not in left_out]
    passed.raw_headers = kept
    return passed


def _tell(reader: PromptTokens, counted: Counted) -> None:
    if (tokens := reader.count()) is not None:
        counted(tokens)
