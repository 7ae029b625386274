"""Every server of the package, at real sockets: whom it admits, how much it takes in, and how long it waits for it.

A server that is not in the table below fails the last test.
"""

from __future__ import annotations

import ast
import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import pytest

import smartplay_tools as sp

pytest.importorskip("uvicorn")

from smartplay_tools.web import EpisodeStore, Server, bodies, server as web_server
from tests.loopback import ask

GAME = "Hanoi3Disk-v0"
ROOT = Path(__file__).parents[2]

TOOLS = [sp.schema(tool, "openai") for tool in sp.Episode(GAME, seed=1).tools]
LIST_TOOLS = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
CALL, REQUEST = 64 * 1024, 4 * 1024 * 1024


class Case(NamedTuple):
    """A server, made with the arguments of its address, and a request that it answers."""

    server: Server
    path: str
    body: Any
    headers: dict[str, str] = {}  # noqa: RUF012  # nobody changes it


Make = Callable[..., Case]


def completion(model: str) -> dict[str, Any]:
    return {"model": model, "messages": [{"role": "user", "content": "Play."}], "tools": TOOLS}


def serve_openai(stack: ExitStack, folder: Path, *, token: str | None = None, **address: Any) -> Case:
    sg = pytest.importorskip("smartplay_gateway")
    server = sg.LocalEndpoint(sp.get_player("rule"), api_key=token, **address)
    return Case(stack.enter_context(server), "/v1/chat/completions", completion("rule"))


def serve_window(stack: ExitStack, folder: Path, **address: Any) -> Case:
    sg = pytest.importorskip("smartplay_gateway")
    server = stack.enter_context(sg.WindowEndpoint(sp.get_player("rule"), **address))
    return Case(server, "/v1/chat/completions", completion(f"smartplay/{server.open(GAME, seed=7)}"))


def serve_window_at(path: str, stack: ExitStack, folder: Path, **address: Any) -> Case:
    """The other interfaces of a window; what a request lacks there is not missed."""
    server, _, body, _ = serve_window(stack, folder, **address)
    return Case(server, path, {**body, "max_tokens": 100, "input": "Play.", "tools": []})


def serve_tools_of_a_window(stack: ExitStack, folder: Path, **address: Any) -> Case:
    server, _, body, _ = serve_window(stack, folder, **address)
    return Case(server, f"/mcp/{body['model'].removeprefix('smartplay/')}", LIST_TOOLS)


def serve_mcp(stack: ExitStack, folder: Path, **address: Any) -> Case:
    from smartplay_mcp import HttpServer

    store = EpisodeStore()
    server = stack.enter_context(HttpServer(store, port=0, **address))
    return Case(server, f"/mcp/{store.open(GAME, seed=7)}", LIST_TOOLS)


def view_and_play(stack: ExitStack, folder: Path, **address: Any) -> Case:
    view = pytest.importorskip("smartplay_tools.web.site")
    from smartplay_tools.web.site import BrowserGames

    play = BrowserGames([GAME], folder / "human")
    server = view.ViewServer(view.RunList(own=[play.folder]), play=play, **address)
    stack.enter_context(play)
    stack.enter_context(server)
    token = {"Authorization": "Bearer token"}
    key = re.search('data-key="([^"]+)"', answered(Case(server, f"/play/{GAME}", None), method="GET", headers=token)[1])
    state = json.loads(answered(Case(server, f"/api/play/{GAME}?after=0", None), method="GET", headers=token)[1])
    assert key is not None
    body = {"number": state["number"], "tool": "read_manual"}
    return Case(server, f"/api/play/{GAME}/reply", body, {"X-SmartPlay-Key": key[1]})


def serve_context(stack: ExitStack, folder: Path, **address: Any) -> Case:
    sg = pytest.importorskip("smartplay_gateway")
    upstream = pytest.importorskip("tests.adapters.test_context_endpoint").Upstream()
    stack.callback(upstream.close)
    server = stack.enter_context(sg.ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(8_000), **address))
    return Case(server, "/v1/chat/completions", completion("rule"))


def serve_openenv(stack: ExitStack, folder: Path, **address: Any) -> Case:
    pytest.importorskip("openenv")
    from smartplay_openenv import new_app

    server = Server(new_app(GAME), "127.0.0.1", 0, lifespan=True, websockets=True)
    return Case(stack.enter_context(server), "/reset", {"seed": 7})


SERVERS: dict[str, tuple[Make, int]] = {
    "LocalEndpoint, endpoint_app": (serve_openai, REQUEST),
    "WindowEndpoint, window_app": (serve_window, REQUEST),
    "WindowEndpoint: /v1/responses": (partial(serve_window_at, "/v1/responses"), REQUEST),
    "WindowEndpoint: /v1/messages": (partial(serve_window_at, "/v1/messages"), REQUEST),
    "WindowEndpoint: /v1/messages/count_tokens": (partial(serve_window_at, "/v1/messages/count_tokens"), REQUEST),
    "WindowEndpoint: /mcp": (serve_tools_of_a_window, CALL),
    "ContextEndpoint, passing_app": (serve_context, 32 * 1024 * 1024),
    "HttpServer, http_app": (serve_mcp, CALL),
    "ViewServer": (view_and_play, CALL),
    "new_app": (serve_openenv, CALL),
}
"""How each is made, and the most bytes of a body. A name begins with the class of the server and its application."""

OPEN = "new_app"
"""The server that answers to every name and without a token: it is made for containers and hosts of others, and has
nothing to spend or to hide."""

OWN_KEYS = "ContextEndpoint, passing_app"
"""The server that has no token, because its clients send the key of the model: it is for this machine only."""


def of_servers(*but: str) -> pytest.MarkDecorator:
    """All servers but these; fast tests ask each application at one address."""
    slow = [name for name in SERVERS if name.startswith("WindowEndpoint: /v1/")]
    names = [pytest.param(name, marks=pytest.mark.slow if name in slow else ()) for name in SERVERS if name not in but]
    return pytest.mark.parametrize("name", names)


every_server, every_guarded_server = of_servers(), of_servers(OPEN)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Make]:
    """Start servers of the table."""
    with ExitStack() as stack:
        yield lambda name, **address: SERVERS[name][0](stack, tmp_path, **address)


def answered(
    case: Case, body: Any = None, *, method: str = "POST", headers: dict[str, str] | None = None
) -> tuple[int, str]:
    """Send a request and return status and text of the answer; a body of parts is sent in chunks."""
    kind = {"Content-Type": "application/json"}
    url = f"{case.server.url.rstrip('/')}{case.path}"
    status, _, text = ask(url, body, method=method, headers={**kind, **case.headers, **(headers or {})})
    return status, text


def padded(body: Any, size: int) -> bytes:
    """Return a body as JSON of exactly `size` bytes."""
    return json.dumps(body).encode().ljust(size)


@every_server
def test_a_body_has_a_limit(serve: Make, name: str) -> None:
    case, largest = serve(name), SERVERS[name][1]
    too_large = (413, f"The body of a request has at most {largest:,} bytes.")
    assert answered(case, padded(case.body, largest + 1)) == too_large
    assert answered(case, iter([padded(case.body, largest), b" "])) == too_large
    assert answered(case, padded(case.body, largest))[0] in (200, 201)


@every_server
def test_what_is_half_sent_is_closed_and_others_are_answered(
    serve: Make, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bodies, "PATIENCE", 0.5)
    case = serve(name)
    head = "".join(f"{key}: {value}\r\n" for key, value in {"Host": "localhost", **case.headers}.items())
    post = f"POST {case.path} HTTP/1.1\r\n{head}Content-Type: application/json\r\n".encode()
    whole = f"GET /elsewhere HTTP/1.1\r\n{head}\r\n".encode()
    too_late = b"The body of a request comes within 0.5 seconds."
    half_sent = {
        b"": b"",
        b"PO": b"",
        post: b"",
        post + b"Content-Length: 20\r\n\r\n": too_late,
        post + b'Content-Length: 20\r\n\r\n{"a": ': too_late,
        post + b'Transfer-Encoding: chunked\r\n\r\n6\r\n{"a": \r\n': too_late,
    }
    where = urlsplit(case.server.url)
    with ExitStack() as stack:
        sockets = [
            stack.enter_context(socket.create_connection((where.hostname, where.port), timeout=30)) for _ in half_sent
        ]
        for connection, sent in zip(sockets, half_sent, strict=True):
            connection.sendall(sent)
        second = stack.enter_context(socket.create_connection((where.hostname, where.port), timeout=30))
        second.sendall(whole)
        assert second.recv(4096)
        second.sendall(post)
        assert answered(case, padded(case.body, 1))[0] in (200, 201)
        for connection, sentence in zip(sockets, half_sent.values(), strict=True):
            answer = b"".join(iter(lambda: connection.recv(4096), b""))  # noqa: B023  # the server ends each
            assert answer.endswith(sentence)
            assert (b" 408 " in answer) is bool(sentence)
        assert b" 408 " not in b"".join(iter(lambda: second.recv(4096), b""))


@every_server
def test_a_server_that_stops_answers_what_is_half_sent(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(web_server, "GRACE", 0.2)
    with ExitStack() as later:
        with ExitStack() as stack:
            case = SERVERS[name][0](stack, tmp_path)
            where = urlsplit(case.server.url)
            connection = later.enter_context(socket.create_connection((where.hostname, where.port), timeout=30))
            head = {"Host": "localhost", **case.headers, "Content-Type": "application/json", "Content-Length": "20"}
            lines = "".join(f"{key}: {value}\r\n" for key, value in head.items())
            connection.sendall(f'POST {case.path} HTTP/1.1\r\n{lines}\r\n{{"a": '.encode())
            assert answered(case, padded(case.body, 1))[0] in (200, 201)
        answer = b"".join(iter(lambda: connection.recv(4096), b""))
    assert b" 503 " in answer
    assert answer.endswith(b"The server stops.")
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, (_, largest) in SERVERS.items() if largest == REQUEST])
def test_others_are_answered_while_a_long_conversation_is_read(serve: Make, name: str) -> None:
    case = serve(name)
    words = " ".join(f"word{number}" for number in range(80_000))
    kind = "input" if "input" in case.body else "messages"
    body = {**case.body, kind: [{"role": "user", "content": words}] * 2}
    answers: list[int] = []
    reading = threading.Thread(target=lambda: answers.append(answered(case, json.dumps(body))[0]))
    models, began, longest = Case(case.server, "/v1/models", None), time.monotonic(), 0.0
    reading.start()
    while reading.is_alive():
        asked = time.monotonic()
        assert answered(models, method="GET")[0] == 200
        longest = max(longest, time.monotonic() - asked)
    assert answers == [200]
    # One that had to wait would take nearly all of the time.
    assert longest < max(0.25, (time.monotonic() - began) / 2)


@every_guarded_server
def test_only_expected_hosts_and_pages_are_answered(serve: Make, name: str) -> None:
    case = serve(name)
    body = json.dumps(case.body)
    assert answered(case, body, headers={"Host": "evil.example"}) == (421, "Invalid Host header")
    plain = {"Origin": "https://evil.example", "Content-Type": "text/plain"}  # which no browser asks leave for
    assert answered(case, body, headers=plain) == (403, "Invalid Origin header")
    assert answered(case, body, headers={"Origin": case.server.url.rstrip("/")})[0] in (200, 201)


@of_servers(OPEN, OWN_KEYS)
def test_an_address_for_others_needs_names_and_a_token(serve: Make, name: str) -> None:
    with pytest.raises(sp.InvalidArgumentError, match="Other machines can reach"):
        serve(name, host="0.0.0.0")
    case = serve(name, token="token")
    body = json.dumps(case.body)
    assert answered(case, body, headers={"Authorization": "Bearer guess"})[0] == 401
    if not case.headers.get("Authorization"):
        assert answered(case, body, headers={"Authorization": "Bearer token"})[0] == 200


# --- The next server ---------------------------------------------------------------------------------------------

BINDS = re.compile(
    r"uvicorn\.\w+|(.+\.)?(listen|serve_forever|(Threading)?HTTPServer|(TCP|Unix)Server|(start|create|make)_server)"
)
"""Calls by which a program takes an address."""

APPS = ("ASGIApp", "Starlette", "FastAPI")


@pytest.mark.slow
def test_every_server_and_every_application_is_in_the_table() -> None:
    servers, apps = set(), set()
    files = [path for folder in ("smartplay_tools", "adapters", "hub") for path in (ROOT / folder).rglob("*.py")]
    for path in files:
        if path.parent == ROOT / "smartplay_tools" / "web":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert not BINDS.fullmatch(called), f"{path}: {called} takes an address; use smartplay_tools.web.Server"
            elif isinstance(node, ast.ClassDef) and "Server" in map(ast.unparse, node.bases):
                servers.add(node.name)
            elif isinstance(node, ast.FunctionDef) and node.returns and ast.unparse(node.returns) in APPS:
                apps.add(node.name)
    listed = {word for name in SERVERS for word in name.partition(":")[0].split(", ")}
    assert servers | apps == listed
    assert servers
