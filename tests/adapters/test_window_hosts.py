"""What agents of others send to the window endpoint: histories that no provider takes, side requests, sub-agents.

Each of these has ended a game, misled a model or misinformed a host.
"""

from __future__ import annotations

import json
from typing import Any

import httpx2
import pytest
from smartplay_gateway import WindowEndpoint

import smartplay_tools as sp
from smartplay_tools.records import replay
from tests.adapters.conformance import WAY, act, calling
from tests.adapters.test_window_endpoint import BY_CLIENT
from tests.adapters.window_host import INTERFACES, TOOLS, HostAgent, client_of, scripted

BUDGET = sp.Budget(prompt_tokens=700)
GAME = "Hanoi3Disk-v0"
FLAT = [{"type": "function", **tool["function"]} for tool in TOOLS]
PICTURE = {"type": "image_url", "image_url": {"url": "data:image/png;base64,AAAA"}}


def other(name: str, **parameters: Any) -> dict[str, Any]:
    schema = {"type": "object", "properties": parameters}
    return {"type": "function", "function": {"name": name, "description": f"The tool {name}.", "parameters": schema}}


WEATHER = other("weather", city={"type": "string"}, unit=True)


def post(endpoint: WindowEndpoint, path: str, body: dict[str, Any], **headers: str) -> Any:
    answer = httpx2.post(
        f"{endpoint.base_url}/{path}", json=body, headers=headers, trust_env=False, verify=False, timeout=60
    )
    assert answer.status_code == 200, answer.text
    return answer


class TestToolsOfTheAgentItself:
    def test_they_can_be_hidden_from_the_model_and_that_is_told(self):
        endpoint, player = scripted(calling(act(WAY[0])), only_game_tools=True)
        with endpoint:
            host = HostAgent(endpoint, endpoint.open(GAME, seed=7, budget=BUDGET), tools=[*TOOLS, WEATHER])
            answer = post(endpoint, "chat/completions", host.request())
        assert "the tools weather" in answer.headers["x-smartplay-ignored"]
        assert [tool.name for tool in player.prompts[0].tools] == ["observe", "act", "read_manual"]


class TestMessages:
    @pytest.mark.parametrize("field", ["", "two\r\nlines", "\0", " ", *("x" * length + " y" for length in (3, 4, 5))])
    def test_what_is_ignored_fits_a_header_whatever_it_is_named(self, endpoint, field):
        host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
        first = post(endpoint, "chat/completions", {**host.request(), field: 1})
        assert first.headers["x-smartplay-ignored"].startswith("system messages")
        many = {f"{number} {field}": 1 for number in range(2_000)}
        long = post(endpoint, "chat/completions", {**host.request(), **many})
        assert 3_990 < len(long.headers["x-smartplay-ignored"]) <= 4_000

    def test_the_agents_instructions_can_be_shown_and_are_counted(self):
        endpoint, player = scripted(calling(act(WAY[0])), show_system=True)
        with endpoint, sp.Episode(GAME, seed=7, budget=BUDGET, transcript=(events := [])) as episode:
            host = HostAgent(endpoint, endpoint.serve(episode))
            answer = post(endpoint, "chat/completions", host.request())
        shown = [message["content"] for message in player.prompts[0].messages if message["role"] == "system"]
        assert shown[1:] == ["You are a helpful agent with a long prompt of your own."]
        assert answer.headers["x-smartplay-ignored"] == "user messages (5 characters)"
        (view,) = [event for event in events if event["event"] == "view"]
        assert view["tokens"] == episode.counter.prompt(player.prompts[0].messages, player.prompts[0].tools)
        assert replay(events).identical

    def test_what_is_ignored_is_not_checked(self, endpoint):
        host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
        host.messages += [
            {"role": "user", "content": [PICTURE, {"type": "text", "text": "Look."}]},
            {"role": "assistant", "content": None},
            {"role": "tool", "tool_call_id": "nobody's", "content": "A result without a call."},
            {"role": "critic", "content": 7},
        ]
        answer = post(endpoint, "chat/completions", host.request(store=True))
        assert answer.json()["choices"][0]["message"]["tool_calls"]
        ignored = answer.headers["x-smartplay-ignored"]
        assert "image_url (1)" in ignored
        assert ignored.endswith("store")

    def test_items_of_new_kinds_are_told_of(self, endpoint):
        handle = endpoint.open(GAME, seed=7)
        items = [
            {"role": "developer", "content": "Think."},
            {"type": "item_reference", "id": "msg_1"},
            {"type": "compaction", "encrypted_content": "..."},
            {"role": "user", "content": [{"type": "input_image", "image_url": "data:,"}]},
        ]
        answer = post(endpoint, "responses", {"model": endpoint.model(handle), "input": items, "tools": FLAT})
        ignored = answer.headers["x-smartplay-ignored"]
        assert ignored.startswith("developer messages (6 characters), user messages")
        assert ignored.endswith("item_reference (1), compaction (1), input_image (1)")


class TestResponses:
    @pytest.mark.parametrize("state", [{"previous_response_id": "resp_1"}, {"conversation": "conv_1"}])
    def test_what_a_provider_would_store_is_not_needed(self, endpoint, state):
        handle = endpoint.open(GAME, seed=7, budget=BUDGET)
        host = HostAgent(endpoint, handle)
        body: dict[str, Any] = {"model": endpoint.model(handle), "input": "Play.", "tools": FLAT}
        turns = 0
        while calls := [
            item for item in post(endpoint, "responses", body).json()["output"] if item["type"] == "function_call"
        ]:
            turns += 1
            body = {**body, **state, "input": []}
            for call in calls:
                text = host.run(call["name"], json.loads(call["arguments"]))
                body["input"].append({"type": "function_call_output", "call_id": call["call_id"], "output": text})
        assert (endpoint.result(handle).score, turns) == (3.0, 8)

    @pytest.mark.parametrize("stream", [False, True])
    def test_tools_in_a_namespace_are_flattened_and_called_apart(self, endpoint, stream):
        handle = endpoint.open(GAME, seed=7)
        tools = [{"type": "namespace", "name": "mcp__smartplay", "description": "", "tools": FLAT}]
        body = {"model": endpoint.model(handle), "input": "Play.", "tools": tools, "stream": stream}
        answer = post(endpoint, "responses", body)
        if stream:
            last = json.loads(answer.text.strip().splitlines()[-1].removeprefix("data: "))
            output = last["response"]["output"]
        else:
            output = answer.json()["output"]
        (call,) = [item for item in output if item["type"] == "function_call"]
        assert (call["namespace"], call["name"]) == ("mcp__smartplay", "observe")

    def test_tools_that_run_elsewhere_are_left_out_and_named(self, endpoint, caplog):
        handle = endpoint.open(GAME, seed=7)
        elsewhere = [{"type": "web_search"}, {"type": "custom", "name": "grep"}, {"type": "mcp", "server_url": "x"}]
        body = {"model": endpoint.model(handle), "input": "Play.", "tools": [*FLAT, *elsewhere]}
        ignored = post(endpoint, "responses", body).headers["x-smartplay-ignored"]
        assert ignored == "user messages (5 characters), the tools web_search, grep (custom), mcp"
        assert ignored in caplog.text


class TestSideRequests:
    """Requests for which the model is not asked."""

    def words(self, host: HostAgent, endpoint: WindowEndpoint, **fields: Any) -> str:
        message = post(endpoint, "chat/completions", host.request(**fields)).json()["choices"][0]["message"]
        assert "tool_calls" not in message
        return str(message["content"])

    def test_they_are_logged_once_and_counted(self, endpoint, caplog):
        handle = endpoint.open(GAME, seed=7)
        host = HostAgent(endpoint, handle)
        for _ in range(2):
            assert "offer the game's tools" in self.words(host, endpoint, tools=[])
        assert "moves only" in self.words(host, endpoint, tool_choice="none")
        sentence = "2 requests without the game's tools, 1 requests that allow no call"
        assert endpoint.ignored(handle).endswith(sentence)
        assert [record.levelname for record in caplog.records if "answered here" in record.message] == ["WARNING"] * 2
        assert endpoint.store.find(handle).episode.stats.turns == 0


THOUGHT = "The smallest disk first."


@pytest.mark.parametrize("interface", BY_CLIENT)
@pytest.mark.parametrize("stream", [False, True])
def test_the_models_thoughts_reach_the_host(interface, stream):
    """Through Messages where the host asks for them, because other clients do not expect such a block."""
    endpoint, _ = scripted({**calling(act(WAY[0])), "reasoning_content": THOUGHT})
    with endpoint, client_of(interface, endpoint) as client:
        asks = INTERFACES[interface](client, endpoint.model(endpoint.open(GAME, seed=7)), stream)
        extra = {"thinking": {"type": "adaptive"}} if interface == "messages" else {}
        (call,), items = (answer := asks.ask([*asks.begin], TOOLS, **extra)).calls, answer.items
    assert call[1] == "act"
    assert THOUGHT in str(items)


def test_an_edited_result_of_the_game_is_told_of_and_changes_nothing():
    endpoint, player = scripted(calling(act(WAY[0])), calling(act(WAY[1])))
    with endpoint:
        host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
        host.answer(host.post())
        text = host.messages[-1]["content"]
        wrapped = {**host.messages[-1], "content": json.dumps({"text": text, "is_error": False})}
        whole = host.request(messages=[*host.messages[:-1], wrapped])
        edited = host.request(messages=[*host.messages[:-1], {**host.messages[-1], "content": "A long result."}])
        ignored = post(endpoint, "chat/completions", edited).headers["x-smartplay-ignored"]
        assert "edited result" not in post(endpoint, "chat/completions", whole).headers["x-smartplay-ignored"]
    assert "edited result of act (1)" in ignored
    assert player.prompts[1].messages[-1]["content"] == text


def test_an_agent_that_refuses_everything_does_not_go_on_for_ever():
    script = [calling(("observe", {}))] * 30
    endpoint, player = scripted(*script)
    with endpoint:
        handle = endpoint.open(GAME, seed=7)
        host = HostAgent(endpoint, handle)
        while calls := (message := host.post()).get("tool_calls"):
            host.messages.append(message)
            host.messages += [{"role": "tool", "tool_call_id": call["id"], "content": "Denied."} for call in calls]
    assert endpoint.result(handle).end_reason == "stalled_turns"
    assert len(player.prompts) == 10


def test_results_stay_when_an_episode_is_closed():
    now = [0.0]
    with WindowEndpoint(sp.get_player("rule"), idle=60, clock=lambda: now[0]) as endpoint:
        played, waiting = (endpoint.open(GAME, seed=7, budget=BUDGET) for _ in range(2))
        HostAgent(endpoint, played).play()
        now[0] = 1000
        assert endpoint.result(waiting) is None
        body = HostAgent(endpoint, played).request()
        refused = httpx2.post(f"{endpoint.base_url}/chat/completions", json=body, trust_env=False, verify=False)
        assert "closed after 60 seconds without a request" in refused.json()["error"]["message"]
        assert refused.status_code == 404
        assert endpoint.result(played).score == 3.0
        assert endpoint.ignored(played).startswith("system messages")


def test_the_tools_are_shown_at_once(endpoint):
    host = HostAgent(endpoint, endpoint.open(GAME, seed=7))
    asked = {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}
    answer = httpx2.post(host.mcp_url, json=asked, trust_env=False, verify=False).json()
    assert all(tool["_meta"] == {"anthropic/alwaysLoad": True} for tool in answer["result"]["tools"])
