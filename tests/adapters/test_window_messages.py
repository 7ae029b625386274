"""Anthropic's Messages interface at the window: the client, its tool runner, threads, and what Claude Code sends.

The three ways of the client that keep the messages on this side are in `test_window_endpoint.py`.
"""

from __future__ import annotations

import json
from typing import Any

import anthropic
import httpx2
import pytest
from anthropic.lib.tools import beta_tool
from smartplay_gateway import WindowEndpoint

import smartplay_tools as sp
from tests.adapters.conformance import calling
from tests.adapters.window_host import MESSAGES_TOOLS, anthropic_client

pytestmark = pytest.mark.slow

BUDGET = sp.Budget(prompt_tokens=700)
GAME = "Hanoi3Disk-v0"
USER = {"role": "user", "content": "Play."}


def request(endpoint: WindowEndpoint, handle: str, **fields: Any) -> dict[str, Any]:
    return {
        "model": endpoint.model(handle),
        "max_tokens": 100,
        "messages": [USER],
        "tools": MESSAGES_TOOLS,
        **fields,
    }


def post(endpoint: WindowEndpoint, body: dict[str, Any], path: str = "/v1/messages", **headers: str) -> Any:
    return httpx2.post(f"{endpoint.url}{path}", json=body, headers=headers, trust_env=False, verify=False, timeout=60)


def words(answer: Any) -> str:
    (block,) = answer.json()["content"]
    return str(block["text"])


@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.parametrize("thread", [None, False])
def test_the_clients_tool_runner_plays(endpoint, stream, thread):
    """Without `thread=False` it sends, after the first request, neither tools nor history."""
    handle = endpoint.open(GAME, seed=7, budget=BUDGET)
    tools = [beta_tool(function) for function in endpoint.functions(handle)]
    options = {} if thread is None else {"thread": thread}
    with anthropic_client(endpoint) as client:
        runner = client.beta.messages.tool_runner(
            max_tokens=1000,
            messages=[USER],
            tools=tools,
            model=endpoint.model(handle),
            stream=stream,
            **options,
        )
        last = runner.until_done()
    assert last.content[0].text == "The game is over."
    result = endpoint.result(handle)
    assert (result.score, result.turns) == (3.0, 8)


def test_a_thread_that_is_not_known_is_refused_as_the_client_expects(endpoint):
    """The client then sends all of it, as after a restart of the endpoint."""
    continued = {"thread": {"type": "continue", "previous_message_id": "msg_1"}, "tools": []}
    refused = post(endpoint, request(endpoint, endpoint.open(GAME, seed=7), **continued))
    assert refused.status_code == 404
    error = refused.json()["error"]
    assert (error["type"], error["details"]["error_code"]) == ("not_found_error", "thread_not_found")


def test_what_claude_code_sends_is_read(endpoint):
    """Text of the system in the middle, tools of servers, marks for the cache, bodies longer than a call's."""
    handle = endpoint.open(GAME, seed=7, budget=BUDGET)
    body = request(
        endpoint,
        handle,
        system=[{"type": "text", "text": "You are an agent.", "cache_control": {"type": "ephemeral"}}],
        thinking={"type": "adaptive"},
        context_management={"edits": []},
        metadata={"user_id": "{}"},
        messages=[{"role": "system", "content": []}, {"role": "user", "content": "x" * 90_000}],
        tools=[*MESSAGES_TOOLS, {"type": "web_search_20250305", "name": "web_search"}],
    )
    answer = post(endpoint, body, "/v1/messages?beta=true")
    assert answer.json()["stop_reason"] == "tool_use"
    assert answer.headers["x-smartplay-ignored"] == (
        "system messages (17 characters), user messages (90,000 characters), the tools web_search "
        "(web_search_20250305), cache_control, context_management, max_tokens, metadata, thinking"
    )


def test_a_number_that_json_cannot_hold_is_its_name():
    """Clients that read JSON strictly would read nothing of the answer."""
    odd = calling(("act", '{"action": "1", "times": 1e999}'))
    with WindowEndpoint(sp.ScriptedPlayer([odd])) as endpoint:
        answer = post(endpoint, request(endpoint, endpoint.open(GAME, seed=7)))
    (call,) = json.loads(answer.text, parse_constant=pytest.fail)["content"]
    assert call["input"] == {"action": "1", "times": "inf"}


def test_a_prompt_has_the_tokens_of_the_window(endpoint):
    handle = endpoint.open(GAME, seed=7, budget=BUDGET)
    path = "/v1/messages/count_tokens"
    body = request(endpoint, handle)
    before = post(endpoint, body, path).json()["input_tokens"]
    answer = post(endpoint, body).json()
    assert before == post(endpoint, body, path).json()["input_tokens"] == answer["usage"]["input_tokens"] < 700


def test_a_token_comes_as_a_key_or_as_a_bearer():
    with WindowEndpoint(sp.get_player("rule"), token="secret") as endpoint:
        body = request(endpoint, endpoint.open(GAME, seed=7))
        for headers in ({}, {"x-api-key": "guess"}, {"authorization": "Bearer guess"}):
            refused = post(endpoint, body, **headers)
            assert (refused.status_code, refused.headers["x-should-retry"]) == (401, "false")
            assert refused.json()["error"]["type"] == "authentication_error"
        for headers in ({"x-api-key": "secret"}, {"authorization": "Bearer secret"}):
            assert post(endpoint, body, **headers).json()["stop_reason"] == "tool_use"


def test_an_unknown_handle_is_an_error_in_anthropics_form(endpoint):
    with anthropic_client(endpoint) as client, pytest.raises(anthropic.NotFoundError, match="No such episode"):
        client.messages.create(model="smartplay/no", max_tokens=10, messages=[USER], tools=MESSAGES_TOOLS)


def test_sub_agents_and_summaries_of_claude_code_are_answered_in_words(endpoint):
    handle = endpoint.open(GAME, seed=7)
    body = request(endpoint, handle)
    assert "none of its sub-agents" in words(post(endpoint, body, **{"x-claude-code-agent-id": "a1"}))
    compaction = {"role": "user", "content": "CRITICAL: Respond with TEXT ONLY. Do NOT call any tools."}
    assert "moves only" in words(post(endpoint, {**body, "messages": [USER, compaction]}))
    assert "moves only" in words(post(endpoint, {**body, "tool_choice": {"type": "none"}}))
    assert endpoint.store.find(handle).episode.stats.turns == 0


def test_tools_behind_a_search_are_searched_for_once(endpoint):
    handle = endpoint.open(GAME, seed=7)
    search = {"name": "ToolSearch", "description": "Load tools.", "input_schema": {"type": "object", "properties": {}}}
    named = "Deferred tools: mcp__smartplay__act, mcp__smartplay__observe and mcp__smartplay__read_manual."
    body = request(endpoint, handle, system=named, tools=[search])
    message = post(endpoint, body).json()
    (call,) = message["content"]
    names = "mcp__smartplay__act,mcp__smartplay__observe,mcp__smartplay__read_manual"
    assert (call["name"], call["input"]) == ("ToolSearch", {"query": f"select:{names}", "max_results": 3})
    result = {"type": "tool_result", "tool_use_id": call["id"], "content": "No match."}
    body["messages"] += [{"role": "assistant", "content": message["content"]}, {"role": "user", "content": [result]}]
    assert "has to show these" in words(post(endpoint, body))
    loaded = [{**tool, "name": f"mcp__smartplay__{tool['name']}", "defer_loading": True} for tool in MESSAGES_TOOLS]
    assert post(endpoint, {**body, "tools": [search, *loaded]}).json()["content"][0]["name"].startswith("mcp__")
