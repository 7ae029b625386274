"""The window endpoint: agents with messages of their own play under the exact budget, however often they ask."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import httpx2
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from smartplay_gateway import WindowEndpoint, WindowStore, window_app

import smartplay_tools as sp
from smartplay_tools.players import ModelCallError
from smartplay_tools.records import replay
from tests.adapters.conformance import WAY, act, calling
from tests.adapters.window_host import (
    INTERFACES,
    TOOLS,
    WORDS,
    HostAgent,
    client_of,
    play_through,
    scripted,
)

BUDGET = sp.Budget(prompt_tokens=700)
GAME = "Hanoi3Disk-v0"
BY_CLIENT = [pytest.param(name, marks=pytest.mark.slow if name == "messages" else ()) for name in INTERFACES]
"""The interfaces; that of Anthropic's client, which takes seconds to import, is for the slow tests."""


def played(events: list[Any]) -> list[str]:
    """The actions of a record."""
    return [json.loads(event["arguments"])["action"] for event in events if event["event"] == "call"]


def ask(host: HostAgent, **fields: Any) -> httpx2.Response:
    """Send a host's next request with these fields; return whatever comes back."""
    body = host.request(**fields)
    return httpx2.post(f"{host.url}/chat/completions", json=body, trust_env=False, verify=False, timeout=60)


class TestAGame:
    def test_is_won_within_the_window_by_an_agent_that_knows_nothing_of_it(self, endpoint):
        events: list[Any] = []
        with sp.Episode(GAME, seed=7, budget=BUDGET, transcript=events) as episode:
            handle = endpoint.serve(episode)
            last = HostAgent(endpoint, handle).play()
        assert last["content"] == "The game is over."
        assert (episode.result.score, episode.result.steps, episode.result.end_reason) == (3.0, 7, "terminated")
        assert max(event["tokens"] for event in events if event["event"] == "view") <= 700
        assert replay(events).identical

    def test_of_a_run_is_played_at_its_address(self, endpoint, tmp_path):
        def at_an_address(episode: sp.Episode) -> None:
            HostAgent(endpoint, endpoint.serve(episode)).play()

        run = sp.evaluate([GAME], {"mine": at_an_address}, out=tmp_path, trials=1, budgets=BUDGET)
        assert [(row["score"], row["end_reason"]) for row in run.rows] == [(3.0, "terminated")]

    @pytest.mark.parametrize("stream", [False, True])
    @pytest.mark.parametrize("interface", BY_CLIENT)
    def test_is_played_on_where_the_provider_has_cut_replies(self, interface, stream):
        """What a host is sent is whole: the reply that was cut, without a call, was answered with a request for one."""
        player = sp.ScriptedPlayer([calling(say="I will"), *map(calling, map(act, WAY))], sp.Usage(reply=5, cut=1))
        episode = sp.Episode(GAME, seed=7, transcript=(events := []))
        with WindowEndpoint(player) as endpoint, client_of(interface, endpoint) as client, episode:
            model = endpoint.model(handle := endpoint.serve(episode))
            tools = dict(zip(("observe", "act", "read_manual"), endpoint.functions(handle), strict=True))
            play_through(INTERFACES[interface](client, model, stream), tools)
        assert episode.result.score == 3.0
        assert sum(event["provider"]["cut"] for event in events if event["event"] == "usage") == 8

    async def test_has_its_tools_at_the_mcp_address_of_the_same_handle(self, endpoint):
        handle = endpoint.open(GAME, seed=7)
        http = httpx2.AsyncClient(trust_env=False, verify=False)
        async with http, Client(streamable_http_client(endpoint.mcp_url(handle), http_client=http)) as client:
            assert [tool.name for tool in (await client.list_tools()).tools] == ["observe", "act", "read_manual"]
            early = await client.call_tool("act", {"action": "1"})
        assert early.is_error
        assert "no such call" in early.content[0].text
        assert endpoint.store.find(handle).episode.stats.tool_calls == 0

    def test_goes_on_after_a_restart(self, tmp_path):
        with WindowEndpoint(sp.get_player("rule"), folder=tmp_path) as first:
            handle = first.open(GAME, seed=7, budget=BUDGET)
            host = HostAgent(first, handle)
            host.answer(host.post())
            host.answer(lost := host.post())  # its results never arrive
        with WindowEndpoint(sp.get_player("rule"), folder=tmp_path) as endpoint:
            again = HostAgent(endpoint, handle)
            again.messages = host.messages[: host.messages.index(lost)]
            assert again.post()["tool_calls"] == lost["tool_calls"]
            again.messages = host.messages
            again.play()
            result = endpoint.close(handle)
        first.close(handle)  # the file; nothing is read from it any more
        with sp.Episode(GAME, seed=7, budget=BUDGET) as alone:
            assert result == sp.play(alone, sp.get_player("rule"))


class TestRetries:
    def test_a_request_that_is_sent_again_gets_the_recorded_reply(self, endpoint):
        handle = endpoint.open(GAME, seed=7, budget=BUDGET)
        host = HostAgent(endpoint, handle)
        first = host.post()
        assert all(host.post(headers={"x-stainless-retry-count": str(count)}) == first for count in range(3))
        host.answer(first)
        second = host.post()
        assert host.post() == second != first
        assert endpoint.store.find(handle).episode.stats.turns == 2

    def test_a_host_that_loses_the_ids_is_told_so(self, endpoint):
        host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
        for _ in range(21):
            host.post()
        refused = ask(host)
        assert refused.status_code == 400
        assert "ids" in refused.json()["error"]["message"]

    def test_a_new_run_of_the_agent_goes_on_with_the_episode(self, endpoint):
        handle = endpoint.open(GAME, seed=7, budget=BUDGET)
        host = HostAgent(endpoint, handle)
        for _ in range(2):
            host.answer(host.post())
        HostAgent(endpoint, handle).play()
        with sp.Episode(GAME, seed=7, budget=BUDGET) as alone:
            assert endpoint.result(handle) == sp.play(alone, sp.get_player("rule"))


class TestHosts:
    def test_a_run_is_closed_with_the_frameworks_own_tool(self, endpoint):
        parameters = {"type": "object", "properties": {"answer": {"type": "any"}}, "required": ["answer"]}
        final = {"type": "function", "function": {"name": "final_answer", "description": "", "parameters": parameters}}
        handle = endpoint.open(GAME, seed=7, budget=BUDGET)
        host = HostAgent(endpoint, handle, tools=[*TOOLS, final])
        while (message := host.post())["tool_calls"][0]["function"]["name"] != "final_answer":
            host.answer(message)
        (call,) = message["tool_calls"]
        assert json.loads(call["function"]["arguments"]) == {"answer": "The game is over."}
        assert endpoint.result(handle).score == 3.0

    def test_the_hosts_own_messages_are_ignored_and_that_is_told(self, endpoint, caplog):
        handle = endpoint.open(GAME, seed=7)
        host = HostAgent(endpoint, handle)
        answer = ask(host, temperature=0.3)
        ignored = answer.headers["x-smartplay-ignored"]
        assert ignored == "system messages (55 characters), user messages (5 characters), temperature"
        assert endpoint.ignored(handle) == ignored
        assert [record.levelname for record in caplog.records if ignored in record.getMessage()] == ["WARNING"]

    def test_what_a_host_refuses_to_run_is_recorded_as_refused(self):
        endpoint, player = scripted(calling(("observe", {}), act(WAY[0])), calling(act(WAY[0])))
        with endpoint, sp.Episode(GAME, seed=7, transcript=(events := [])) as episode:
            host = HostAgent(endpoint, endpoint.serve(episode))
            message = host.post()
            seen, refused = message["tool_calls"]
            host.messages += [
                message,
                {"role": "tool", "tool_call_id": seen["id"], "content": host.run("observe", {})},
                {"role": "tool", "tool_call_id": refused["id"], "content": "My user said no."},
            ]
            host.post()
        texts = [m["content"] for m in player.prompts[1].messages if m["role"] == "tool"]
        assert texts[1] == "My user said no."
        assert [event.get("host") for event in events if event["event"] == "call"] == [None, "refused"]
        assert episode.result.steps == 0

    def test_a_model_that_fails_ends_the_episode_with_its_cause(self):
        with WindowEndpoint(Failing()) as endpoint:
            handle = endpoint.open(GAME, seed=7)
            host = HostAgent(endpoint, handle)
            for _ in range(2):
                refused = ask(host)
                assert (refused.status_code, refused.headers["x-should-retry"]) == (500, "false")
                assert "no quota" in refused.json()["error"]["message"]
            result = endpoint.result(handle)
        assert (result.end_reason, result.steps, result.tokens.provider.requests) == ("player_error", 0, 5)


class Failing:
    name = "failing"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        raise ModelCallError(sp.Usage(requests=5), RuntimeError("no quota"))


class TestWhoMayComeIn:
    def test_no_handle_is_listed_or_guessed(self, endpoint):
        handle = endpoint.open(GAME, seed=7)
        with httpx2.Client(base_url=endpoint.base_url, trust_env=False, verify=False) as client:
            assert client.get("models").json() == {"object": "list", "data": []}
            assert client.get(f"models/smartplay/{handle}").json()["id"] == f"smartplay/{handle}"
            assert client.get(f"models/smartplay/{'x' * 32}").status_code == 404

    @pytest.mark.parametrize("body", [b"[]", b"{", b'{"model": 1}', b'{"model": "smartplay/no"}', b'{"model": "gpt"}'])
    def test_what_cannot_be_read_is_refused(self, endpoint, body):
        answer = httpx2.post(f"{endpoint.base_url}/chat/completions", content=body, trust_env=False, verify=False)
        assert answer.status_code in (400, 404)


# --- Whatever a host does ----------------------------------------------------------------------------------------

REPLIES = [
    calling(("observe", {})),
    calling(act(WAY[0]), act(WAY[1])),
    calling(act(WAY[2]), ("observe", {}), act(WAY[3])),
    calling(say="Hm."),
    calling(act(WAY[4])),
    calling(act(WAY[5]), act(WAY[6])),
]
EXPECTED = [act(way)[1]["action"] for way in WAY]


@settings(
    max_examples=settings().max_examples // 3,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
async def test_nothing_is_played_or_charged_twice_whatever_is_sent_again_late_or_cancelled(data):
    """Requests are repeated, cancelled and sent at once; calls are repeated and run in any order."""
    player, events = Counting(REPLIES), []
    episode = sp.Episode(GAME, seed=7, transcript=events)
    store = WindowStore(player)
    handle = store.serve(episode)
    transport = httpx2.ASGITransport(app=window_app(store))
    window = store.find(handle)
    async with httpx2.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        messages: list[Any] = list(WORDS)

        async def ask() -> Any:
            body = {"model": f"smartplay/{handle}", "messages": list(messages), "tools": TOOLS}
            answer = await client.post("/v1/chat/completions", json=body)
            assert answer.status_code == 200, answer.text
            return answer.json()["choices"][0]["message"]

        while True:
            # Nothing is drawn while a request is under way: a draw may end the example.
            for moment in data.draw(st.lists(st.sampled_from([0, 0, 0.001]), max_size=2), "before each is cancelled"):
                asking = asyncio.create_task(ask())
                await asyncio.sleep(moment)
                asking.cancel()
                await asyncio.wait([asking])
            copies = await asyncio.gather(*(ask() for _ in range(data.draw(st.integers(1, 3), "requests at once"))))
            message = copies[0]
            assert all(copy == message for copy in copies)
            if not (calls := message.get("tool_calls", ())):
                break
            ways = data.draw(st.permutations([*calls, *data.draw(st.lists(st.sampled_from(calls), max_size=3))]))
            texts: dict[str, str] = {}
            for call in ways:
                function = call["function"]
                result = await window.call(function["name"], json.loads(function["arguments"]))
                assert texts.setdefault(call["id"], result.text) == result.text
            messages.append(message)
            messages += [{"role": "tool", "tool_call_id": call["id"], "content": texts[call["id"]]} for call in calls]
    assert played([event for event in events if event.get("name") == "act"]) == EXPECTED
    assert player.asked == len(REPLIES) == episode.result.turns
    with sp.Episode(GAME, seed=7) as alone:
        assert episode.result == sp.play(alone, sp.ScriptedPlayer(REPLIES)).model_copy()


class Counting:
    """A player whose replies take a moment."""

    name = "scripted"

    def __init__(self, replies: list[sp.Message]) -> None:
        self._replies, self.asked = replies, 0

    async def areply(self, prompt: sp.Prompt) -> sp.Reply:
        self.asked += 1
        reply = self._replies[self.asked - 1]
        await asyncio.sleep(0.0005)
        return sp.Reply(reply)
