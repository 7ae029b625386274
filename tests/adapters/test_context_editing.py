"""Context editing at the context endpoint: Anthropic's own client asks, and its types read what was applied."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from typing import Any

import anthropic
import pytest
from smartplay_gateway import ContextEndpoint

import smartplay_tools as sp
from tests.adapters import endpoint_edits_judge
from tests.adapters.test_context_endpoint import MESSAGE, Upstream, events

PATHS = ("messages", "responses", "responses/compact")
BETA = "context-management-2025-06-27"
THINKING = {"type": "enabled", "budget_tokens": 1_024}


@pytest.fixture
def endpoint(upstream: Upstream) -> Iterator[ContextEndpoint]:
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(100_000)) as endpoint:
        yield endpoint


def use(number: int) -> list[dict[str, Any]]:
    call = {"type": "tool_use", "id": f"t{number}", "name": "read", "input": {"page": number}}
    result = {"type": "tool_result", "tool_use_id": f"t{number}", "content": f"Page {number} " + "of the book " * 9}
    return [{"role": "assistant", "content": [call]}, {"role": "user", "content": [result]}]


def uses(count: int) -> list[dict[str, Any]]:
    task = {"role": "user", "content": "Read."}
    return [task, *(message for number in range(count) for message in use(number))]


def ask(endpoint: ContextEndpoint, messages: Any, edits: Any, betas: list[str] | None = None, **more: Any) -> Any:
    client = anthropic.Anthropic(base_url=endpoint.url, api_key="k", max_retries=0)
    return client.beta.messages.create(
        model="m",
        max_tokens=9,
        messages=messages,
        betas=[BETA] if betas is None else betas,
        context_management={"edits": edits},
        **more,
    )


def tokens(messages: Any) -> int:
    return sp.ContextManager(None, result_tokens=None).fit(messages, form="anthropic").tokens


def test_old_uses_are_cleared_and_reported(endpoint: ContextEndpoint, upstream: Upstream):
    messages = uses(6)
    edit = {"type": "clear_tool_uses_20250919", "trigger": {"type": "tool_uses", "value": 5}, "clear_tool_inputs": True}
    answer = ask(endpoint, messages, [edit])
    sent = upstream.body["messages"]
    assert "context_management" not in upstream.body
    assert [message["content"][0]["content"][:9] for message in sent[2::2]] == ["[cleared]"] * 3 + [
        f"Page {number} of" for number in (3, 4, 5)
    ]
    assert [message["content"][0]["input"] for message in sent[1::2]] == [{}] * 3 + [{"page": n} for n in (3, 4, 5)]
    (applied,) = answer.context_management.applied_edits
    assert isinstance(applied, anthropic.types.beta.BetaClearToolUses20250919EditResponse)
    assert applied.cleared_tool_uses == 3
    assert applied.cleared_input_tokens == tokens(messages) - tokens(sent) > 0


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_stream_says_it_in_its_last_delta(endpoint: ContextEndpoint, upstream: Upstream, is_packed: bool):
    begin = {"type": "message_start", "message": {**MESSAGE, "content": []}}
    delta = {"type": "message_delta", "delta": {"stop_reason": "end_turn"}, "usage": {"output_tokens": 2}}
    content = b"".join(
        b"event: " + each["type"].encode() + b"\n" + events(each)
        for each in (begin, delta, {"type": "message_stop"})  # type: ignore[attr-defined]
    )
    headers = {"content-type": "text/event-stream"}
    upstream.given = (content, headers)
    if is_packed:
        upstream.given = gzip.compress(content), {**headers, "content-encoding": "gzip"}
    edit = {"type": "clear_tool_uses_20250919", "trigger": {"type": "input_tokens", "value": 50}}
    got = list(ask(endpoint, uses(6), [edit], stream=True))
    assert [each.type for each in got] == ["message_start", "message_delta", "message_stop"]
    (applied,) = got[1].context_management.applied_edits
    assert applied.cleared_tool_uses == 3


@pytest.mark.parametrize(
    ("edits", "more", "words"),
    [
        ([{"type": "clear_all"}], {}, "Input tag 'clear_all' does not match any of"),
        ("all", {}, "should be an object with a list of edits"),
        ([{"type": "clear_tool_uses_20250919"}], {"betas": []}, "not permitted without the beta"),
        ([{"type": "clear_tool_uses_20250919", "keep": {"type": "tool_uses", "value": -1}}], {}, "edits.0: keep="),
        ([{"type": "clear_tool_uses_20250919", "keeps": 3}], {}, "keeps: Extra inputs are not permitted"),
        ([{"type": "clear_thinking_20251015"}], {}, "requires `thinking` to be enabled"),
        ([{"type": "clear_thinking_20251015", "keep": 0}], {"thinking": THINKING}, "keep: Input should be an object"),
        ([{"type": "clear_tool_uses_20250919", "trigger": "tool_uses=1"}], {}, "trigger: Input should be an object"),
        ([{"type": "clear_tool_uses_20250919", "exclude_tools": "f"}], {}, "exclude_tools: Input should be a list"),
        (
            [{"type": "clear_tool_uses_20250919"}, {"type": "clear_thinking_20251015"}],
            {"thinking": THINKING},
            "must be first",
        ),
    ],
)
def test_what_the_provider_refuses_is_its_own_error(
    endpoint: ContextEndpoint, upstream: Upstream, edits: Any, more: dict[str, Any], words: str
):
    with pytest.raises(anthropic.BadRequestError, match=words) as caught:
        ask(endpoint, uses(3), edits, **more)
    assert caught.value.body["error"]["type"] == "invalid_request_error"  # type: ignore[index]
    assert not upstream.requests


def test_random_conversations_are_right_to_the_token():
    """A small part of `python -m tests.adapters.endpoint_edits_judge`."""
    found = endpoint_edits_judge.main(90, seed=10**6)
    edits = ("clear_tool_uses_20250919", "clear_thinking_20251015", "context_management")
    ways = (*(f"cleared by {name}" for name in edits), *(f"compacted by {path}" for path in PATHS))
    assert all(found[way] > 0 for way in (*ways, "cut to the cap", "bad input"))


@pytest.mark.parametrize("form", ["responses", "anthropic"])
def test_what_is_left_of_a_compacted_conversation_stays(form: Any):
    """Clients leave out what was before it, so without it everything would be lost."""
    blocks = [{"type": "compaction", "content": "He likes Rock.", "signature": "s"}]
    item = {"type": "compaction", "encrypted_content": "gAAAA", "id": "c"}
    first = item if form == "responses" else {"role": "assistant", "content": blocks}
    later = [
        {"role": role, "content": f"{role} {number} " + "of many words " * 20}
        for number in range(40)
        for role in ("user", "assistant")
    ]
    manager = sp.ContextManager(600)
    for messages in ([first, *later[:1]], [first, *later], [later[0], first, *later[2:]]):
        prompt = manager.fit(messages, form=form)
        assert prompt.tokens <= 600
        assert any(each is first for each in prompt.messages)
        assert prompt.messages[-1] is messages[-1]
