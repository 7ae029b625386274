"""Compaction at the context endpoint: the providers' clients ask for it, and their types read what they are sent."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anthropic
import httpx2
import openai
import pytest
from anthropic import types
from smartplay_gateway import ContextEndpoint, LocalEndpoint

import smartplay_tools as sp
from smartplay_tools.compactors.provider_edits import INSTRUCTIONS, SUMMARY
from smartplay_tools.manager.record import read_thread
from tests.adapters.test_context_editing import uses
from tests.adapters.test_context_endpoint import JSON, MESSAGE, RESPONSE, STREAM, Upstream, events
from tests.processes import is_soon

THRESHOLD, DEMAND = "compact-2026-01-12", "compact-2026-09-04"
USAGE = {"input_tokens": 700, "output_tokens": 30}
SUMMARISED = {**MESSAGE, "content": [{"type": "text", "text": "<summary>Page 3 is next.</summary>"}], "usage": USAGE}
SAID: dict[str, Any] = {"id": "x", "type": "message", "role": "assistant", "status": "completed"}
SAID["content"] = [{"type": "output_text", "text": "Done.", "annotations": []}]
DETAILS = {"input_tokens_details": {"cached_tokens": 5}, "output_tokens_details": {"reasoning_tokens": 2}}
COUNTED = {**USAGE, "total_tokens": 730, **DETAILS}
REPLIED = {**RESPONSE, "output": [SAID], "usage": COUNTED}


@pytest.fixture
def endpoint(upstream: Upstream) -> Iterator[ContextEndpoint]:
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(100_000)) as endpoint:
        yield endpoint


def said(text: str) -> dict[str, Any]:
    """A response with a text."""
    return {**REPLIED, "output": [{**SAID, "content": [{**SAID["content"][0], "text": text}]}]}


def script(upstream: Upstream, *answers: Any) -> None:
    """Have the upstream give these answers, whole ones or the events of streams."""
    upstream.script = [
        (events(*each), STREAM) if isinstance(each, list) else (json.dumps(each).encode(), JSON) for each in answers
    ]


def sent(upstream: Upstream) -> list[dict[str, Any]]:
    return [json.loads(content) for *_, content in upstream.requests]


def messages_client(endpoint: ContextEndpoint) -> anthropic.Anthropic:
    return anthropic.Anthropic(base_url=endpoint.url, api_key="k", max_retries=0)


def responses_client(endpoint: ContextEndpoint) -> openai.OpenAI:
    return openai.OpenAI(base_url=endpoint.base_url, api_key="k", max_retries=0)


def compact(endpoint: ContextEndpoint, messages: Any, trigger: int = 50, **more: Any) -> Any:
    edit = {"type": "compact_20260112", "trigger": {"type": "input_tokens", "value": trigger}, **more.pop("edit", {})}
    client = messages_client(endpoint)
    create = client.beta.messages.stream if more.pop("streams", False) else client.beta.messages.create
    given: dict[str, Any] = {"context_management": {"edits": [edit]}, "betas": [THRESHOLD]}
    return create(model="m", max_tokens=90, messages=messages, **{**given, **more})


def items(count: int) -> list[Any]:
    listed: list[Any] = [{"role": "developer", "content": "Be brief."}, {"role": "user", "content": "Read."}]
    for number in range(count):
        call = {"type": "function_call", "call_id": f"c{number}", "name": "read", "arguments": "{}"}
        listed += [call, {"type": "function_call_output", "call_id": f"c{number}", "output": "of the book " * 20}]
    return listed


ENTRY = [{"type": "compaction", "compact_threshold": 100}]


class TestMessages:
    def test_a_summary_stands_in_the_place_of_the_conversation(self, endpoint: ContextEndpoint, upstream: Upstream):
        messages = uses(4)
        tool = {"name": "read", "input_schema": {"type": "object"}}
        script(upstream, SUMMARISED, MESSAGE)
        answer = compact(endpoint, messages, tools=[tool], stop_sequences=["x"])
        question, request = sent(upstream)
        assert question["messages"] == [*messages, {"role": "user", "content": INSTRUCTIONS}]
        assert (question["tool_choice"], question["max_tokens"]) == ({"type": "none"}, 90)
        assert "stop_sequences" not in question
        standing = [{"role": "user", "content": f"{SUMMARY}Page 3 is next."}]
        assert request["messages"] == standing
        assert "context_management" not in request
        assert [block.type for block in answer.content] == ["compaction", "text"]
        assert isinstance(answer.content[0], anthropic.types.beta.BetaCompactionBlock)
        assert answer.content[0].content == "Page 3 is next."
        told = [(each.type, each.input_tokens, each.output_tokens) for each in answer.usage.iterations]
        assert told == [("compaction", 700, 30), ("message", 1, 1)]
        assert answer.usage.input_tokens == 1

        # Sent back, with or without what stood before it, it is read here.
        later = [{"role": "assistant", "content": answer.to_dict()["content"]}, {"role": "user", "content": "Go on."}]
        for before in ([], messages):
            script(upstream, MESSAGE)
            compact(endpoint, [*before, *later], trigger=5_000)
            rest = {"role": "assistant", "content": MESSAGE["content"]}
            assert sent(upstream)[-1]["messages"] == [*standing, rest, later[1]]

    def test_a_stream_begins_with_the_block(self, endpoint: ContextEndpoint, upstream: Upstream):
        start = {"type": "content_block_start", "index": 0, "content_block": {"type": "text", "text": ""}}
        delta = {"type": "content_block_delta", "index": 0, "delta": {"type": "text_delta", "text": "Done."}}
        stop = {"type": "content_block_stop", "index": 0}
        end = {"type": "message_delta", "delta": {"stop_reason": "end_turn"}, "usage": {"output_tokens": 2}}
        begin = {"type": "message_start", "message": {**MESSAGE, "content": []}}
        script(upstream, SUMMARISED, [begin, start, delta, stop, end, {"type": "message_stop"}])
        with compact(endpoint, uses(4), streams=True) as stream:
            kinds = [event.type for event in stream]
            answer = stream.get_final_message()
        assert "compaction" in kinds
        assert [block.type for block in answer.content] == ["compaction", "text"]
        assert (answer.content[0].content, answer.content[1].text) == ("Page 3 is next.", "Done.")
        script(upstream, SUMMARISED, [begin, end, {"type": "message_stop"}])
        raw = [*compact(endpoint, uses(4), stream=True)]
        told = [(each.type, each.input_tokens, each.output_tokens) for each in raw[-2].usage.iterations]
        assert told == [("compaction", 700, 30), ("message", 1, 2)]

    @pytest.mark.parametrize("streams", [False, True])
    def test_it_pauses_where_that_is_asked(self, endpoint: ContextEndpoint, upstream: Upstream, streams: bool):
        script(upstream, SUMMARISED)
        edit = {"pause_after_compaction": True, "instructions": "Say what matters."}
        answer = compact(endpoint, uses(4), edit=edit, streams=streams)
        if streams:
            with answer as stream:
                answer = stream.get_final_message()
        assert len(upstream.requests) == 1
        assert upstream.body["messages"][-1]["content"] == "Say what matters."
        assert (answer.stop_reason, [block.content for block in answer.content]) == ("compaction", ["Page 3 is next."])
        if not streams:
            assert [each.type for each in answer.usage.iterations] == ["compaction"]

    @pytest.mark.parametrize(
        "summary",
        [
            {**SUMMARISED, "stop_reason": "max_tokens"},
            {**SUMMARISED, "content": []},
            {**SUMMARISED, "content": uses(1)[1]["content"], "stop_reason": "tool_use"},
        ],
    )
    def test_without_a_summary_the_block_is_null_and_nothing_changes(
        self, endpoint: ContextEndpoint, upstream: Upstream, summary: Any
    ):
        script(upstream, summary, MESSAGE)
        answer = compact(endpoint, uses(4))
        assert sent(upstream)[1]["messages"] == uses(4)
        assert answer.content[0].content is None
        assert answer.usage.iterations[0].input_tokens == 700
        script(upstream, MESSAGE)
        compact(endpoint, [*uses(4), {"role": "assistant", "content": answer.to_dict()["content"]}], trigger=9_999)
        assert "compaction" not in json.dumps(upstream.body["messages"])

    @pytest.mark.parametrize("stream", [False, True])
    def test_on_demand_the_block_is_signed_and_alone(self, endpoint: ContextEndpoint, upstream: Upstream, stream: bool):
        script(upstream, SUMMARISED)
        create = messages_client(endpoint).beta.messages.create
        given: Any = {"model": "m", "max_tokens": 90, "betas": [DEMAND], "compaction": {"type": "summarize"}}
        answer: Any = create(**given, messages=uses(2), stream=stream)
        if stream:
            got = [*answer]
            assert [each.type for each in got] == [
                "message_start",
                "content_block_start",
                "content_block_stop",
                "message_delta",
                "message_stop",
            ]
            assert got[3].delta.stop_reason == "compaction"
            block = got[1].content_block.to_dict()
        else:
            assert (answer.stop_reason, answer.usage.input_tokens) == ("compaction", 0)
            assert [each.type for each in answer.usage.iterations] == ["compaction"]
            (block,) = answer.to_dict()["content"]
        assert block["content"] == "Page 3 is next."

        def go_on(blocks: Any, betas: Any = (DEMAND,), before: Any = ()) -> None:
            messages: Any = [*before, {"role": "assistant", "content": blocks}, {"role": "user", "content": "Go on."}]
            script(upstream, MESSAGE)
            messages_client(endpoint).beta.messages.create(model="m", max_tokens=9, betas=[*betas], messages=messages)

        go_on([block])
        standing = {"role": "user", "content": f"{SUMMARY}Page 3 is next."}
        assert upstream.body["messages"] == [standing, {"role": "user", "content": "Go on."}]
        for wrong, error in (
            ({"before": uses(1)}, types.CompactionBlockMisplacedError),
            ({"blocks": [block, block]}, types.CompactionBlockAmbiguousError),
            ({"blocks": [{**block, "content": "Other."}]}, types.CompactionContentMismatchError),
            ({"betas": [THRESHOLD]}, anthropic.BadRequestError),
        ):
            with pytest.raises(error):
                go_on(**{"blocks": [block], **wrong})

    def test_a_count_reads_what_is_sent_back(self, endpoint: ContextEndpoint, upstream: Upstream):
        block = {"type": "compaction", "content": "Page 3 is next."}
        new = {"role": "user", "content": "Go on."}
        body = {"model": "m", "messages": [*uses(1), {"role": "assistant", "content": [block]}, new]}
        address = f"{endpoint.base_url}/messages/count_tokens"
        httpx2.post(address, json=body, headers={"anthropic-beta": THRESHOLD})
        assert upstream.body["messages"] == [{"role": "user", "content": f"{SUMMARY}Page 3 is next."}, new]
        assert httpx2.post(address, json=body).status_code == 400

    @pytest.mark.parametrize(
        ("summary", "stop"),
        [
            ({**SUMMARISED, "stop_reason": "max_tokens"}, "max_tokens"),
            ({**SUMMARISED, "content": []}, "end_turn"),
        ],
    )
    def test_on_demand_a_missing_summary_is_an_answer_without_content(
        self, endpoint: ContextEndpoint, upstream: Upstream, summary: Any, stop: str
    ):
        script(upstream, summary)
        answer = messages_client(endpoint).beta.messages.create(
            model="m", max_tokens=9, betas=[DEMAND], messages=uses(2), compaction={"type": "summarize"}
        )
        assert (answer.content, answer.stop_reason) == ([], stop)
        assert answer.usage.iterations[0].input_tokens == 700

    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ({"betas": []}, "requires anthropic-beta: compact-2026-01-12"),
            ({"edit": {"trigger": {"type": "tool_uses", "value": 3}}}, "has to be input_tokens=N"),
            ({"edit": {"trigger": {"type": "input_tokens", "value": 0}}}, "with N at least 1"),
            ({"edit": {"keep": 3}}, "edits.0.keep: Extra inputs are not permitted"),
            ({"edit": {"pause_after_compaction": 3}}, "should be a valid boolean"),
            ({"edit": {"instructions": 3}}, "are a text"),
            ({"compaction": {"type": "summarize"}, "betas": [DEMAND]}, "cannot be combined"),
            ({"compaction": {"type": "summarize"}}, "requires anthropic-beta: compact-2026-09-04"),
            ({"compaction": {"type": "all"}, "betas": [DEMAND]}, "of the type 'summarize'"),
            ({"compaction": {"type": "summarize", "keep": 3}, "betas": [DEMAND]}, "compaction.keep: Extra inputs"),
        ],
    )
    def test_what_the_provider_refuses_is_its_own_error(
        self, endpoint: ContextEndpoint, upstream: Upstream, more: dict[str, Any], words: str
    ):
        with pytest.raises(anthropic.BadRequestError, match=words) as caught:
            compact(endpoint, uses(3), **more)
        assert caught.value.body["error"]["type"] == "invalid_request_error"
        assert not upstream.requests

    @pytest.mark.parametrize(
        ("messages", "more", "error"),
        [
            (uses(2)[:-1], {}, types.CompactionIncompleteTurnError),
            ([{"role": "user", "content": ""}], {}, types.CompactionNothingToSummarizeError),
            (uses(1), {"stop_sequences": ["x"]}, anthropic.BadRequestError),
            (uses(1), {"tool_choice": {"type": "any"}}, anthropic.BadRequestError),
        ],
    )
    def test_what_cannot_be_summarised_on_demand(
        self, endpoint: ContextEndpoint, upstream: Upstream, messages: Any, more: Any, error: type[Exception]
    ):
        with pytest.raises(error):
            messages_client(endpoint).beta.messages.create(
                model="m", max_tokens=9, betas=[DEMAND], messages=messages, compaction={"type": "summarize"}, **more
            )
        assert not upstream.requests

    def test_a_provider_s_own_block_is_left_to_the_provider(self, endpoint: ContextEndpoint, upstream: Upstream):
        block = {"type": "compaction", "content": "Short.", "signature": "EuYB"}
        messages = [{"role": "assistant", "content": [block]}, *uses(4)]
        compact(endpoint, messages)
        assert len(upstream.requests) == 1
        assert upstream.body["messages"] == messages
        assert upstream.body["context_management"]["edits"][0]["type"] == "compact_20260112"


class TestResponses:
    def test_an_item_stands_in_the_place_of_the_conversation(self, endpoint: ContextEndpoint, upstream: Upstream):
        client, given = responses_client(endpoint), items(4)
        script(upstream, said("<summary>Page 3 is next.</summary>"), REPLIED)
        answer = client.responses.create(model="m", input=given, context_management=ENTRY)
        question, request = sent(upstream)
        assert question["input"] == [*given, {"type": "message", "role": "user", "content": INSTRUCTIONS}]
        assert question["max_output_tokens"] == 4_096
        assert "context_management" not in {**question, **request}
        standing = [*given[:2], {"type": "message", "role": "user", "content": f"{SUMMARY}Page 3 is next."}]
        assert request["input"] == standing
        item, message = answer.output
        assert isinstance(item, openai.types.responses.ResponseCompactionItem)
        assert "Page 3 is next." in item.encrypted_content
        assert message.type == "message"
        assert answer.usage is not None
        assert (answer.usage.total_tokens, answer.usage.input_tokens_details.cached_tokens) == (1_460, 10)

        later = [each.to_dict() for each in answer.output]
        new = {"role": "user", "content": "Go on."}
        for before in ([], given):
            client.responses.create(model="m", input=[*before, *later, new])
            assert upstream.body["input"] == [*standing, later[1], new]

    def test_a_stream_begins_with_the_item(self, endpoint: ContextEndpoint, upstream: Upstream):
        steps = [
            {"type": "response.created", "sequence_number": 0, "response": {**RESPONSE, "status": "in_progress"}},
            {"type": "response.output_item.added", "sequence_number": 1, "output_index": 0, "item": SAID},
            {"type": "response.output_item.done", "sequence_number": 2, "output_index": 0, "item": SAID},
            {"type": "response.completed", "sequence_number": 3, "response": REPLIED},
        ]
        script(upstream, said("Page 3 is next."), steps)
        client = responses_client(endpoint)
        with client.responses.stream(model="m", input=items(4), context_management=ENTRY) as stream:
            got: list[Any] = [*stream]
            answer = stream.get_final_response()
        assert [event.sequence_number for event in got] == [0, 1, 2, 3, 4, 5]
        assert [getattr(event, "output_index", None) for event in got] == [None, 0, 0, 1, 1, None]
        assert got[1].item.type == got[2].item.type == "compaction"
        assert [item.type for item in answer.output] == ["compaction", "message"]
        assert answer.usage is not None
        assert answer.usage.total_tokens == 1_460

    def test_a_path_of_its_own_compacts_at_once(self, endpoint: ContextEndpoint, upstream: Upstream):
        script(upstream, said("Page 3 is next."))
        answer = responses_client(endpoint).responses.compact(model="m", input=items(3))
        assert upstream.requests[-1][1] == "/v1/responses"
        assert isinstance(answer, openai.types.responses.CompactedResponse)
        assert [item.type for item in answer.output] == ["message", "compaction"]
        assert answer.output[0].role == "user"
        assert answer.usage.total_tokens == 730
        script(upstream, REPLIED)
        back: Any = [*(item.to_dict(warnings=False) for item in answer.output), {"role": "user", "content": "Go on."}]
        responses_client(endpoint).responses.create(model="m", input=back)
        words = [each["content"] for each in upstream.body["input"]]
        assert words == ["Be brief.", "Read.", f"{SUMMARY}Page 3 is next.", "Go on."]

    @pytest.mark.parametrize("stream", [False, True])
    def test_an_item_at_the_end_compacts_at_once(self, endpoint: ContextEndpoint, upstream: Upstream, stream: bool):
        script(upstream, said("Page 3 is next."))
        given: Any = [*items(3), {"type": "compaction_trigger"}]
        answer: Any = responses_client(endpoint).responses.create(model="m", input=given, stream=stream)
        if stream:
            answer = [*answer][-1].response
        assert [item.type for item in answer.output] == ["compaction"]
        assert answer.usage.total_tokens == 730
        assert len(upstream.requests) == 1

    def test_without_a_summary_nothing_changes_but_the_usage(self, endpoint: ContextEndpoint, upstream: Upstream):
        script(upstream, {**said("Cut"), "status": "incomplete"}, REPLIED)
        client, given = responses_client(endpoint), items(4)
        answer = client.responses.create(model="m", input=given, context_management=ENTRY)
        assert sent(upstream)[1]["input"] == given
        assert [item.type for item in answer.output] == ["message"]
        assert answer.usage is not None
        assert answer.usage.total_tokens == 1_460
        script(upstream, {**said("Cut"), "status": "incomplete"})
        with pytest.raises(openai.InternalServerError, match="gave no summary"):
            client.responses.compact(model="m", input=given)

    def test_a_provider_s_own_item_is_left_to_the_provider(self, endpoint: ContextEndpoint, upstream: Upstream):
        given: Any = [{"type": "compaction", "encrypted_content": "gAAAA", "id": "c"}, *items(4)]
        client = responses_client(endpoint)
        client.responses.create(model="m", input=given, context_management=ENTRY)
        assert upstream.body["input"] == given
        assert upstream.body["context_management"] == ENTRY
        httpx2.post(f"{endpoint.base_url}/responses/compact", json={"model": "m", "input": given})
        assert upstream.requests[-1][1] == "/v1/responses/compact"

    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ({"context_management": [{"type": "clear"}]}, "Supported values are: 'compaction'"),
            ({"context_management": {"type": "compaction"}}, "a list with one entry"),
            ({"context_management": [{"type": "compaction"}]}, "needs compact_threshold=N"),
            ({"context_management": [{"type": "compaction", "compact_threshold": 0}]}, "at least 1"),
            ({"context_management": [{**ENTRY[0], "keep": 3}]}, "Unknown parameter: 'keep'"),
            ({"input": [{"type": "compaction_trigger"}, *items(1)]}, "must be the final input item"),
            ({"input": [{"type": "compaction", "encrypted_content": "smartplay-tools:{}"}]}, "could not be verified"),
        ],
    )
    def test_what_the_provider_refuses_is_its_own_error(
        self, endpoint: ContextEndpoint, upstream: Upstream, more: dict[str, Any], words: str
    ):
        with pytest.raises(openai.BadRequestError, match=words) as caught:
            responses_client(endpoint).responses.create(**{"model": "m", "input": items(1), **more})
        assert caught.value.type == "invalid_request_error"
        assert caught.value.param
        assert not upstream.requests


def test_edits_come_before_the_compaction(endpoint: ContextEndpoint, upstream: Upstream):
    clear = {"type": "clear_tool_uses_20250919", "trigger": {"type": "tool_uses", "value": 5}}
    edits = [clear, {"type": "compact_20260112", "trigger": {"type": "input_tokens", "value": 50}}]
    script(upstream, SUMMARISED, MESSAGE)
    betas = [THRESHOLD, "context-management-2025-06-27"]
    answer = compact(endpoint, uses(6), context_management={"edits": edits}, betas=betas)
    assert sent(upstream)[0]["messages"][2]["content"][0]["content"] == "[cleared]"
    assert answer.context_management.applied_edits[0].cleared_tool_uses == 3
    assert answer.content[0].type == "compaction"


def test_the_cap_holds_for_the_question_and_both_are_on_record(upstream: Upstream, tmp_path: Path):
    manager = sp.ContextManager(600, record=tmp_path)
    script(upstream, SUMMARISED, MESSAGE)
    with ContextEndpoint(f"{upstream.url}/v1", manager) as endpoint:
        compact(endpoint, uses(60))
    counts = [sp.ContextManager(None).fit(body["messages"], form="anthropic").tokens for body in sent(upstream)]
    assert max(counts) <= 600
    assert sent(upstream)[0]["messages"][-1]["content"] == INSTRUCTIONS
    prompts = [prompt for file in tmp_path.iterdir() for prompt in read_thread(file).prompts]
    assert sorted(prompt.reported or 0 for prompt in prompts) == [1, 700]


@pytest.mark.parametrize("is_streamed", [False, True])
def test_nothing_is_asked_for_a_client_that_has_left(upstream: Upstream, is_streamed: bool):
    """It leaves while the summary is asked for; the request that it made is not sent."""
    script(upstream, SUMMARISED, MESSAGE)
    upstream.may_answer.clear()
    edits = [{"type": "compact_20260112", "trigger": {"type": "input_tokens", "value": 50}}]
    body = {"model": "m", "max_tokens": 9, "messages": uses(3), "context_management": {"edits": edits}}
    sent_body = json.dumps({**body, "stream": is_streamed})
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(100_000)) as endpoint:
        client = http.client.HTTPConnection(endpoint.url.removeprefix("http://"))
        client.request("POST", "/v1/messages", sent_body, {"anthropic-beta": THRESHOLD})
        assert is_soon(lambda: bool(upstream.requests))
        client.close()
        httpx2.get(endpoint.url, headers={"host": "example.org"})  # who answers this has heard that the client has left
        upstream.may_answer.set()
    assert [each["messages"][-1]["content"] for each in sent(upstream)] == [INSTRUCTIONS]


def test_a_summary_that_does_not_fit_is_none(upstream: Upstream):
    long = {**SUMMARISED, "content": [{"type": "text", "text": "word " * 700}]}
    script(upstream, long, MESSAGE)
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(600)) as endpoint:
        answer = compact(endpoint, uses(60))
    assert answer.content[0].content is None
    assert len(sent(upstream)[1]["messages"]) > 3


CHAT = [
    {"role": role, "content": text} for _ in range(14) for role, text in (("user", "word " * 30), ("assistant", "ok"))
]


def test_nothing_is_asked_where_the_words_of_users_leave_no_room(upstream: Upstream):
    with ContextEndpoint(f"{upstream.url}/v1", sp.ContextManager(400)) as endpoint:
        answer = httpx2.post(f"{endpoint.base_url}/responses/compact", json={"model": "m", "input": CHAT})
        assert answer.status_code == 400
        assert "keeps the words of users" in answer.json()["error"]["message"]
        assert not upstream.requests
        script(upstream, REPLIED)
        entry = [{"type": "compaction", "compact_threshold": 100}]
        httpx2.post(f"{endpoint.base_url}/responses", json={"model": "m", "input": CHAT, "context_management": entry})
    assert INSTRUCTIONS not in str(sent(upstream))


def test_words_of_a_user_that_begin_like_a_summary_are_kept(endpoint: ContextEndpoint, upstream: Upstream):
    pasted = {"role": "user", "content": f"{SUMMARY}which I have pasted."}
    script(upstream, said("<summary>Page 3 is next.</summary>"))
    asked = {"model": "m", "input": [*items(2), pasted]}
    made = httpx2.post(f"{endpoint.base_url}/responses/compact", json=asked).json()["output"]
    script(upstream, REPLIED)
    httpx2.post(f"{endpoint.base_url}/responses", json={"model": "m", "input": made})
    read = [item["content"] for item in sent(upstream)[-1]["input"]]
    assert read.count(pasted["content"]) == 1
    assert f"{SUMMARY}Page 3 is next." in read


def test_an_answer_that_cannot_be_read_is_told_in_the_providers_form(endpoint: ContextEndpoint, upstream: Upstream):
    upstream.script = [(b"no gzip", {**JSON, "content-encoding": "gzip"})]
    answer = httpx2.post(f"{endpoint.base_url}/responses/compact", json={"model": "m", "input": items(1)})
    assert (answer.status_code, answer.headers["x-should-retry"]) == (502, "false")
    assert "broke off" in answer.json()["error"]["message"]


def test_a_body_that_is_too_deep_to_be_counted_is_refused(endpoint: ContextEndpoint, upstream: Upstream):
    deep = b'{"model": "m", "input": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    answer = httpx2.post(f"{endpoint.base_url}/responses", content=deep, headers=JSON)
    assert (answer.status_code, upstream.requests) == (400, [])


def test_an_error_of_the_upstream_is_the_client_s(endpoint: ContextEndpoint, upstream: Upstream):
    script(upstream, [{"type": "error"}])
    answer = httpx2.post(
        f"{endpoint.base_url}/responses/compact", json={"model": "m", "input": items(1)}, headers={"x": "1"}
    )
    assert answer.status_code == 502
    with ContextEndpoint("http://127.0.0.1:9/v1", sp.ContextManager(None)) as lost:
        answer = httpx2.post(f"{lost.base_url}/responses/compact", json={"model": "m", "input": items(1)})
    assert "does not answer" in answer.json()["error"]["message"]


class Clerk:
    """A player that summarises where it is asked to, and says how many messages it sees otherwise."""

    name = "clerk"

    def reply(self, prompt: sp.Prompt) -> sp.Reply:
        asked = prompt.messages[-1]["content"] == INSTRUCTIONS
        text = "Page 3 is next." if asked else str(len(prompt.messages))
        return sp.Reply({"role": "assistant", "content": text}, sp.Usage(prompt=50 + asked, reply=2))


class TestPlayers:
    @pytest.fixture
    def client(self) -> Iterator[Any]:
        with LocalEndpoint(Clerk(), context_tokens=600) as served:
            yield openai.OpenAI(base_url=served.base_url, api_key="k", max_retries=0).responses

    @pytest.mark.parametrize("stream", [False, True])
    def test_a_player_is_asked_for_a_summary_and_goes_on_with_it(self, client: Any, stream: bool):
        answer = client.create(model="clerk", input=items(4), context_management=ENTRY, stream=stream)
        if stream:
            answer = [*answer][-1].response
        assert [item.type for item in answer.output] == ["compaction", "message"]
        assert answer.output_text == "3"
        assert answer.usage.input_tokens == 101
        later = [*(item.to_dict() for item in answer.output), {"role": "user", "content": "Go on."}]
        assert client.create(model="clerk", input=later).output_text == "5"
        below = [{"type": "compaction", "compact_threshold": 599}]
        assert client.create(model="clerk", input=items(4), context_management=below).output_text == "10"

    def test_it_compacts_at_once(self, client: Any):
        answer = client.compact(model="clerk", input=items(3))
        assert [item.type for item in answer.output] == ["message", "compaction"]
        answer = client.create(model="clerk", input=[*items(3), {"type": "compaction_trigger"}])
        assert [item.type for item in answer.output] == ["compaction"]

    @pytest.mark.parametrize(
        ("more", "words"),
        [
            ({"context_management": [{"type": "clear"}]}, "Supported values are: 'compaction'"),
            ({"input": [{"type": "compaction", "encrypted_content": "gAAA"}, *items(1)]}, "cannot be read here"),
            ({"input": items(12), "context_management": ENTRY}, "maximum context length"),
        ],
    )
    def test_refusals(self, client: Any, more: Any, words: str):
        with pytest.raises(openai.BadRequestError, match=words):
            client.create(**{"model": "clerk", "input": items(1), **more})
