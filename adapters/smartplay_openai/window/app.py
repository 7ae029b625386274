"""The window endpoint as an ASGI application and as a server.

    /v1/chat/completions, /v1/responses   the model `smartplay/HANDLE` is the episode of that handle
    /mcp/HANDLE                           its tools, for the host's agent

Requests have no power over the window; what of them is ignored is named in the header `x-smartplay-ignored`, and is
logged once an episode.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from smartplay_openai.chat import CHAT
from smartplay_openai.interface import Interface
from smartplay_openai.problems import RequestError, bad
from smartplay_openai.responses import RESPONSES
from smartplay_openai.server.answers import (
    HANDLERS,
    event_stream,
    json_response,
    model_object,
    read_request,
    wrong_key,
)
from smartplay_openai.window.completion_request import read_completion
from smartplay_openai.window.episode import WindowEpisode
from smartplay_openai.window.store import PlayerOf, WindowStore
from smartplay_tools import AsyncPlayer, Episode, EpisodeResult, Player, SmartPlayError
from smartplay_tools.web import LARGEST_REQUEST, FullError, Server, carries, check_address, guarded
from smartplay_tools.web.mcp_http import bind_episode, mcp_route

PREFIX = "smartplay/"
"""What stands before the handle in the name of a model."""

RETRY_COUNT = "x-stainless-retry-count"
"""The header in which OpenAI's clients count their retries."""


def window_app(
    store: WindowStore, *, token: str | None = None, hosts: Sequence[str] = (), origins: Sequence[str] = ()
) -> ASGIApp:
    """Return the endpoint as an ASGI application, behind the guard of the MCP server.

    Arguments:
        store: the episodes that can be played.
        token: what requests carry as API key or bearer token; with None, who knows a handle may play.
        hosts: the names under which it is reached, beside this machine's own; with or without a port.
        origins: the web pages that may use it from a browser.
    """

    async def admit(request: Request) -> Response | None:
        surface = request.url.path.lstrip("/").partition("/")[0]
        if surface not in ("mcp", "v1"):
            return PlainTextResponse("Not found", 404)
        if token is not None and not carries(request, token):
            return wrong_key()
        return await bind_episode(request, store) if surface == "mcp" else None

    routes = [
        *(Route(interface.path, _handler(store, interface), methods=["POST"]) for interface in (CHAT, RESPONSES)),
        Route("/v1/models", _list_models),
        Route("/v1/models/{name:path}", _model_shower(store)),
        mcp_route(),
    ]

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        await store.aclose()

    app = Starlette(routes=routes, exception_handlers=HANDLERS, lifespan=lifespan)
    return guarded(app, admit, hosts=hosts, origins=origins, largest=LARGEST_REQUEST)


class WindowEndpoint(Server):
    """The endpoint on an address; `run` serves until it is stopped, `with` serves in a thread.

        with WindowEndpoint(sp.get_player("openai:MODEL")) as endpoint:
            handle = endpoint.open("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=700))
            agent = ...  # base_url=endpoint.base_url, model=endpoint.model(handle), tools from endpoint.mcp_url(handle)

    It spends the player's key, so an address that other machines reach needs a token and the names by which they reach
    it.

    Arguments:
        player: who plays: one player for all episodes, or a function that returns one for a seed.
        host, port: where to listen; port 0 is a free one. The address is taken at once.
        token: what requests carry as API key or bearer token.
        hosts, origins: names under which it is reached, and web pages that may use it.
        folder: where the records go; episodes then go on after a restart.
        closing: the name of a tool by which frameworks want a run to be closed, as smolagents does; None for none.
        options: `most` and `idle`, as for the episodes of the MCP server.
    """

    def __init__(
        self,
        player: Player | AsyncPlayer | PlayerOf,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        hosts: Sequence[str] = (),
        origins: Sequence[str] = (),
        folder: Path | None = None,
        closing: str | None = "final_answer",
        **options: Any,
    ) -> None:
        check_address(host, token, hosts)
        self.store = WindowStore(player, closing=closing, folder=folder, **options)
        super().__init__(window_app(self.store, token=token, hosts=hosts, origins=origins), host, port, lifespan=True)
        self.base_url = f"{self.url}/v1"

    def open(self, game: str, *, seed: int, **options: Any) -> str:
        """Begin an episode and return its handle; `options` are `Episode`'s."""
        return self.store.open(game, seed=seed, **options)

    def serve(self, episode: Episode, **continued: Any) -> str:
        """Give a handle to an episode that is made already; `continued` are the arguments of `WindowStore.serve`."""
        return self.store.serve(episode, **continued)

    def model(self, handle: str) -> str:
        """Return the name of the model that is an episode."""
        return f"{PREFIX}{handle}"

    def mcp_url(self, handle: str) -> str:
        """Return where the tools of an episode are."""
        return f"{self.url}/mcp/{handle}"

    def functions(self, handle: str) -> tuple[Callable[[], str], Callable[[str], str], Callable[[], str]]:
        """Return an episode's tools as plain functions, for an agent in this process."""
        return self._episode(handle).functions()

    def ignored(self, handle: str) -> str:
        """Say what of the host's own messages and fields has not reached the model."""
        return self._episode(handle).ignored

    def result(self, handle: str) -> EpisodeResult | None:
        """Return an episode's result, once it is over."""
        return self._episode(handle).episode.result

    def close(self, handle: str) -> EpisodeResult | None:
        """End an episode and return its result."""
        return self.store.close(handle)

    def _episode(self, handle: str) -> WindowEpisode:
        episode = self.store.find(handle)
        if episode is None:
            raise KeyError(handle)
        return episode


def _handler(store: WindowStore, interface: Interface) -> Any:
    async def handle(request: Request) -> Response:
        body, completion = await read_request(request, lambda body: (body, read_completion(interface, body)))
        episode = await _episode(store, body.get("model"))
        try:
            reply = await episode.reply(completion, is_retry=_is_retry(request))
        except SmartPlayError as error:
            raise RequestError(400, str(error), code="episode_refused") from error
        answer = interface.write(reply.message, str(body["model"]), reply.usage)
        ignored = completion.ignored.encode("ascii", "replace").decode()
        headers = {"x-smartplay-ignored": ignored} if ignored else {}
        if body.get("stream"):
            events = event_stream(interface.stream(answer, body))
            return StreamingResponse(events, media_type="text/event-stream", headers=headers)
        return json_response(answer, 200, headers)

    return handle


def _is_retry(request: Request) -> bool:
    return request.headers.get(RETRY_COUNT, "0").strip() not in ("", "0")


async def _episode(store: WindowStore, model: Any) -> WindowEpisode:
    if not isinstance(model, str):
        raise bad("A request names its model.", "model")
    handle = model[len(PREFIX) :] if model.startswith(PREFIX) else model
    try:
        episode = store.opened(handle) or await asyncio.to_thread(store.find, handle)
    except FullError as error:
        raise RequestError(503, str(error), code="full") from error
    except SmartPlayError as error:
        raise RequestError(500, "The record of this episode cannot be continued.", code="record_refused") from error
    if episode is None:
        problem = f"There is no episode {model[:80]!r}; the model is {PREFIX}HANDLE."
        raise RequestError(404, problem, code="model_not_found")
    return episode


async def _list_models(request: Request) -> Response:
    """Answer GET /v1/models: nothing is listed, because who knows a handle may play."""
    return json_response({"object": "list", "data": []})


def _model_shower(store: WindowStore) -> Any:
    async def show(request: Request) -> Response:
        name = request.path_params["name"]
        await _episode(store, name)
        return json_response(model_object(name))

    return show
