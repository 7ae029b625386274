"""The window endpoint as an ASGI application and as a server.

    /v1/chat/completions, /v1/responses, /v1/messages   the model `smartplay/HANDLE` is the episode of that handle
    /v1/messages/count_tokens                           the tokens of its latest prompt
    /mcp/HANDLE                                         its tools, for the host's agent

Requests cannot change the window; the parts of them that are ignored are named in the header `x-smartplay-ignored`, and
logged once an episode.
"""

from __future__ import annotations

import re
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from smartplay_tools.errors import extra_named

with extra_named("An endpoint", "serve"):
    import uvicorn as _uvicorn  # noqa: F401
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse, Response
    from starlette.routing import Route
    from starlette.types import ASGIApp

from smartplay_gateway.endpoint import HANDLERS, WRONG_KEY, json_response, model_object, read_request, refuse, respond
from smartplay_gateway.window.episode import WindowEpisode
from smartplay_gateway.window.formats import CHAT_FORMAT, HostFormat
from smartplay_gateway.window.messages_format import MESSAGES_FORMAT
from smartplay_gateway.window.names import Shown
from smartplay_gateway.window.responses_format import RESPONSES_FORMAT
from smartplay_gateway.window.store import PlayerOf, WindowStore
from smartplay_tools import AsyncPlayer, Episode, EpisodeResult, Player, SmartPlayError
from smartplay_tools.players.wire import RequestError, bad
from smartplay_tools.web import LARGEST_REQUEST, NotServedError, Server, carries, check_address, guarded
from smartplay_tools.web.mcp_http import bind_episode, mcp_route

PREFIX = "smartplay/"
"""The prefix of the handle in the name of a model."""

FORMATS: Sequence[HostFormat] = (CHAT_FORMAT, RESPONSES_FORMAT, MESSAGES_FORMAT)

COUNT_PATH = f"{MESSAGES_FORMAT.path}/count_tokens"

KEY_HEADER = "x-api-key"
"""The header with which Anthropic's clients send a key; OpenAI's send a bearer token."""

RETRY_COUNT = "x-stainless-retry-count"
"""The header in which OpenAI's and Anthropic's clients count their retries."""

SUB_AGENT_HEADERS = ("x-claude-code-agent-id", "x-openai-subagent")
"""Headers that Claude Code and Codex send with the requests of sub-agents only."""

SHORT_REQUEST = 16 * 1024
"""Bytes of a request that are read in less time than it takes to switch to a thread and back."""

LONGEST_HEADER = 4_000
"""Characters of a header; servers and clients take few more. The log has the whole text."""


CODES = {404: "model_not_found", 500: "record_refused", 503: "full"}
"""The codes of the refusals of episodes, by their status."""


def window_app(
    store: WindowStore, *, token: str | None = None, hosts: Sequence[str] = (), origins: Sequence[str] = ()
) -> ASGIApp:
    """Return the endpoint as an ASGI application, behind the guard of the MCP server.

    Arguments:
        store: the episodes that can be played.
        token: what requests carry as API key or bearer token; with None, anybody who knows a handle may play.
        hosts: the names under which it is reached, in addition to this machine's own; with or without a port.
        origins: the web pages that may use it from a browser.
    """

    async def admit(request: Request) -> Response | None:
        surface = request.url.path.lstrip("/").partition("/")[0]
        if surface not in ("mcp", "v1"):
            return PlainTextResponse("Not found", 404)
        if token is not None and not carries(request, token, key_header=KEY_HEADER):
            return await refuse(request, WRONG_KEY)
        return await bind_episode(request, store) if surface == "mcp" else None

    routes = [
        *(Route(form.path, _handler(store, form), methods=["POST"]) for form in FORMATS),
        Route(COUNT_PATH, _counter(store), methods=["POST"]),
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
        host, port: where to listen; port 0 is a free one. The address is bound at once.
        token: what requests carry as API key or bearer token.
        hosts, origins: names under which it is reached, and web pages that may use it.
        folder: where the records go; episodes then continue after a restart.
        closing: the name of a tool by which frameworks want a run to be closed, as smolagents does; None for none.
        only_game_tools: whether the agent's other tools are hidden from the model. A coding agent has a dozen, which
            take thousands of tokens of every prompt.
        show_system: whether the model is shown the agent's instructions, as they are in its first request; they are
            in the head of every prompt, and counted.
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
        only_game_tools: bool = False,
        show_system: bool = False,
        **options: Any,
    ) -> None:
        check_address(host, token, hosts)
        shown = Shown(only_game_tools, show_system)
        self.store = WindowStore(player, closing=closing, shown=shown, folder=folder, **options)
        app = window_app(self.store, token=token, hosts=hosts, origins=origins)
        super().__init__(app, host, port, lifespan=True, asks=[player])
        self.base_url = f"{self.url}/v1"

    def open(self, game: str, *, seed: int, **options: Any) -> str:
        """Begin an episode and return its handle; `options` are `Episode`'s."""
        return self.store.open(game, seed=seed, **options)

    def serve(self, episode: Episode, **continued: Any) -> str:
        """Give a handle to an existing episode; `continued` are the arguments of `WindowStore.serve`."""
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
        """Say which of the host's own messages and fields have not reached the model."""
        return self.store.ignored(handle)

    def result(self, handle: str) -> EpisodeResult | None:
        """Return an episode's result, once it is over; it stays when the episode is closed."""
        gone = self.store.gone(handle)
        return self._episode(handle).episode.result if gone is None else gone.result

    def close(self, handle: str) -> EpisodeResult | None:
        """End an episode and return its result."""
        return self.store.close(handle)

    def _episode(self, handle: str) -> WindowEpisode:
        episode = self.store.find(handle)
        if episode is None:
            raise KeyError(handle)
        return episode


def _handler(store: WindowStore, form: HostFormat) -> Any:
    async def handle(request: Request) -> Response:
        body, completion = await read_request(request, lambda body: (body, form.read(body)), at_once=SHORT_REQUEST)
        is_of_sub_agent = any(name in request.headers for name in SUB_AGENT_HEADERS)
        completion = replace(completion, is_of_sub_agent=is_of_sub_agent)
        episode = await _episode(store, body.get("model"))
        ignored = _header_value(episode.ignored_of(completion))

        async def answer() -> dict[str, Any]:
            try:
                reply = await episode.reply(completion, is_retry=_is_retry(request))
            except SmartPlayError as error:
                raise RequestError(400, str(error), code="episode_refused") from error
            return form.write(reply.message, reply.usage, body)

        return await respond(request, form, answer(), body, {"x-smartplay-ignored": ignored} if ignored else {})

    return handle


def _header_value(text: str) -> str:
    """Return a text as a header can have it: names that a host chose hold anything, and a header no breaks or edges."""
    printable = re.sub(r"[\x00-\x20\x7f]+", " ", text.encode("ascii", "replace").decode())
    return printable[:LONGEST_HEADER].strip()


def _counter(store: WindowStore) -> Any:
    async def count(request: Request) -> Response:
        """Answer how long a prompt is: as long as the latest one that the model was sent, whatever the host sends."""
        model = await read_request(request, lambda body: body.get("model"))
        return json_response({"input_tokens": (await _episode(store, model)).prompt_tokens})

    return count


def _is_retry(request: Request) -> bool:
    return request.headers.get(RETRY_COUNT, "0").strip() not in ("", "0")


async def _episode(store: WindowStore, model: Any) -> WindowEpisode:
    if not isinstance(model, str):
        raise bad("A request names its model.", "model")
    try:
        return await store.asked_for(model.removeprefix(PREFIX))
    except NotServedError as error:
        problem = f"{error} (the model {model[:80]!r}; an episode is {PREFIX}HANDLE)"
        raise RequestError(error.status, problem, code=CODES[error.status]) from error


async def _list_models(request: Request) -> Response:
    """Answer GET /v1/models: nothing is listed, because anybody who knows a handle may play."""
    return json_response({"object": "list", "data": []})


def _model_shower(store: WindowStore) -> Any:
    async def show(request: Request) -> Response:
        name = request.path_params["name"]
        await _episode(store, name)
        return json_response(model_object(name))

    return show
