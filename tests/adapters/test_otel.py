"""OpenTelemetry, with its in-memory exporter: `.ci/run` has an environment with it."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from pathlib import Path
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
from smartplay_tools.files.times import times_file
from smartplay_tools.transcript import keep_times
from tests.adapters.conformance import act, calling, fresh

EXPORTER = InMemorySpanExporter()
PROVIDER = TracerProvider()
PROVIDER.add_span_processor(SimpleSpanProcessor(EXPORTER))

MOVES = [calling(("read_manual", {})), calling(act("A->C"), ("act", {"action": "Fly"}), say="Now."), calling(say="?")]


@pytest.fixture(params=[False, True], ids=["without content", "with content"])
def content(request: pytest.FixtureRequest) -> Any:
    EXPORTER.clear()
    stop = smartplay_otel.instrument(PROVIDER, content=request.param)
    yield request.param
    stop()


def spans(operation: str) -> list[Any]:
    finished = [s for s in EXPORTER.get_finished_spans() if s.attributes["gen_ai.operation.name"] == operation]
    return sorted(finished, key=lambda span: span.start_time)


def play(script: list[sp.Message], **options: Any) -> sp.EpisodeResult:
    episode, _ = fresh(sp.Budget(tool_calls=3), **options)
    with episode:
        return sp.play(episode, sp.ScriptedPlayer(script * 3))


def test_an_episode_is_a_tree_of_spans(content):
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
def test_what_a_provider_reports_of_a_reply_is_told(content, reported, is_ours, reason):
    episode, _ = fresh(sp.Budget(tool_calls=1))
    with episode:
        result = sp.play(episode, sp.ScriptedPlayer([calling(act("A->C"))], reported))
    (chat,), (root,) = spans("chat"), spans("invoke_agent")
    expected = (result.tokens.prompt, result.tokens.reply) if is_ours else (90, 9)
    for span in (chat, root):
        counts = (span.attributes["gen_ai.usage.input_tokens"], span.attributes["gen_ai.usage.output_tokens"])
        assert counts == expected
    assert chat.attributes["gen_ai.response.finish_reasons"] == (reason,)
    if content:
        assert json.loads(chat.attributes["gen_ai.output.messages"])[0]["finish_reason"] == reason


def test_a_mistake_of_the_model_is_an_error_of_its_call_only(content):
    play(MOVES)
    assert [span.status.status_code for span in spans("execute_tool")] == [
        StatusCode.UNSET,
        StatusCode.UNSET,
        StatusCode.ERROR,
    ]
    assert spans("execute_tool")[-1].attributes["error.type"] == "illegal"
    assert spans("invoke_agent")[0].status.status_code is StatusCode.UNSET


def test_what_was_said_is_there_only_if_asked_for(content):
    play(MOVES)
    text = json.dumps([dict(span.attributes) for span in EXPORTER.get_finished_spans()])
    assert ("Now." in text) == content
    assert ("Fly" in text) == content
    assert ("You play through tools" in text) == content
    if content:
        (first, *_) = spans("chat")
        (output,) = json.loads(first.attributes["gen_ai.output.messages"])
        assert [part["type"] for part in output["parts"]] == ["tool_call"]
        assert output["parts"][0]["id"] == spans("execute_tool")[0].attributes["gen_ai.tool.call.id"]


def test_results_and_records_are_the_same_with_and_without(content):
    episode, traced = fresh(sp.Budget(prompt_tokens=700))
    with episode:
        first = sp.play(episode, sp.get_player("rule"))
    stop = smartplay_otel.instrument(PROVIDER)
    stop()
    again, events = fresh(sp.Budget(prompt_tokens=700))
    with again:
        assert sp.play(again, sp.get_player("rule")) == first
    assert events == traced


def test_a_model_that_fails_is_an_error_of_the_whole_episode(content):
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


def test_episodes_on_an_event_loop_have_traces_of_their_own(content):
    async def both() -> None:
        episodes = [fresh(seed=seed)[0] for seed in (1, 2)]
        await asyncio.gather(*(sp.aplay(episode, sp.get_player("rule")) for episode in episodes))

    asyncio.run(both())
    roots = spans("invoke_agent")
    assert len({root.context.trace_id for root in roots}) == 2
    for root in roots:
        own = [s for s in spans("chat") if s.parent.span_id == root.context.span_id]
        assert len({s.attributes["gen_ai.conversation.id"] for s in own}) == 1


def test_an_evaluation_is_traced_below_the_span_around_it(content, tmp_path):
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


def test_the_names_are_those_of_the_conventions(content):
    play(MOVES)
    conventions = {value for name, value in vars(gen_ai_attributes).items() if name.startswith("GEN_AI_")}
    used = {name for span in EXPORTER.get_finished_spans() for name in span.attributes}
    used |= {name for span in EXPORTER.get_finished_spans() for event in span.events for name in event.attributes}
    assert {name for name in used if name.startswith("gen_ai.")} <= conventions
    assert {name.partition(".")[0] for name in used} == {"gen_ai", "smartplay", "error"}


# --- Afterwards --------------------------------------------------------------------------------------------------


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """A record whose times were kept."""
    stop = keep_times()
    path = tmp_path / "one.jsonl"
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(tool_calls=3), transcript=path) as episode:
        sp.play(episode, sp.ScriptedPlayer(MOVES * 3))
    stop()
    return path


def traced() -> list[tuple[Any, ...]]:
    """The finished spans, without ids and times."""
    finished = sorted(EXPORTER.get_finished_spans(), key=lambda span: (span.start_time, span.end_time, span.name))
    return [(s.name, dict(s.attributes), s.status.status_code, s.parent is None, len(s.events)) for s in finished]


def test_a_record_with_times_has_the_spans_of_the_episode(tmp_path):
    EXPORTER.clear()
    stop, stop_times = smartplay_otel.instrument(PROVIDER, content=True), keep_times()
    path = tmp_path / "one.jsonl"
    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(tool_calls=3), transcript=path) as episode:
        sp.play(episode, sp.ScriptedPlayer(MOVES * 3))
    stop()
    stop_times()
    live, (root,) = traced(), spans("invoke_agent")
    EXPORTER.clear()
    assert smartplay_otel.trace_record(path, PROVIDER, content=True) == 0
    assert sorted(map(str, traced())) == sorted(map(str, live))
    (again,) = spans("invoke_agent")
    assert abs(again.start_time - root.start_time) < 1e9
    assert abs(again.end_time - root.end_time) < 1e9
    assert all(span.start_time <= span.end_time for span in EXPORTER.get_finished_spans())


def test_an_event_without_a_time_counts_as_at_the_event_before(record):
    EXPORTER.clear()
    lines = times_file(record).read_text().splitlines()
    times_file(record).write_text("\n".join([*lines[:4], *lines[6:]]) + "\n")
    assert smartplay_otel.trace_record(record, PROVIDER) == 2
    assert len(spans("invoke_agent")) == 1


def test_a_record_that_is_not_finished_has_finished_spans(record):
    EXPORTER.clear()
    lines = record.read_bytes().splitlines(keepends=True)
    record.write_bytes(b"".join(lines[:-1]))
    times_file(record).write_bytes(b"".join(times_file(record).read_bytes().splitlines(keepends=True)[:-1]))
    smartplay_otel.trace_record(record, PROVIDER)
    assert len(spans("invoke_agent")) == 1


def test_a_record_without_times_cannot_be_traced(record):
    times_file(record).unlink()
    with pytest.raises(sp.SmartPlayError, match="were not kept"):
        smartplay_otel.trace_record(record, PROVIDER)
    assert sp.replay(record).identical, "a record does not need its times"
