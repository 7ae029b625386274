"""A player behind OpenAI's interface plays exactly as it does without a network."""

from __future__ import annotations

import subprocess
import sys
from functools import partial

import pytest

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.installation import install_command

pytest.importorskip("openai")

import smartplay_gateway as sg
import smartplay_openai as so

BUDGET = sp.Budget(prompt_tokens=800, reply_tokens=200)


@pytest.fixture(scope="module")
def endpoint():
    with sg.LocalEndpoint(sp.get_player("rule"), sp.get_player("random", seed=1)) as endpoint:
        yield endpoint


def record(game, player, seed=7, budget=BUDGET):
    events = []
    with sp.Episode(game, seed=seed, budget=budget, transcript=events) as episode:
        result = sp.play(episode, player)
    return result, events


# What is counted.


# What the client is told.


class Watched(so.OpenAIPlayer):
    """Keeps the arguments that its client is called with, as tracers and bridges do."""

    def new_client(self):
        client = super().new_client()
        create, self.calls = client.chat.completions.create, []

        def watched(**arguments):
            self.calls.append(arguments)
            return create(**arguments)

        client.chat.completions.create = watched
        return client


@pytest.mark.parametrize("stream", [False, True])
def test_what_wraps_the_client_sees_messages_tools_and_settings(endpoint, stream):
    settings = {"parameters": {"temperature": 0, "top_k": 5}, "limit_field": "most_tokens", "stream": stream}
    with Watched("rule", base_url=endpoint.base_url, **settings) as player:
        result, _ = record("Hanoi3Disk-v0", player)
    assert result.completed
    assert len(player.calls) == result.turns
    for call in player.calls:
        assert [message["role"] for message in call["messages"][:2]] == ["system", "user"]
        assert [tool["function"]["name"] for tool in call["tools"]] == ["observe", "act", "read_manual"]
        assert (call["model"], call["temperature"]) == ("rule", 0)
        assert set(call["extra_body"]) == {"top_k", "most_tokens"}, "only what the client has no argument for"


@pytest.mark.parametrize("name", ["openai", "openai-responses"])
def test_with_or_without_types_the_same_is_sent(name):
    def bodies(typed):
        scripted = sp.ScriptedPlayer([{"role": "assistant", "content": "I wait."}] * 3)
        with (
            sg.LocalEndpoint(scripted) as endpoint,
            sp.get_player(f"{name}:scripted", base_url=endpoint.base_url, typed=typed) as player,
        ):
            record("Hanoi3Disk-v0", player)
        return scripted.prompts[0]

    assert bodies(typed=True) == bodies(typed=False)


# Reasoning.


def thinking(number):
    reasoning = {"type": "reasoning", "id": f"rs_{number}", "summary": [], "encrypted_content": "x" * 40}
    return {**sp.call("observe"), "provider_items": [reasoning]}


def test_reasoning_goes_back_with_its_turn_and_leaves_with_it(tmp_path):
    scripted = sp.ScriptedPlayer([thinking(number) for number in range(12)])
    path = tmp_path / "run.jsonl"
    budget = sp.Budget(prompt_tokens=500, tool_calls=12)
    with (
        sg.LocalEndpoint(scripted) as endpoint,
        sp.get_player("openai-responses:scripted", base_url=endpoint.base_url) as player,
        sp.Episode("Hanoi3Disk-v0", seed=7, budget=budget, transcript=path) as episode,
    ):
        sp.play(episode, player)
    dropped = 0
    for number, prompt in enumerate(scripted.prompts):
        replies = [message for message in prompt.messages if message["role"] == "assistant"]
        ids = [item["id"] for reply in replies for item in reply["provider_items"] if item["type"] == "reasoning"]
        assert ids == [f"rs_{n}" for n in range(number - len(replies), number)]
        assert all(item["encrypted_content"] == "x" * 40 for r in replies for item in r["provider_items"][:1])
        dropped += number > len(replies)
    assert dropped
    assert sp.replay(path).identical


def test_output_items_come_back_in_their_order():
    sealed = {"encrypted_content": "gAAA"}
    output = [
        {"type": "reasoning", "id": "rs_1", "summary": [{"type": "summary_text", "text": "Hm."}], **sealed},
        {"type": "message", "id": "msg_1", "role": "assistant", "content": [{"type": "output_text", "text": "First."}]},
        {"type": "function_call", "id": "fc_1", "call_id": "call_1", "name": "observe", "arguments": "{}"},
        {"type": "reasoning", "id": "rs_2", "summary": [], **sealed},
        {"type": "message", "id": "msg_2", "role": "assistant", "content": [{"type": "output_text", "text": "Then."}]},
        {"type": "function_call", "id": "fc_2", "call_id": "call_2", "name": "act", "arguments": '{"action": "1"}'},
    ]
    reply = so.responses_reply({"output": output, "status": "completed"})
    results = [{"role": "tool", "content": "seen", "tool_call_id": call} for call in ("call_1", "call_2")]
    sent = so.responses_request(sp.Prompt([reply.message, *results], ()))
    again = [
        {**item, "content": [{**p, "annotations": []} for p in item["content"]]} if "content" in item else item
        for item in output
    ]
    assert sent["input"][:6] == again
    # The text is counted once, as part of the message and not of the reasoning.
    assert TokenCounter().message(reply.message) == TokenCounter().message(
        {**reply.message, "provider_items": [output[0]]}
    )


# What only the wire sees.


SIGNED = {"extra_content": {"google": {"thought_signature": "s"}}}
OBSERVE = {"type": "function", "function": {"name": "observe", "arguments": "{}"}}


def thoughts(text):
    return {"type": "thinking", "thinking": [{"type": "text", "text": text}]}


def test_what_chat_completions_add_to_a_reply_is_not_sent_to_responses():
    calls = [{"id": "a", **OBSERVE, **SIGNED}]
    content = [thoughts("Hm."), {"type": "text", "text": "I look."}]
    reply = so.chat_reply({"choices": [{"message": {"role": "assistant", "content": content, "tool_calls": calls}}]})
    items = so.responses_request(sp.Prompt([reply.message], ()))["input"]
    assert [item["type"] for item in items] == ["message", "function_call"]
    assert items[0]["content"][0]["text"] == "I look."


# Where it goes.


def test_the_environment_names_server_and_key(monkeypatch):
    with sg.LocalEndpoint(sp.get_player("rule"), api_key="secret") as guarded:
        monkeypatch.setenv("OPENAI_BASE_URL", guarded.base_url)
        monkeypatch.setenv("OPENAI_API_KEY", "secret")
        with sp.get_player("openai:rule") as player:
            assert record("Hanoi3Disk-v0", player)[0].completed


def without(modules: str, code: str) -> str:
    """The last line of the errors of a program in which none of the modules can be imported."""
    program = f"import sys; sys.modules.update(dict.fromkeys({modules.split()!r})); {code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    return done.stderr.strip().rpartition("\n")[2]


slowly = partial(pytest.param, marks=pytest.mark.slow)
"""A case in a separate process, which only the slow tests run."""


@pytest.mark.slow
def test_a_model_plays_without_a_web_server():
    code = "import smartplay_tools as sp; sp.get_player('openai:m', base_url='http://127.0.0.1:9/v1').close()"
    assert without("starlette uvicorn", code) == ""


@pytest.mark.parametrize(
    ("missing", "code", "extra"),
    [
        ("openai", "from smartplay_openai import OpenAIPlayer", "openai"),
        slowly("openai", "import smartplay_tools as sp; sp.get_player('openai:m')", "openai"),
        slowly("agents", "import smartplay_openai.agents", "agents"),
        slowly("starlette", "from smartplay_gateway import LocalEndpoint", "serve"),
        slowly("uvicorn", "from smartplay_gateway import WindowEndpoint", "serve"),
        slowly("langchain", "from smartplay_langchain import SmartPlayMiddleware", "langchain"),
    ],
)
def test_a_missing_extra_is_one_sentence(missing, code, extra):
    assert without(missing, code).endswith(f"needs an optional dependency: {install_command(extra)}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "code"),
    [
        ("openai starlette uvicorn", "from smartplay_openai import CHAT, RESPONSES, chat_request, responses_reply"),
        slowly("anthropic", "from smartplay_anthropic import reply, request"),
        slowly("openai", "from smartplay_gateway import LocalEndpoint, WindowEndpoint"),
        slowly("starlette uvicorn", "from smartplay_mcp import CALL_KEY, serve_stdio"),
        slowly("langchain langgraph", "from smartplay_langchain import SmartPlayToolkit, to_langchain"),
    ],
)
def test_a_part_of_an_adapter_needs_only_what_it_uses(missing, code):
    assert without(missing, code) == ""
