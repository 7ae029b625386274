"""After any message of a model, every prompt is a request that the interface accepts, with the same content."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings, strategies as st

import smartplay_tools as sp
from smartplay_tools.context.tokens import TokenCounter
from smartplay_tools.players.conversion import function_call

pytest.importorskip("openai")

import smartplay_openai as so

SERVER = {"chat": (so.CHAT.request, so.CHAT.read), "responses": (so.RESPONSES.request, so.RESPONSES.read)}


def message(content, calls, provider_items):
    tool_calls = [function_call(*call) for call in calls]
    reply = {"role": "assistant", "content": content, "tool_calls": tool_calls}
    return {**reply, "provider_items": provider_items} if provider_items else reply


TOOLS = st.sampled_from(["act", "observe", "read_manual", "jump"])
ARGUMENTS = st.sampled_from(["", "{}", '{"action": "1"}', '{"action": "2. Paper"}', "{", '{"a": 1, "a": 2}']) | st.text(
    max_size=9
)
CALLS = st.lists(st.tuples(st.sampled_from(["", "act:0", "call_1", "call_2"]), TOOLS, ARGUMENTS), max_size=3)
REASONING = st.lists(
    st.builds(
        lambda text: {"type": "reasoning", "summary": [{"text": text}], "encrypted_content": "E"}, st.text(max_size=9)
    ),
    max_size=2,
)
WORDS = st.none() | st.text(max_size=30)
MESSAGES = st.lists(st.builds(message, WORDS, CALLS, REASONING), min_size=1, max_size=14)
BUDGETS = st.builds(sp.Budget, prompt_tokens=st.integers(400, 900), history=st.integers(0, 5))


def prompts(messages, budget):
    """The prompts of a conversation, each with our count of it."""
    with sp.Episode("RockPaperScissorBasic-v0", seed=7, budget=budget) as episode:
        conversation = sp.Conversation(episode)
        for reply in messages:
            if (prompt := conversation.prompt()) is None:
                return
            yield prompt, conversation.view.tokens
            conversation.receive(reply)


@pytest.mark.parametrize("interface", SERVER)
@settings(max_examples=settings().max_examples // 2, deadline=None)
@given(messages=MESSAGES, budget=BUDGETS)
def test_a_request_is_taken_and_counts_what_the_prompt_counts(interface, messages, budget):
    request, read = SERVER[interface]
    counter = TokenCounter()
    for prompt, tokens in prompts(messages, budget):
        if interface == "chat":
            for sent in prompt.messages:
                sent.pop("provider_items", None)  # chat completions have no place for another interface's items
            tokens = counter.prompt(prompt.messages, prompt.tools)
        received = read({"model": "m", **json.loads(json.dumps(request(prompt)).encode())})
        assert counter.prompt(received.messages, received.tools) == tokens
        assert [m["role"] for m in received.messages] == [m["role"] for m in prompt.messages]


STRANGE = st.text(st.characters(), max_size=70)  # lone surrogates included


@pytest.mark.slow
@pytest.mark.parametrize("interface", SERVER)
@settings(max_examples=settings().max_examples // 2, deadline=None)
@given(
    messages=st.lists(
        st.builds(
            message, STRANGE | st.none(), st.lists(st.tuples(STRANGE, STRANGE, STRANGE), max_size=2), st.just([])
        ),
        max_size=6,
    )
)
def test_a_request_is_taken_whatever_was_said(interface, messages):
    request, read = SERVER[interface]
    for prompt, _ in prompts(messages, sp.Budget(history=2)):
        body = json.dumps(request(prompt), ensure_ascii=False).encode("utf-8")
        assert read({"model": "m", **json.loads(body)}).messages


@settings(deadline=None)
@given(reply=st.builds(message, WORDS, CALLS, st.just([])))
def test_a_stream_adds_up_to_the_completion(reply):
    completion = so.CHAT.write(reply, "m", sp.Usage(prompt=3, reply=2))
    whole = so.chat_reply(completion)
    chunks = [data for _, data in so.CHAT.stream(completion, {"stream_options": {"include_usage": True}})][:-1]
    streamed = so.chat_reply(so.CHAT.assemble(chunks))
    assert streamed.usage == whole.usage
    fields = ("content", "tool_calls")
    assert [streamed.message.get(field) for field in fields] == [whole.message.get(field) for field in fields]
