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

from smartplay_gateway.edits import applied, reported
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

STORED = ("previous_response_id", "conversation", "prompt")
"""Fields of a request to Responses that stand for what the provider keeps."""

Told = Callable[[str, FittedPrompt], None]
"""Is told the path of a request and its prompt."""

Counted = Callable[[int], None]
"""Is told the tokens of a prompt that an answer has reported; called in a thread."""


@dataclass(frozen=True)
class Surface:
    """An interface whose prompts are fitted."""

    form: Any
    """The name of the form of its messages."""
    messages: str
    """The field with the messages."""
    system: str | None
    """The field with instructions beside them."""

    def fitted(self, body: Mapping[str, Any], manager: ContextManager) -> FittedPrompt | None:
        """Return the prompt of a request; None if it has none that could be read, which its provider will say."""
        given = body.get(self.messages)
        if isinstance(given, str):
            given = [{"role": "user", "content": given}]
        tools = body.get("tools") or []
        if not isinstance(given, list) or not isinstance(tools, list):
            return None
        for name in STORED if self.form == "responses" else ():
            if body.get(name) is not None:
                raise InvalidArgumentError(
                    f"With `{name}` the provider adds what it keeps, which cannot be counted; leave it out."
                )
        return manager.fit(given, **self._beside(body))

    def edited(self, body: dict[str, Any], betas: str, manager: ContextManager) -> tuple[dict[str, Any], Any]:
        """Return a request after its context editing, and what was cleared; None if there is none to do here."""
        if self.form != "anthropic" or not isinstance(body.get(self.messages), list):
            return body, None
        return applied(body, betas, lambda messages: manager.count(messages, **self._beside(body)))

    def _beside(self, body: Mapping[str, Any]) -> dict[str, Any]:
        """What of a request counts beside its messages."""
        system = body.get(self.system) if self.system else None
        beside = {"tools": body.get("tools") or [], "system": system, "output_schema": self._schema(body)}
        return {**beside, "form": self.form}

    def _schema(self, body: Mapping[str, Any]) -> Any:
        """The schema of the answer's format, wherever the interface has it."""
        if self.form == "responses":
            text = body.get("text")
            wanted = text.get("format") if isinstance(text, Mapping) else None
        else:
            wanted = body.get("response_format", body.get("output_format"))
        return wanted.get("json_schema", wanted.get("schema")) if isinstance(wanted, Mapping) else None

    def refusal(self, error: Exception) -> Mapping[str, Any]:
        """Return the body of a refusal in the provider's form."""
        is_long = isinstance(error, PromptOverflowError)
        if self.form == "anthropic":
            words = f"prompt is too long: {error}" if is_long else str(error)
            return {"type": "error", "error": {"type": "invalid_request_error", "message": words}}
        code = "context_length_exceeded" if is_long else "invalid_prompt"
        kind = "invalid_request_error"
        return {"error": {"message": str(error), "type": kind, "param": self.messages, "code": code}}


SURFACES: Mapping[str, Surface] = {
    "/chat/completions": Surface("chat", "messages", None),
    "/responses": Surface("responses", "input", "instructions"),
    "/messages": Surface("anthropic", "messages", "system"),
}
"""The interfaces by the end of their paths."""


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
        counted: Counted | None = None
        reports: list[dict[str, Any]] | None = None
        if surface is not None and (body := object_in(content)) is not None:
            try:
                betas = ",".join(request.headers.getlist("anthropic-beta"))
                edited, reports = await asyncio.to_thread(surface.edited, body, betas, manager)
                prompt = await asyncio.to_thread(surface.fitted, edited, manager)
            except (PromptOverflowError, InvalidArgumentError) as error:
                return _json(surface.refusal(error), 400)
            except TranscriptError as error:
                return _json(surface.refusal(error), 500)
            if prompt is not None:
                if told is not None:
                    told(request.url.path, prompt)
                if prompt.recorded_as is not None:
                    counted = partial(_record_count, manager, prompt)
                given = body[surface.messages]
                if reports is not None or (not isinstance(given, str) and prompt.messages != given):
                    content = json.dumps({**edited, surface.messages: prompt.messages}).encode()
        return await _answer(client, request, _target(base, request), content, surface, counted, reports)

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


def surface_of(path: str) -> Surface | None:
    """Return the interface that a path belongs to; None for any other path."""
    return next((surface for end, surface in SURFACES.items() if path.endswith(end)), None)


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


def _record_count(manager: ContextManager, prompt: FittedPrompt, tokens: int) -> None:
    """Record the tokens of a prompt; its answer has passed, so that a record that cannot be written is a warning."""
    try:
        manager.reported(prompt, tokens)
    except TranscriptError as error:
        warnings.warn(str(error), SmartPlayWarning, stacklevel=2)


async def _answer(
    client: httpx2.AsyncClient,
    request: Request,
    target: str,
    content: bytes,
    surface: Surface | None,
    counted: Counted | None,
    reports: list[dict[str, Any]] | None = None,
) -> Response:
    """The upstream's answer, piece by piece as it comes; `counted` is told what it reports, once it has passed.

    With `reports` it says which edits were applied, if it is an answer at all.
    """
    headers = [(name, value) for name, value in request.headers.raw if name.decode().lower() not in OF_A_CONNECTION]
    if reports is not None:
        headers = [(name, value) for name, value in headers if name.lower() != b"accept-encoding"]
    sent = client.build_request(request.method, target, headers=headers, content=content or None)
    try:
        answer = await client.send(sent, stream=True)
    except httpx2.TransportError as error:
        where = urlsplit(target).netloc.rpartition("@")[2]  # without a password
        problem = f"The upstream {where} does not answer: {type(error).__name__} {error}".rstrip()
        form = surface or SURFACES["/chat/completions"]
        return _json(form.refusal(InvalidArgumentError(problem)), 502)

    told: Mapping[str, str] = answer.headers
    incoming: AsyncIterator[bytes] = answer.aiter_raw()
    left_out = OF_A_CONNECTION
    if reports is not None:
        told, left_out = {"content-type": told.get("content-type", "")}, OF_A_CONNECTION | {"content-encoding"}
        is_stream = told["content-type"].startswith("text/event-stream")
        incoming = reported(answer.aiter_bytes(), reports, is_stream=is_stream)
    reader = PromptTokens(surface.form, told) if surface is not None and counted is not None else None

    async def pieces() -> AsyncIterator[bytes]:
        try:
            async for piece in incoming:
                yield piece
                if reader is not None:
                    reader.take(piece)
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


def _json(body: Mapping[str, Any], status: int) -> Response:
    return Response(json.dumps(body), status, media_type="application/json")
