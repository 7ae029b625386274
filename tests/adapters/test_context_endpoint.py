"""The context endpoint between real clients and a server that keeps what it is sent, byte for byte."""

from __future__ import annotations

import gzip
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import anthropic
import httpx2
import openai
import pytest
from smartplay_gateway import ContextEndpoint

import smartplay_tools as sp
from smartplay_tools.manager.record import read_thread
from tests.manager.histories import FORMS
from tests.manager.test_fit import steps

CAP = 1_000
CHAT = {
    "id": "a",
    "object": "chat.completion",
    "created": 0,
    "model": "m",
    "choices": [{"index": 0, "finish_reason": "stop", "message": {"role": "assistant", "content": "Dönè."}}],
}
CHUNK = {**CHAT, "object": "chat.completion.chunk", "choices": [{"index": 0, "delta": {"content": "Dönè."}}]}
RESPONSE = {
    "id": "r",
    "object": "response",
    "created_at": 0,
    "model": "m",
    "status": "completed",
    "output": [],
    "parallel_tool_calls": True,
    "tool_choice": "auto",
    "tools": [],
}
MESSAGE = {
    "id": "m",
    "type": "message",
    "role": "assistant",
    "model": "m",
    "content": [{"type": "text", "text": "Done."}],
    "stop_reason": "end_turn",
    "stop_sequence": None,
    "usage": {"input_tokens": 1, "output_tokens": 1},
}
ANSWERS = {"/v1/chat/completions": CHAT, "/v1/responses": RESPONSE, "/v1/messages": MESSAGE}


JSON, STREAM = {"content-type": "application/json"}, {"content-type": "text/event-stream; charset=utf-8"}


def usual(path: str, body: bytes) -> tuple[bytes, dict[str, str]]:
    """An answer and its headers."""
    if b'"stream":true' in body.replace(b" ", b""):
        return f"data: {json.dumps(CHUNK)}\n\ndata: [DONE]\n\n".encode(), STREAM
    return json.dumps(ANSWERS.get(path, {"path": path}), indent=3, ensure_ascii=False).encode(), JSON


class Upstream:
    """A server that keeps requests as they come, and answers with whitespace and headers that nobody else writes."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, str, dict[str, str], bytes]] = []
        self.given: tuple[bytes, dict[str, str]] | None = None
        """An answer and its headers, in place of the usual ones."""
        self.script: list[tuple[bytes, dict[str, str]]] = []
        """Answers for the next requests, one each."""
        self.may_answer = threading.Event()
        self.may_answer.set()
        upstream = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers.get("content-length", 0)))
                upstream.requests.append((self.command, self.path, dict(self.headers.items()), body))
                assert upstream.may_answer.wait(30)
                upstream.given = upstream.script.pop(0) if upstream.script else upstream.given
                content, headers = upstream.given or usual(self.path, body)
                self.send_response(200 if self.path.startswith("/v1/") else 404)
                for name, value in {"X-Own": "kept", **headers, "transfer-encoding": "chunked"}.items():
                    self.send_header(name, value)
                self.end_headers()
                size = 7 if upstream.given else len(content)  # no event and no character of a given one comes whole
                for at in range(0, len(content), size):
                    piece = content[at : at + size]
                    self.wfile.write(b"%x\r\n%b\r\n" % (len(piece), piece))
                self.wfile.write(b"0\r\n\r\n")

            def do_GET(self) -> None:
                self.do_POST()

            def do_DELETE(self) -> None:
                self.do_POST()

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def body(self) -> dict[str, Any]:
        """The body of the latest request."""
        read: dict[str, Any] = json.loads(self.requests[-1][3])
        return read


@pytest.fixture
def endpoint(upstream: Upstream) -> Iterator[ContextEndpoint]:
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(CAP)) as endpoint:
        yield endpoint


def send(endpoint: ContextEndpoint, form: str, messages: Any, **more: Any) -> Any:
    """Send messages with the client of a form."""
    if form == "anthropic":
        client = anthropic.Anthropic(base_url=endpoint.url, api_key="k", max_retries=0)
        system = messages[0]["content"]
        return client.messages.create(model="m", max_tokens=9, system=system, messages=messages[1:], **more)
    client = openai.OpenAI(base_url=endpoint.base_url, api_key="k", max_retries=0)
    if form == "responses":
        return client.responses.create(model="m", input=messages, store=False, **more)
    return client.chat.completions.create(model="m", messages=messages, **more)


FIELDS = {"chat": "messages", "responses": "input", "anthropic": "messages"}


@pytest.mark.parametrize("form", FORMS)
def test_every_client_is_held_to_the_cap(endpoint: ContextEndpoint, upstream: Upstream, form: str):
    messages = FORMS[form](steps(60))
    send(endpoint, form, messages)
    sent, system = upstream.body[FIELDS[form]], upstream.body.get("system")
    counted = sp.ContextManager(None).fit(sent, system=system, form=form)
    assert counted.tokens <= CAP
    assert 10 < len(sent) < len(messages) - 20
    assert sent[-1] == messages[-1]


@pytest.mark.parametrize("form", FORMS)
def test_what_fits_passes_byte_for_byte(endpoint: ContextEndpoint, upstream: Upstream, form: str):
    path = {"chat": "/v1/chat/completions", "responses": "/v1/responses", "anthropic": "/v1/messages"}[form]
    body = {"model": "m", "extra": {"ü": 1.0}, FIELDS[form]: FORMS[form](steps(3))[form == "anthropic" :]}
    sent = json.dumps(body, indent=5, ensure_ascii=False).encode()
    headers = {"authorization": "Bearer k", "x-own": "1", "content-type": "application/json"}
    answer = httpx2.post(endpoint.url + path + "?beta=true", content=sent, headers=headers)
    method, target, given, content = upstream.requests[-1]
    assert (method, target, content) == ("POST", path + "?beta=true", sent)
    lower = {name.lower(): value for name, value in given.items()}
    assert (lower["authorization"], lower["x-own"]) == ("Bearer k", "1")
    assert "x-forwarded-for" not in lower
    assert answer.headers["x-own"] == "kept"


def test_answers_and_streams_pass_byte_for_byte(endpoint: ContextEndpoint, upstream: Upstream):
    body = {"model": "m", "messages": steps(60)}
    answer = httpx2.post(f"{endpoint.base_url}/chat/completions", json=body)
    assert answer.content == json.dumps(CHAT, indent=3, ensure_ascii=False).encode()
    streamed = httpx2.post(f"{endpoint.base_url}/chat/completions", json={**body, "stream": True})
    assert streamed.content == f"data: {json.dumps(CHUNK)}\n\ndata: [DONE]\n\n".encode()
    pieces = send(endpoint, "chat", steps(60), stream=True)
    assert [piece.choices[0].delta.content for piece in pieces] == ["Dönè."]


def events(*datas: Any) -> bytes:
    """A stream of events, the line ends and names of which differ as those of servers do."""
    named = [f"event: {data['type']}\n" if "type" in data else "" for data in datas]
    lines = [f"{name}data: {json.dumps(data)}\r\n\r\n" for name, data in zip(named, datas, strict=True)]
    return "".join([": ping\n\n", *lines, "data: [DONE]\n\n"]).encode()


CACHED = {"input_tokens": 4, "cache_read_input_tokens": 900, "cache_creation_input_tokens": 350, "output_tokens": 1}
STARTED = {"type": "message_start", "message": {**MESSAGE, "usage": CACHED}}
LATER = {"type": "message_delta", "delta": {}, "usage": {"input_tokens": 9_999, "output_tokens": 5}}
RESPONDED = {**RESPONSE, "usage": {"input_tokens": 1_254, "output_tokens": 1}}
SILENT = {"type": "response.created", "response": {**RESPONSE, "usage": None}}
CHAT_USAGE = {"prompt_tokens": 1_254, "completion_tokens": 3}
WHOLE = json.dumps({**CHAT, "usage": CHAT_USAGE}, indent=2, ensure_ascii=False).encode()
REPORTS: list[tuple[str, bytes, dict[str, str], int | None]] = [
    ("chat", WHOLE, JSON, 1_254),
    ("chat", events({**CHUNK, "usage": None}, {**CHUNK, "choices": [], "usage": CHAT_USAGE}), STREAM, 1_254),
    ("responses", json.dumps(RESPONDED).encode(), JSON, 1_254),
    ("responses", events(SILENT, {"type": "response.completed", "response": RESPONDED}), STREAM, 1_254),
    ("anthropic", json.dumps({**MESSAGE, "usage": CACHED}).encode(), JSON, 1_254),
    ("anthropic", events(STARTED, LATER), STREAM, 1_254),
    ("chat", gzip.compress(WHOLE), {**JSON, "content-encoding": "gzip"}, 1_254),
    ("anthropic", gzip.compress(events(STARTED)), {**STREAM, "content-encoding": "gzip"}, 1_254),
    ("chat", b"brotli, or nothing", {**JSON, "content-encoding": "br"}, None),
    ("chat", WHOLE, {**JSON, "content-encoding": "gzip"}, None),
    ("chat", json.dumps({**CHAT, "usage": {"prompt_tokens": "many"}}).encode(), JSON, None),
    ("chat", b'{"usage": {"prompt_tokens": 12', JSON, None),
]
PATHS = {"chat": "/chat/completions", "responses": "/responses", "anthropic": "/messages"}


@pytest.mark.parametrize(("form", "content", "headers", "counted"), REPORTS)
def test_what_a_provider_counts_is_recorded_from_bytes_that_pass_as_they_are(
    upstream: Upstream, tmp_path: Path, form: str, content: bytes, headers: dict[str, str], counted: int | None
):
    upstream.given = content, headers
    secrets = {"authorization": "Bearer sk-secret", "x-api-key": "sk-secret", "x-own": "secret-header"}
    body = {"model": "secret-model", "user": "secret-user", FIELDS[form]: FORMS[form](steps(60))[form == "anthropic" :]}
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(CAP, record=tmp_path)) as endpoint:
        address = f"{endpoint.base_url}{PATHS[form]}?key=secret-key"
        with httpx2.stream("POST", address, json=body, headers=secrets) as answer:
            assert b"".join(answer.iter_raw()) == content
    (file,) = tmp_path.iterdir()
    assert "secret" not in file.read_text()
    (prompt,) = read_thread(file).prompts
    assert list(prompt.messages) == upstream.body[FIELDS[form]]
    assert prompt.reported == counted
    assert prompt.is_over == (counted is not None)


def test_a_tool_that_a_provider_runs_is_recorded_without_its_keys(endpoint: ContextEndpoint, tmp_path: Path):
    tool = {
        "type": "mcp",
        "server_label": "files",
        "server_url": "https://example.org?key=secret",
        "headers": {"a": "secret"},
    }
    manager = sp.ContextManager(CAP, record=tmp_path, extra_tokens=20)
    manager.fit([{"role": "user", "content": "Go on."}], tools=[{**tool, "authorization": "secret"}], form="responses")
    (file,) = tmp_path.iterdir()
    assert "secret" not in file.read_text()
    assert read_thread(file).prompts[0].beside == {"tools": [{"type": "mcp", "server_label": "files"}]}


def test_a_prompt_that_cannot_be_recorded_is_not_sent(upstream: Upstream, tmp_path: Path):
    manager = sp.ContextManager(CAP, record=tmp_path)
    with ContextEndpoint(f"{upstream.url}/v1", manager) as endpoint:
        httpx2.post(f"{endpoint.base_url}/chat/completions", json={"messages": steps(2)})
        (file,) = tmp_path.iterdir()
        file.write_text(file.read_text() + "\n")
        answer = httpx2.post(f"{endpoint.base_url}/chat/completions", json={"messages": steps(3)})
    assert answer.status_code == 500
    assert answer.headers["x-should-retry"] == "true"
    assert "written by another program" in answer.json()["error"]["message"]
    assert len(upstream.requests) == 1


def test_a_client_may_try_again_where_a_summary_could_not_be_asked_for_and_a_bug_is_no_fault_of_its_own(
    upstream: Upstream,
):
    def ask(*_: Any) -> str:
        raise ConnectionError("the server of summaries restarts")

    for manager in (
        sp.ContextManager(CAP, slack=0.5, strategy=sp.Summaries(40), ask=ask),
        sp.ContextManager(CAP, strategy=lambda history, room: history.nothing),
    ):
        with ContextEndpoint(f"{upstream.url}/v1", manager) as endpoint:
            answer = httpx2.post(f"{endpoint.base_url}/chat/completions", json={"messages": steps(40)})
        assert (answer.status_code, answer.headers["x-should-retry"]) == (500, "true")


@pytest.mark.parametrize("path", ["/v1/models", "/v1/files/a%2Fb", "/v1/embeddings"])
def test_other_requests_pass(endpoint: ContextEndpoint, upstream: Upstream, path: str):
    assert httpx2.get(endpoint.url + path).json() == {"path": path}
    httpx2.delete(endpoint.url + path)
    assert [(method, target) for method, target, *_ in upstream.requests] == [("GET", path), ("DELETE", path)]


@pytest.mark.parametrize("form", FORMS)
def test_a_prompt_that_cannot_fit_is_the_provider_s_own_error(endpoint: ContextEndpoint, upstream: Upstream, form: str):
    messages = FORMS[form]([*steps(0), {"role": "user", "content": "word " * 2_000}])
    with pytest.raises((openai.BadRequestError, anthropic.BadRequestError)) as refused:
        send(endpoint, form, messages)
    assert "head 2,0" in str(refused.value)
    if isinstance(refused.value, openai.BadRequestError):
        assert refused.value.code == "context_length_exceeded"
    else:
        assert "prompt is too long" in str(refused.value)
    assert not upstream.requests


def test_what_a_server_keeps_is_refused(endpoint: ContextEndpoint, upstream: Upstream):
    with pytest.raises(openai.BadRequestError, match="previous_response_id"):
        send(endpoint, "responses", "Go on.", previous_response_id="r")
    with pytest.raises(openai.BadRequestError, match="extra_tokens"):
        send(endpoint, "responses", "Go on.", tools=[{"type": "web_search"}])
    assert not upstream.requests


def test_tools_and_schemas_count(endpoint: ContextEndpoint):
    function = {"name": "read", "description": "word " * 2_000, "parameters": {"type": "object", "properties": {}}}
    with pytest.raises(openai.BadRequestError, match=r"tools 2,0\d\d"):
        send(endpoint, "chat", steps(3), tools=[{"type": "function", "function": function}])


def test_a_body_that_is_no_prompt_is_the_upstream_s_to_refuse(endpoint: ContextEndpoint, upstream: Upstream):
    for content in (b"no json", b'{"messages": 3}', b"[]"):
        httpx2.post(f"{endpoint.base_url}/chat/completions", content=content)
        assert upstream.requests[-1][3] == content


def test_an_upstream_that_does_not_answer_is_named():
    with ContextEndpoint("http://127.0.0.1:9/v1", sp.ContextManager(CAP)) as endpoint:
        answer = httpx2.post(f"{endpoint.base_url}/chat/completions", json={"messages": steps(1)})
    assert answer.status_code == 502
    assert "127.0.0.1:9 does not answer" in answer.json()["error"]["message"]


@pytest.mark.parametrize(("upstream_url", "sentence"), [("localhost:11434/v1", "with its scheme"), ("", "no base URL")])
def test_the_upstream_is_an_address_with_its_scheme(upstream_url: str, sentence: str):
    with pytest.raises(sp.InvalidArgumentError, match=sentence):
        ContextEndpoint(upstream_url, sp.ContextManager(CAP))


def test_it_listens_on_this_machine_only():
    with pytest.raises(sp.InvalidArgumentError, match=r"Other machines can reach 0\.0\.0\.0"):
        ContextEndpoint("http://127.0.0.1:9", sp.ContextManager(CAP), host="0.0.0.0")


def test_the_command_holds_a_client_to_its_budget_and_says_what_left(upstream: Upstream):
    command = [sys.executable, "-m", "smartplay_tools", "serve", "window", "--upstream", f"{upstream.url}/v1"]
    command += ["--prompt-tokens", "1000", "--slack", "0.5", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "COLUMNS": "200"}) as served:
        assert served.stdout
        try:
            url = served.stdout.readline().split()[1]
            client = openai.OpenAI(base_url=url, api_key="k", max_retries=0)
            client.chat.completions.create(model="m", messages=steps(60))
            assert re.match(r"/v1/chat/completions  \d+ tokens; messages: \d+ dropped", served.stdout.readline())
        finally:
            served.terminate()
    assert len(upstream.body["messages"]) < 100


def test_the_budget_of_a_command_has_the_fields_that_mean_something_without_a_game():
    manager = sp.ContextManager.of(sp.Budget(prompt_tokens=300, slack=0.25))
    assert manager.fit(steps(60)).tokens <= 300
    with pytest.raises(sp.InvalidArgumentError, match="notes_tokens has no meaning without a game"):
        sp.ContextManager.of(sp.Budget(prompt_tokens=300, notes_tokens=20))
