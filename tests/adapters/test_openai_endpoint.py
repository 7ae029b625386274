"""The local endpoint: its answers, and its refusals of requests that OpenAI refuses."""

from __future__ import annotations

import json
from contextlib import suppress
from queue import Queue
from threading import Event, Thread

import pytest
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp

pytest.importorskip("openai")

import httpx2
import smartplay_gateway as sg
import smartplay_openai as so

from smartplay_tools.context.tokens import TokenCounter
from tests import loopback

CALL = {"id": "c1", "type": "function", "function": {"name": "act", "arguments": '{"action": "1"}'}}
RESULT = {"role": "tool", "tool_call_id": "c1", "content": "Done."}
USER = {"role": "user", "content": "Play."}
REPLY = {"role": "assistant", "content": "I do."}
TOOL = {"name": "act", "description": "1. Rock\n2. Paper", "parameters": {"type": "object", "properties": {}}}


class Echo:
    """Replies with the roles and tools of its prompt."""

    name = "echo"

    def reply(self, prompt):
        seen = [message["role"] for message in prompt.messages] + [tool.name for tool in prompt.tools]
        return sp.Reply({"role": "assistant", "content": " ".join(seen)})


@pytest.fixture(scope="module")
def endpoint():
    with sg.LocalEndpoint(Echo(), sp.ScriptedPlayer([]), sp.get_player("rule")) as endpoint:
        yield endpoint


def ask(endpoint, path, body=None, method="POST", headers=None):
    """Send a request without a client library; return the status and the body."""
    text = body if isinstance(body, str | None) else json.dumps(body)
    status, _, answer = loopback.ask(endpoint.url.rstrip("/") + path, text, method=method, headers=headers or {})
    assert answer.isascii()
    return status, answer


def refusal(endpoint, path, body, **options):
    status, answer = ask(endpoint, path, body, **options)
    error = json.loads(answer)["error"]
    assert set(error) == {"message", "type", "param", "code"}
    return status, error["message"]


def chat(*messages, **fields):
    return {"model": "echo", "messages": list(messages), **fields}


def responses(*items, **fields):
    return {"model": "echo", "input": list(items), **fields}


# Answers.


@pytest.mark.parametrize("include_usage", [False, True])
def test_a_stream_of_chunks(endpoint, include_usage):
    body = chat(USER, stream=True, stream_options={"include_usage": include_usage})
    _, answer = ask(endpoint, "/v1/chat/completions", body)
    *events, done, rest = answer.split("\n\n")
    assert (done, rest) == ("data: [DONE]", "")
    chunks = [json.loads(event.removeprefix("data: ")) for event in events]
    assert {chunk["object"] for chunk in chunks} == {"chat.completion.chunk"}
    deltas = [choice["delta"] for chunk in chunks for choice in chunk["choices"]]
    assert "".join(delta.get("content") or "" for delta in deltas) == "user"
    assert [bool(chunk["usage"]) for chunk in chunks] == [False] * (len(chunks) - include_usage) + [
        True
    ] * include_usage
    assert [chunk["choices"] for chunk in chunks if chunk["usage"]] == [[]] * include_usage


def test_a_response(endpoint):
    items = [
        {"role": "developer", "content": "Play."},
        {"type": "reasoning", "id": "rs_1", "summary": []},
        {"type": "function_call", "call_id": "c1", "name": "act", "arguments": "{}"},
        {"type": "function_call_output", "call_id": "c1", "output": [{"type": "input_text", "text": "Done."}]},
    ]
    body = responses(*items, instructions="Be brief.", tools=[{"type": "function", **TOOL}])
    status, answer = ask(endpoint, "/v1/responses", body)
    response = json.loads(answer)
    assert (status, response["status"]) == (200, "completed")
    assert response["output"][0]["content"][0]["text"] == "system developer assistant tool act"
    assert json.loads(ask(endpoint, "/v1/responses", {"model": "echo", "input": "Play."})[1])["output"]


@pytest.mark.parametrize("kind", [so.OpenAIPlayer, so.ResponsesPlayer])
@pytest.mark.parametrize("stream", [False, True])
def test_a_reply_that_was_cut_is_told_from_one_that_ended(kind, stream):
    with sg.LocalEndpoint(sp.ScriptedPlayer([REPLY], sp.Usage(prompt=9, reply=2, cut=1)), Echo()) as endpoint:
        where = {"base_url": endpoint.base_url, "stream": stream}
        with kind("scripted", **where) as cut, kind("echo", **where) as ended:
            assert [player.reply(sp.Prompt([USER], ())).usage.cut for player in (cut, ended)] == [1, 0]


@pytest.mark.parametrize("reported", [sp.Usage(requests=2), sp.Usage(prompt=5, cached=9), sp.Usage(prompt=-5)])
def test_usage_is_our_count_where_no_provider_has_counted(reported):
    with sg.LocalEndpoint(sp.ScriptedPlayer([REPLY], reported)) as endpoint:
        status, text = ask(endpoint, "/v1/chat/completions", {**chat(USER), "model": "scripted"})
    counter, usage = TokenCounter(), json.loads(text)["usage"]
    counts = {name: usage[name] for name in ("prompt_tokens", "completion_tokens")}
    assert status == 200
    assert counts == {"prompt_tokens": counter.prompt([USER], ()), "completion_tokens": counter.message(REPLY)}


def test_the_models_are_the_players(endpoint):
    listed = json.loads(ask(endpoint, "/v1/models", method="GET")[1])
    assert [model["id"] for model in listed["data"]] == ["echo", "scripted", "rule"]
    assert json.loads(ask(endpoint, "/v1/models/rule", method="GET")[1])["id"] == "rule"


def test_a_page_that_is_named_may_use_it_with_clients_of_openai_and_of_mcp():
    """Their clients for browsers send headers of their own, and read from one whether to ask again."""
    page = "https://page.example.org"
    own = "authorization, content-type, x-stainless-os, x-stainless-helper-method, openai-project, mcp-protocol-version"
    preflight = {"Origin": page, "Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": own}
    with sg.LocalEndpoint(Echo(), origins=[page]) as endpoint:
        url = f"{endpoint.base_url}/chat/completions"
        asked = httpx2.options(url, headers=preflight, trust_env=False, verify=False)
        refused = httpx2.post(url, json={}, headers={"Origin": page}, trust_env=False, verify=False)
    assert (asked.status_code, asked.headers["access-control-allow-origin"]) == (200, page)
    assert set(own.split(", ")) <= set(asked.headers["access-control-allow-headers"].split(", "))
    assert "x-should-retry" in refused.headers
    assert "x-should-retry" in refused.headers["access-control-expose-headers"]


def test_an_address_of_version_6():
    with sg.LocalEndpoint(Echo(), host="::1") as endpoint:
        assert endpoint.base_url.startswith("http://[::1]:")
        assert ask(endpoint, "/v1/models", method="GET")[0] == 200


# Refusals.


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("{", "is a JSON object"),
        ({"messages": [USER]}, "names its model"),
        (chat(), "at least one message"),
        (chat({"role": "robot", "content": "?"}), "has one of the roles"),
        (chat({"role": "user", "content": None}), "has content"),
        (chat({"role": "assistant", "content": None}), "content or tool calls"),
        (chat({"role": "user", "content": [{"type": "image_url", "image_url": {"url": "x"}}]}), "text only"),
        (chat(USER, {"role": "assistant", "content": None, "tool_calls": [CALL]}), "c1 have no result"),
        (chat(USER, RESULT), "does not follow a tool call"),
        (
            chat(USER, {"role": "assistant", "content": None, "tool_calls": [CALL, CALL]}, RESULT),
            "is empty or repeated",
        ),
        (chat(USER, {"role": "assistant", "content": None, "tool_calls": "act"}), "cannot be read"),
        (chat(USER, tools=[{"type": "function", **TOOL}]), "under `function`"),
        (chat(USER, tools=[{"type": "function", "function": {**TOOL, "name": "go north!"}}]), "letters, digits"),
        (chat(USER, tools=[{"type": "function", "function": {**TOOL, "strict": True}}]), "additionalProperties"),
        (chat(USER, tools=[{"type": "function", "function": {**TOOL, "parameters": 1}}]), "type object"),
        (chat(USER, max_tokens=0), "at least 1"),
        (chat(USER, n=2), "n is 1"),
        (responses(), "at least one item"),
        (responses("Play."), "is an object"),
        (responses(USER, previous_response_id="resp_1"), "stores nothing"),
        (responses(USER, tools=[{"type": "function", "function": TOOL}]), "next to `type`"),
        (responses(USER, {"type": "function_call_output", "call_id": "c1", "output": "?"}), "does not follow"),
        (responses(USER, {"type": "function_call", "call_id": "c1", "name": "act", "arguments": "{}"}), "no result"),
    ],
)
def test_what_the_interfaces_refuse(endpoint, body, words):
    status, message = refusal(endpoint, "/v1/responses" if "input" in body else "/v1/chat/completions", body)
    assert status == 400
    assert words in message


def test_unknown_models_paths_and_methods(endpoint):
    assert refusal(endpoint, "/v1/chat/completions", {**chat(USER), "model": "gpt"}) == (
        404,
        "There is no model 'gpt' here; known: echo, scripted, rule.",
    )
    assert refusal(endpoint, "/v1/models/gpt", None, method="GET")[0] == 404
    assert refusal(endpoint, "/v1/embeddings", {})[0] == 404
    assert refusal(endpoint, "/v1/responses", None, method="GET")[0] == 405


@pytest.mark.parametrize("stream", [False, True])
def test_a_player_that_fails_is_an_error_of_the_server(endpoint, stream):
    body = {**chat(USER, stream=stream), "model": "scripted"}  # it has no reply
    assert refusal(endpoint, "/v1/chat/completions", body) == (500, "The player failed: StopIteration: ")


def test_closing_waits_for_no_player_that_answers():
    asked, closed, waited = Event(), Event(), Queue[bool]()

    class Slow:
        name = "slow"

        def reply(self, prompt):
            asked.set()
            waited.put(closed.wait(20))
            return Echo().reply(prompt)

    def wait_for_it():
        with suppress(OSError):  # the server has gone
            ask(endpoint, "/v1/chat/completions", {**chat(USER), "model": "slow"})

    with sg.LocalEndpoint(Slow()) as endpoint:
        client = Thread(target=wait_for_it)
        client.start()
        assert asked.wait(20)
    closed.set()
    client.join()
    assert waited.get(timeout=20), "the endpoint was closed before its player had answered"


def test_a_key_is_asked_for():
    with sg.LocalEndpoint(Echo(), api_key="schlüssel") as endpoint:
        assert refusal(endpoint, "/v1/chat/completions", chat(USER))[0] == 401
        assert refusal(endpoint, "/v1/models", None, method="GET")[0] == 401
        key = {"authorization": "Bearer schlüssel".encode()}
        assert ask(endpoint, "/v1/chat/completions", chat(USER), headers=key)[0] == 200


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
FIELDS = "role content tool_calls tool_call_id type call_id name arguments output id text description parameters"
WORDS = st.sampled_from(
    ["assistant", "act", "tool", "user", "function_call", "function_call_output", "message", "reasoning"]
)
ITEM = st.dictionaries(st.sampled_from(FIELDS.split()), WORDS | JSON, max_size=6) | JSON
BODY = st.fixed_dictionaries(
    {
        "model": st.sampled_from(["echo", "rule"]) | JSON,
        "messages": st.lists(ITEM, max_size=4) | JSON,
        "input": st.lists(ITEM, max_size=4) | JSON,
    },
    optional={
        "tools": st.lists(st.fixed_dictionaries({"type": st.just("function"), "function": ITEM}) | ITEM, max_size=2)
        | JSON,
        "tool_choice": st.sampled_from(["none", "required"]) | JSON,
        **dict.fromkeys(("stream", "stream_options", "max_tokens", "parallel_tool_calls", "n"), JSON),
    },
)


@settings(deadline=None)
@given(body=BODY | JSON, path=st.sampled_from(["/v1/chat/completions", "/v1/responses"]))
def test_no_body_breaks_it(endpoint, body, path):
    status, answer = ask(endpoint, path, json.dumps(body))
    assert status in (200, 400, 404), answer
    assert answer.startswith(("{", "data: ", "event: "))
