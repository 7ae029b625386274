"""Streams of both endpoints: they begin at once, show signs of life while a model thinks, and tell of failures."""

from __future__ import annotations

import asyncio
import gc
import importlib
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx2
import pytest
from smartplay_gateway import LocalEndpoint, WindowEndpoint, endpoint as app

import smartplay_tools as sp
from tests.adapters.conformance import WAY, act, calling
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.window_host import INTERFACES, TOOLS, client_of, for_messages
from tests.processes import is_soon

GAME = "Hanoi3Disk-v0"
PATHS = {"chat": "chat/completions", "responses": "responses", "messages": "messages"}
ALIVE = {"chat": ": the model", "responses": ": the model", "messages": "event: ping"}
CASES = [
    (WindowEndpoint, "chat"),
    (LocalEndpoint, "responses"),
    pytest.param(WindowEndpoint, "responses", marks=pytest.mark.slow),
    pytest.param(WindowEndpoint, "messages", marks=pytest.mark.slow),
    pytest.param(LocalEndpoint, "chat", marks=pytest.mark.slow),
]


class Thinking:
    """A player that thinks until it may answer, and then replies or fails."""

    name = "thinking"

    def __init__(self, error: Exception | None = None, *, says: sp.Message | None = None) -> None:
        self.error, self.asked, self.may_answer = error, 0, threading.Event()
        self.says = says or calling(act(WAY[0]))

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        self.asked += 1
        assert self.may_answer.wait(30)
        if self.error is not None:
            raise self.error
        return sp.Reply(self.says)


def body_of(interface: str, model: str, **fields: Any) -> dict[str, Any]:
    """A request for a stream."""
    messages = [{"role": "user", "content": "Play."}]
    if interface == "responses":
        tools = [{"type": "function", **tool["function"]} for tool in TOOLS]
        return {"model": model, "input": messages, "tools": tools, **fields}
    if interface == "messages":
        return {"model": model, "messages": messages, "tools": for_messages(TOOLS), "max_tokens": 99, **fields}
    return {"model": model, "messages": messages, "tools": TOOLS, **fields}


@contextmanager
def serving(kind: Any, player: Any) -> Iterator[tuple[Any, str]]:
    """An endpoint with the player, and the name of the model there."""
    with kind(player) as endpoint:
        if kind is LocalEndpoint:
            yield endpoint, player.name
        else:
            yield endpoint, endpoint.model(endpoint.open(GAME, seed=7))


@pytest.mark.parametrize(("kind", "interface"), CASES)
def test_the_head_comes_at_once_and_signs_of_life_follow(kind, interface, monkeypatch):
    monkeypatch.setattr(app, "SILENCE", 0.05)
    with serving(kind, player := Thinking()) as (endpoint, model):
        body = body_of(interface, model, stream=True)
        url = f"{endpoint.base_url}/{PATHS[interface]}"
        with httpx2.stream("POST", url, json=body, trust_env=False, verify=False, timeout=30) as answer:
            assert answer.status_code == 200
            assert answer.headers["content-type"].startswith("text/event-stream")
            lines = answer.iter_lines()
            begin = [next(lines) for _ in range(9)]
            assert len([line for line in begin if line.startswith(ALIVE[interface])]) >= 3
            player.may_answer.set()
            text = "\n".join(lines)
    assert "act" in text
    assert player.asked == 1


def test_the_pauses_are_short_enough_for_every_proxy():
    assert app.HEAD_AFTER + app.SILENCE < 10


@pytest.mark.parametrize(("kind", "interface"), CASES)
def test_a_failure_after_the_head_is_told_as_the_interface_tells_it(kind, interface):
    player = Thinking(RuntimeError("no quota"))
    threading.Timer(0.5, player.may_answer.set).start()
    errors = importlib.import_module("anthropic" if interface == "messages" else "openai").APIError
    with serving(kind, player) as (endpoint, model), client_of(interface, endpoint) as client:
        client.max_retries = 0
        creates = {"chat": lambda: client.chat.completions, "responses": lambda: client.responses}
        resource = creates.get(interface, lambda: client.messages)()
        with pytest.raises(errors, match="no quota"):
            list(resource.create(**body_of(interface, model, stream=True)))


@pytest.mark.parametrize(("kind", "interface"), CASES)
def test_a_failure_before_the_head_has_a_status(kind, interface, monkeypatch):
    monkeypatch.setattr(app, "HEAD_AFTER", 20)
    player = Thinking(RuntimeError("no quota"))
    player.may_answer.set()
    with serving(kind, player) as (endpoint, model):
        url = f"{endpoint.base_url}/{PATHS[interface]}"
        body = body_of(interface, model, stream=True)
        answer = httpx2.post(url, json=body, trust_env=False, verify=False, timeout=30)
    assert (answer.status_code, "no quota" in answer.text) == (500, True)


class Waiting:
    """A player that can be told to stop, as one that asks a model over a connection."""

    name = "waiting"

    def __init__(self) -> None:
        self.asked, self.stopped = threading.Event(), threading.Event()

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        self.asked.set()
        try:
            await asyncio.sleep(30)
        except asyncio.CancelledError:
            self.stopped.set()
            raise
        raise AssertionError


@pytest.mark.parametrize("stream", [True, False])
def test_a_client_that_leaves_ends_its_request(stream):
    with serving(LocalEndpoint, player := Waiting()) as (endpoint, model):
        body = body_of("chat", model, stream=stream)
        url = f"{endpoint.base_url}/chat/completions"
        with pytest.raises(httpx2.TimeoutException):
            httpx2.post(url, json=body, trust_env=False, verify=False, timeout=1)
        assert player.asked.is_set()
        assert player.stopped.wait(10)


@pytest.mark.parametrize("stream", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "interface", [pytest.param(name, marks=() if name == "chat" else pytest.mark.slow) for name in INTERFACES]
)
def test_a_client_that_leaves_the_window_stops_the_questions(interface, stream):
    """The reply under way is taken; the next request continues after it, and its usage has both."""
    player = Thinking(says=calling(say="Hm."))
    with serving(WindowEndpoint, player) as (endpoint, model):
        stats = endpoint.store.find(model.partition("/")[2]).episode.stats
        url = f"{endpoint.base_url}/{PATHS[interface]}"
        options = {"trust_env": False, "verify": False, "timeout": 30 if stream else 2}
        body = body_of(interface, model, stream=stream)
        if stream:
            with httpx2.stream("POST", url, json=body, **options) as answer:
                next(answer.iter_lines())
                assert is_soon(lambda: player.asked == 1)
        else:
            with pytest.raises(httpx2.TimeoutException):
                httpx2.post(url, json=body, **options)
        time.sleep(0.3)  # the server notices
        player.may_answer.set()
        assert is_soon(lambda: stats.idle_replies == 1)
        time.sleep(0.3)
        assert player.asked == 1
        player.says = calling(act(WAY[0]))
        usage = httpx2.post(url, json=body_of(interface, model), **options).json()["usage"]
        assert player.asked == 2
        assert stats.tokens.prompt in usage.values()


def test_a_server_that_stops_closes_the_connections_of_its_player():
    with OpenAIStub([calling(act(WAY[0]))]) as stub, warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", ResourceWarning)
        player = sp.get_player("openai:m", base_url=stub.base_url)
        with LocalEndpoint(player) as endpoint, sp.Episode(GAME, seed=0) as episode:
            host = sp.get_player(f"openai:{player.name}", base_url=endpoint.base_url)
            prompt = sp.Conversation(episode).prompt()
            assert prompt is not None
            host.reply(prompt)
            host.close()
        del player, endpoint, host
        gc.collect()
    assert not [str(each.message) for each in seen if issubclass(each.category, ResourceWarning)]
