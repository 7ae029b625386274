"""All players that call a model: they wait as the server asks, count requests, and limit their attempts.

One server has all three interfaces. It refuses every question the first time, and counts requests.
"""

from __future__ import annotations

import asyncio
import json
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import pytest
from smartplay_gateway import LocalEndpoint
from smartplay_openai import OpenAIPlayer, ResponsesPlayer

import smartplay_tools as sp
from smartplay_tools.players import ModelCallError, ModelPlayer
from smartplay_tools.types.messages import text_of

PAUSE = 0.15
"""Seconds that the server asks to wait."""

SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("anthropic", "openai-responses")]
PLAYERS = ["openai", pytest.param("langchain", marks=pytest.mark.slow), *SLOW]


class Busy:
    """A server that echoes questions, but refuses each one `refusals` times."""

    def __init__(self, refusals: int = 1, status: int = 429, seconds: float = 0.0) -> None:
        self.refusals, self.status, self.seconds = refusals, status, seconds
        self.asked: dict[str, list[float]] = {}
        """When each question came."""
        self.under_way = self.most = 0

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        body = b""
        while (part := await receive()).get("more_body") or part["body"]:
            body += part["body"]
            if not part["more_body"]:
                break
        status, answer = await self.answer(scope["path"], json.loads(body))
        headers = [(b"content-type", b"application/json"), (b"retry-after", str(PAUSE).encode())]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": json.dumps(answer).encode()})

    async def answer(self, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        """Answer in the interface that the path names, its last message being the question."""
        (last,) = [*(body.get("messages") or body["input"])][-1:]
        content = last["content"]
        question = content if isinstance(content, str) else content[0]["text"]
        if await self.refuses(question):
            return self.status, {"type": "error", "error": {"type": "error", "message": "Busy."}}
        match path.rsplit("/", 1)[-1]:
            case "completions":
                usage = {"prompt_tokens": 7, "completion_tokens": 2}
                return 200, {"choices": [{"message": {"role": "assistant", "content": question}}], "usage": usage}
            case "responses":
                item = {"type": "message", "role": "assistant", "content": [{"type": "output_text", "text": question}]}
                return 200, {"status": "completed", "output": [item], "usage": {"input_tokens": 7, "output_tokens": 2}}
        return 200, {
            "content": [{"type": "text", "text": question}],
            "usage": {"input_tokens": 7, "output_tokens": 2},
        }

    async def refuses(self, question: str) -> bool:
        """Count a question; return whether it is to be refused."""
        times = self.asked.setdefault(question, [])
        times.append(time.monotonic())
        self.under_way += 1
        self.most = max(self.most, self.under_way)
        try:
            await asyncio.sleep(self.seconds)
        finally:
            self.under_way -= 1
        return len(times) <= self.refusals

    @property
    def waits(self) -> list[float]:
        """The seconds between a refusal and the next attempt."""
        return [later - earlier for times in self.asked.values() for earlier, later in pairwise(times)]


def player_for(name: str, server: Busy, url: str, **options: Any) -> ModelPlayer:
    match name:
        case "anthropic":
            return sp.get_player("anthropic:m", base_url=url.removesuffix("/v1"), **options)
        case "langchain":
            from tests.adapters.test_langchain_player import BusyModel, LangChainPlayer

            return LangChainPlayer(BusyModel(server=server), **options)
    kind = OpenAIPlayer if name == "openai" else ResponsesPlayer
    # Handed over whole: the client's check of typed arguments would be what is measured with hundreds at once.
    return kind("m", base_url=url, typed=False, **options)


def question(number: int) -> sp.Prompt:
    return sp.Prompt([{"role": "user", "content": f"What is {number}?"}], ())


def check(replies: list[sp.Reply], requests: int) -> None:
    for number, reply in enumerate(replies):
        assert text_of(reply.message) == f"What is {number}?"
        assert reply.usage == sp.Usage(prompt=7, reply=2, requests=requests)


@pytest.mark.parametrize("many", [30, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PLAYERS)
async def test_many_at_once_on_one_event_loop_wait_as_they_are_asked_to(name, many):
    server = Busy()
    with LocalEndpoint(app=server) as endpoint:
        async with player_for(name, server, endpoint.base_url) as player:
            replies = await asyncio.gather(*(player.areply(question(number)) for number in range(many)))
    check(replies, requests=2)
    assert len(server.asked) == many
    assert len(server.waits) == many
    assert min(server.waits) >= PAUSE


@pytest.mark.parametrize("name", PLAYERS)
async def test_no_more_requests_are_under_way_than_may_be(name):
    server = Busy(status=503, seconds=0.05)
    with LocalEndpoint(app=server) as endpoint:
        async with player_for(name, server, endpoint.base_url, at_once=4) as player:
            replies = await asyncio.gather(*(player.areply(question(number)) for number in range(20)))
            # A player that waits for its next attempt does not block the others.
            assert server.most == 4
            check(replies, requests=2)


@pytest.mark.parametrize("name", PLAYERS)
def test_the_same_in_threads(name):
    server = Busy(status=500, seconds=0.05)
    with (
        LocalEndpoint(app=server) as endpoint,
        player_for(name, server, endpoint.base_url, at_once=3) as player,
        ThreadPoolExecutor(12) as pool,
    ):
        replies = list(pool.map(lambda number: player.reply(question(number)), range(9)))
    check(replies, requests=2)
    assert server.most == 3


@pytest.mark.parametrize("name", PLAYERS)
@pytest.mark.parametrize(("status", "attempts"), [(529, 3), (401, 1)])
def test_what_never_came_is_counted_too(name, status, attempts):
    server = Busy(refusals=9, status=status)
    with (
        LocalEndpoint(app=server) as endpoint,
        player_for(name, server, endpoint.base_url, retries=2) as player,
        sp.Episode("Hanoi3Disk-v0", seed=7) as episode,
    ):
        result = sp.play(episode, player)
    assert result.end_reason == "player_error"
    assert f"in {attempts} attempt" in result.error
    assert result.tokens.provider.requests == attempts == sum(map(len, server.asked.values()))


@pytest.mark.parametrize("name", ["openai", *SLOW])
async def test_a_server_that_is_not_there_is_asked_as_often(name):
    server = Busy()
    with LocalEndpoint(app=server) as endpoint:
        gone = endpoint.base_url
    async with player_for(name, server, gone, retries=2, pause=0.01) as player:
        with pytest.raises(ModelCallError, match="in 3 attempts: APIConnectionError") as raised:
            await player.areply(question(1))
    assert raised.value.usage.requests == 3


@pytest.mark.parametrize("name", PLAYERS)
def test_one_player_serves_one_event_loop_after_another(name):
    server = Busy(refusals=0)

    async def ask(player: ModelPlayer, number: int) -> sp.Reply:
        async with player:
            return await player.areply(question(number))

    with LocalEndpoint(app=server) as endpoint:
        player = player_for(name, server, endpoint.base_url, at_once=1)
        check([asyncio.run(ask(player, number)) for number in range(3)], requests=1)


@pytest.mark.parametrize("name", PLAYERS)
def test_a_player_without_a_model_is_one_sentence(name):
    with pytest.raises(sp.InvalidArgumentError, match=f"{name}:MODEL"):
        sp.get_player(name)


def test_a_limit_under_which_nobody_is_asked_is_refused():
    with pytest.raises(sp.InvalidArgumentError, match="at_once must be at least 1"):
        sp.get_player("openai:m", base_url="http://127.0.0.1:9/v1", at_once=0)
