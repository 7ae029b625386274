"""OpenTelemetry, with its in-memory exporter: `.ci/run` has an environment with it."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("opentelemetry.sdk", reason="needs opentelemetry-sdk; `.ci/run` has an environment with it")

import smartplay_otel
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.semconv._incubating.attributes import gen_ai_attributes
from opentelemetry.trace import StatusCode

import smartplay_tools as sp
from tests.adapters.conformance import act, calling, fresh

EXPORTER = InMemorySpanExporter()
PROVIDER = TracerProvider()
PROVIDER.add_span_processor(SimpleSpanProcessor(EXPORTER))

MOVES = [calling(("read_manual", {})), calling(act("A->C"), ("act", {"action": "Fly"}), say="Now."), calling(say="?")]


@pytest.fixture
def traced() -> Iterator[None]:
    EXPORTER.clear()
    stop = smartplay_otel.instrument(PROVIDER)
    yield
    stop()


def spans(operation: str) -> list[Any]:
    finished = [s for s in EXPORTER.get_finished_spans() if s.attributes["gen_ai.operation.name"] == operation]
    return sorted(finished, key=lambda span: span.start_time)


def play(script: list[sp.Message], **options: Any) -> sp.EpisodeResult:
    episode, _ = fresh(sp.Budget(tool_calls=3), **options)
    with episode:
        return sp.play(episode, sp.ScriptedPlayer(script * 3))


def test_an_episode_is_a_tree_of_spans(traced):
    result = play(MOVES)
    (root,) = spans("invoke_agent")
    chats, tools = spans("chat"), spans("execute_tool")
    assert Counter(span.name for span in chats) == {"chat scripted": result.turns}
    assert [span.name for span in tools] == ["execute_tool read_manual", "execute_tool act", "execute_tool act"]
    assert {span.parent.span_id for span in (*chats, *tools)} == {root.context.span_id}
    assert {span.context.trace_id for span in (*chats, *tools)} == {root.context.trace_id}
    assert root.attributes["gen_ai.usage.input_tokens"] == result.tokens.prompt
    assert sum(span.attributes["gen_ai.usage.input_tokens"] for span in chats) == result.tokens.prompt
    assert (root.attributes["smartplay.end_reason"], root.attributes["smartplay.score"]) == ("tool_calls", result.score)
    figures = {
        e.attributes["gen_ai.evaluation.name"]: e.attributes["gen_ai.evaluation.score.value"] for e in root.events
    }
    assert figures["score"] == result.score


@pytest.mark.parametrize(
    ("reported", "is_ours", "reason"),
    [
        (sp.Usage(prompt=90, reply=9), False, "tool_calls"),
        (sp.Usage(prompt=90, reply=9, cut=1), False, "length"),
        (sp.Usage(requests=2), True, "tool_calls"),
    ],
)
def test_what_a_provider_reports_of_a_reply_is_told(traced, reported, is_ours, reason):
    episode, _ = fresh(sp.Budget(tool_calls=1))
    with episode:
        result = sp.play(episode, sp.ScriptedPlayer([calling(act("A->C"))], reported))
    (chat,), (root,) = spans("chat"), spans("invoke_agent")
    expected = (result.tokens.prompt, result.tokens.reply) if is_ours else (90, 9)
    for span in (chat, root):
        counts = (span.attributes["gen_ai.usage.input_tokens"], span.attributes["gen_ai.usage.output_tokens"])
        assert counts == expected
    assert chat.attributes["gen_ai.response.finish_reasons"] == (reason,)


def test_a_mistake_of_the_model_is_an_error_of_its_call_only(traced):
    play(MOVES)
    assert [span.status.status_code for span in spans("execute_tool")] == [
        StatusCode.UNSET,
        StatusCode.UNSET,
        StatusCode.ERROR,
    ]
    assert spans("execute_tool")[-1].attributes["error.type"] == "illegal"
    assert spans("invoke_agent")[0].status.status_code is StatusCode.UNSET


def test_what_was_said_is_not_there(traced):
    play(MOVES)
    text = json.dumps([dict(span.attributes) for span in EXPORTER.get_finished_spans()])
    assert not [said for said in ("Now.", "Fly", "You play through tools") if said in text]


def test_results_and_records_are_the_same_with_and_without(traced):
    episode, first_events = fresh(sp.Budget(prompt_tokens=700))
    with episode:
        first = sp.play(episode, sp.get_player("rule"))
    stop = smartplay_otel.instrument(PROVIDER)
    stop()
    again, events = fresh(sp.Budget(prompt_tokens=700))
    with again:
        assert sp.play(again, sp.get_player("rule")) == first
    assert events == first_events


def test_a_model_that_fails_is_an_error_of_the_whole_episode(traced):
    class Broken:
        name = "openai:gpt-none"

        def reply(self, prompt: sp.Prompt) -> sp.Reply:
            raise ConnectionError("no such host")

    episode, _ = fresh()
    with episode:
        sp.play(episode, Broken())
    (root,), (chat,) = spans("invoke_agent"), spans("chat")
    assert {root.status.status_code, chat.status.status_code} == {StatusCode.ERROR}
    assert root.attributes["error.type"] == chat.attributes["error.type"] == "ConnectionError"
    assert (chat.name, chat.attributes["gen_ai.provider.name"]) == ("chat gpt-none", "openai")


def test_episodes_on_an_event_loop_have_traces_of_their_own(traced):
    async def both() -> None:
        episodes = [fresh(seed=seed)[0] for seed in (1, 2)]
        await asyncio.gather(*(sp.aplay(episode, sp.get_player("rule")) for episode in episodes))

    asyncio.run(both())
    roots = spans("invoke_agent")
    assert len({root.context.trace_id for root in roots}) == 2
    for root in roots:
        own = [s for s in spans("chat") if s.parent.span_id == root.context.span_id]
        assert len({s.attributes["gen_ai.conversation.id"] for s in own}) == 1


def test_an_evaluation_is_traced_below_the_span_around_it(traced, tmp_path):
    with PROVIDER.get_tracer("mine").start_as_current_span("mine", attributes={"gen_ai.operation.name": "mine"}):
        sp.evaluate(["Hanoi3Disk-v0"], ["rule"], trials=2, out=tmp_path / "run", workers=1, executor="inline")
    (mine,) = spans("mine")
    assert [root.parent.span_id for root in spans("invoke_agent")] == [mine.context.span_id] * 2


def test_an_episode_that_began_before_is_not_traced():
    EXPORTER.clear()
    episode, _ = fresh()
    stop = smartplay_otel.instrument(PROVIDER)
    with episode:
        sp.play(episode, sp.get_player("rule"))
    stop()
    play(MOVES)
    assert EXPORTER.get_finished_spans() == ()


def test_the_names_are_those_of_the_conventions(traced):
    play(MOVES)
    conventions = {value for name, value in vars(gen_ai_attributes).items() if name.startswith("GEN_AI_")}
    used = {name for span in EXPORTER.get_finished_spans() for name in span.attributes}
    used |= {name for span in EXPORTER.get_finished_spans() for event in span.events for name in event.attributes}
    assert {name for name in used if name.startswith("gen_ai.")} <= conventions
    assert {name.partition(".")[0] for name in used} == {"gen_ai", "smartplay", "error"}
