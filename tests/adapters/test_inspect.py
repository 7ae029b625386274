"""Inspect AI, with its mock model and its command line: `.ci/run` has an environment with it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("inspect_ai", reason="needs smartplay-tools[inspect]; `.ci/run` has an environment with it")

import anyio
from inspect_ai import Task, eval as evaluate, score
from inspect_ai.agent import AgentState, agent_bridge
from inspect_ai.dataset import Sample
from inspect_ai.log import EvalLog, EvalSample, read_eval_log
from inspect_ai.model import (
    ChatCompletionChoice,
    ChatMessageAssistant,
    ContentReasoning,
    ContentText,
    ModelOutput,
    ModelUsage,
    get_model,
)
from inspect_ai.model._call_tools import parse_tool_call
from inspect_ai.solver import Generate, Solver, TaskState, solver, use_tools
from inspect_ai.tool import ToolCall, ToolDef
from smartplay_inspect import Played, save_records, smartplay, smartplay_agent, smartplay_scorer
from smartplay_inspect.messages import from_inspect, from_output

import smartplay_tools as sp
from tests.adapters.conformance import (
    BASIC,
    BUDGETS,
    EACH,
    SEED,
    Held,
    Received,
    Sent,
    Window,
    WindowConformance,
    by_conversation,
    calling,
    fresh,
    one_system,
    spelled,
    without_usage,
)
from tests.adapters.situations import SITUATIONS, SituationConformance, lacking
from tests.dialects.rules import DIALECTS
from tests.dialects.scripts import SOLVED
from tests.dialects.server import DialectServer
from tests.dialects.ways import reached
from tests.processes import printed_by

# Inspect and what it imports warn; what they warn of is theirs.
pytestmark = pytest.mark.filterwarnings("ignore")

USAGE = ModelUsage(
    input_tokens=EACH.prompt - EACH.cached,
    output_tokens=EACH.reply,
    total_tokens=EACH.prompt + EACH.reply,
    input_tokens_cache_read=EACH.cached,
)
SAY_ROCK = calling(("act", {"action": "Rock"}))


@pytest.fixture(autouse=True)
def _logs_go_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INSPECT_LOG_DIR", str(tmp_path / "logs"))


def output(message: sp.Message) -> ModelOutput:
    """A reply as Inspect's providers give it."""
    calls = [parsed(call["id"], **call["function"]) for call in message.get("tool_calls", ())]
    reply = ChatMessageAssistant(content=message["content"] or "", tool_calls=calls or None)
    return ModelOutput(model="mockllm", choices=[ChatCompletionChoice(message=reply)], usage=USAGE)


def parsed(call_id: str, name: str, arguments: str) -> ToolCall:
    """A call as a provider of Inspect's gives it, without what Inspect repairs first."""
    try:
        value = json.loads(arguments)
    except ValueError:
        value = None
    if isinstance(value, dict):
        return ToolCall(call_id, name, value)
    return ToolCall(call_id, name, {}, parse_error=arguments)


class Scripted:
    """A model that says what a script says, and keeps what it was sent."""

    def __init__(self, script: Iterable[sp.Message]) -> None:
        self.script: Iterator[sp.Message] = iter(script)
        self.received: Sent = []

    def __call__(self, messages: Any, tools: Any, tool_choice: Any, config: Any) -> ModelOutput:
        described = [(t.name, t.description, t.parameters.model_dump(exclude_none=True)) for t in tools]
        canonical = one_system([dict(from_inspect(message)) for message in messages])
        self.received.append(Received(canonical, described, config.max_tokens))
        return output(next(self.script))


def run(task: Task, model: Callable[..., Any], **options: Any) -> EvalLog:
    (log,) = evaluate(task, model=get_model("mockllm/model", custom_outputs=model), display="none", **options)
    return log


def sample_of(log: EvalLog) -> EvalSample:
    assert log.status == "success", log.error
    (sample,) = log.samples or ()
    return sample


def hold(episode: sp.Episode, script: Iterable[sp.Message], *, own_cap: int | None = None, situation: str = "") -> Held:
    model = Scripted(script)
    other = [ToolDef(function).as_tool() for function in fresh(seed=SEED + 1)[0].functions()] if situation else []
    agent = smartplay_agent(lambda state, record: episode)
    task = Task([Sample(input="Play.")], solver=[use_tools(*other), agent] if "another" in situation else agent)
    sample = sample_of(run(task, model, max_tokens=own_cap))
    (usage,) = sample.model_usage.values()
    prompt = usage.input_tokens + (usage.input_tokens_cache_read or 0)
    return Held(model.received, sp.Usage(prompt=prompt, reply=usage.output_tokens))


LACKS = lacking(
    "the loop in Inspect's solver is ours: there is no agent of a host's, nor tools or messages of its own",
    *(SITUATIONS.keys() - {"another episode", "usage"}),
)


class TestConformance(SituationConformance, WindowConformance):
    row = Window(hold, "Inspect AI `smartplay_agent`", lacks=LACKS)


def test_a_model_that_is_asked_to_manage_the_context_says_so():
    episode, _ = fresh()
    task = Task([Sample(input="Play.")], solver=smartplay_agent(lambda state, record: episode))
    sample_of(run(task, Scripted(BASIC), extra_body={"context_management": {"edits": []}}))
    assert episode.result.tokens.provider.managed == episode.result.turns


@pytest.mark.parametrize("player", ["openai", "openai-responses"])
@pytest.mark.parametrize("name", ["free", "tight"])
def test_a_player_of_openais_client_sends_every_prompt_through_inspects_bridge(player, name):
    """The bridge reads the fields of the client's method; what were only in its `extra_body` would be lost there."""
    episode, record = fresh(BUDGETS[name])
    model = Scripted(BASIC)

    @solver
    def bridged() -> Solver:
        async def solve(state: TaskState, generate: Generate) -> TaskState:
            async with agent_bridge(AgentState(messages=[])):
                with episode:
                    await sp.aplay(episode, sp.get_player(f"{player}:inspect", base_url="http://127.0.0.1:9/v1"))
            return state

        return solve

    sample_of(run(Task([Sample(input="Play.")], solver=bridged()), model))
    expected, _ = fresh(BUDGETS[name])
    with expected:
        prompts, *_ = by_conversation(expected, BASIC)
    assert list(map(spelled, model.received)) == list(map(spelled, prompts))
    assert without_usage(episode.result) == without_usage(expected.result)
    assert sp.replay(record).identical


@pytest.mark.parametrize(
    ("limit", "detail"),
    [
        ({"message_limit": 11}, "message_limit"),
        ({"token_limit": 6 * USAGE.total_tokens}, "token_limit"),
        ({"turn_limit": 4}, "turn_limit"),
        ({"time_limit": 1}, "time_limit"),
        ({"working_limit": 1}, "working_limit"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_limit_of_inspects_ends_the_episode_and_keeps_the_score(limit, detail):
    async def answer(*_: Any) -> ModelOutput:
        await anyio.sleep(0.2 if detail in ("time_limit", "working_limit") else 0)
        return output(SAY_ROCK)

    sample = sample_of(run(smartplay("RockPaperScissorBasic-v0", trials=1), answer, **limit))
    result = sample.store_as(Played).result
    assert (result["end_reason"], result["detail"]) == ("host", detail)
    assert sample.limit is not None
    assert 0 < result["steps"] < 50
    assert sample.scores["smartplay_scorer"].value["score"] == result["score"]
    assert sample.scores["smartplay_scorer"].explanation == f"host: {detail}"


def test_a_model_that_fails_fails_its_sample_and_leaves_a_record(tmp_path):
    def answer(*_: Any) -> ModelOutput:
        raise RuntimeError("no model here")

    log = run(smartplay("Hanoi3Disk-v0", trials=1), answer)
    assert log.status == "error"
    (sample,) = log.samples
    assert sample.store_as(Played).result["end_reason"] == "player_error"
    (record,) = save_records(log, tmp_path / "records")
    assert sp.replay(record).identical


def test_the_reasoning_of_a_reply_goes_back_to_the_model_and_into_the_record():
    seen: list[Any] = []
    thinking = ContentReasoning(reasoning="Paper is likely.", signature="c2lnbmVk")

    def answer(messages: Any, *_: Any) -> ModelOutput:
        seen.append(messages)
        reply = output(SAY_ROCK)
        reply.message.content = [thinking, ContentText(text="Rock.")]
        return reply

    sample = sample_of(run(smartplay("RockPaperScissorBasic-v0", trials=1, tool_calls=2), answer))
    (first,) = [message for message in seen[1] if message.role == "assistant"]
    assert first.content[0] == thinking
    record = list(map(json.loads, sample.store_as(Played).record.splitlines()))
    reply = next(event for event in record if event["event"] == "message")["message"]
    assert reply["reasoning_content"] == "Paper is likely."
    assert reply["provider_items"][0]["parts"][0]["signature"] == "c2lnbmVk"


def test_a_message_that_is_shown_again_keeps_its_id():
    seen: list[Any] = []

    def answer(messages: Any, *_: Any) -> ModelOutput:
        seen.append([message.id for message in messages])
        return output(SAY_ROCK)

    run(smartplay("RockPaperScissorBasic-v0", trials=1, tool_calls=3), answer)
    assert seen[0] == seen[1][:2] == seen[2][:2]
    assert len(seen[2]) == len({*seen[2]}) == 6


def test_arguments_that_inspect_could_not_parse_are_counted_as_they_were_sent():
    sent = '{"action": "Rock'
    reply = ModelOutput.from_message(ChatMessageAssistant(content="", tool_calls=[parse_tool_call("1", "act", sent)]))
    assert from_output(reply).message["tool_calls"][0]["function"]["arguments"] == sent


def test_half_a_character_is_recorded_and_the_log_can_be_written():
    odd = calling(("act", '{"action": "half \\ud83d"}'), say="half \ud83d")
    sample = sample_of(run(smartplay("RockPaperScissorBasic-v0", trials=1, tool_calls=3), lambda *_: output(odd)))
    record = list(map(json.loads, sample.store_as(Played).record.splitlines()))
    assert next(event for event in record if event["event"] == "message")["message"]["content"] == "half \ud83d"
    assert sample.store_as(Played).result["illegal_actions"] == 3
    assert sp.replay(record).identical


CUT = """
import smartplay_tools as sp

class Cut:
    name = "cut"

    def __init__(self, seed=None):
        self.usage = [sp.Usage(prompt=125, reply=7, cached=100, written=20, reasoning=3, cut=1), sp.Usage(cut=1)]

    def reply(self, prompt):
        return sp.Reply({"role": "assistant", "content": "Hm."}, self.usage.pop(0) if self.usage else None)
"""


def test_a_players_model_reports_the_usage_of_its_player(tmp_path):
    (tmp_path / "cut.py").write_text(CUT, encoding="utf-8")
    task = smartplay("RockPaperScissorBasic-v0", trials=1)
    (log,) = evaluate(task, model=f"smartplay/{tmp_path / 'cut.py'}:Cut", display="none")
    (sample,) = log.samples
    outputs = [event.output for event in sample.events if event.event == "model"]
    assert [output.stop_reason for output in outputs] == ["max_tokens", "max_tokens", "stop"]
    first, second, third = (from_output(output).usage for output in outputs)
    assert first == sp.Usage(prompt=125, reply=7, cached=100, written=20, reasoning=3, cut=1)
    assert second.prompt > 100  # tokens that nobody has reported are counted
    assert third.prompt > second.prompt


@pytest.mark.parametrize(("reason", "cut"), [("max_tokens", 1), ("model_length", 1), ("stop", 0)])
def test_a_reply_that_was_cut_at_its_length_is_counted_as_one(reason, cut):
    output = ModelOutput.from_content("m", "I thi", stop_reason=reason)
    output.usage = ModelUsage(input_tokens=9, output_tokens=2)
    assert from_output(output).usage == sp.Usage(prompt=9, reply=2, cut=cut)
    output.usage = None
    assert from_output(output).usage == (sp.Usage(cut=1) if cut else None)


def test_the_counts_where_the_model_receives_its_prompt_are_ours_and_the_record_replays(tmp_path):
    """The player's model counts what reaches it."""
    task = smartplay(["Hanoi3Disk-v0", "RockPaperScissorBasic-v0"], trials=2, prompt_tokens=700)
    (log,) = evaluate(task, model="smartplay/rule", display="none")
    assert log.status == "success"
    for sample in log.samples:
        events = [json.loads(line) for line in sample.store_as(Played).record.splitlines()]
        ours = [event["tokens"] for event in events if event["event"] == "view"]
        counted = [event.output.usage.input_tokens for event in sample.events if event.event == "model"]
        assert counted == ours
        assert max(ours) <= 700
        assert events[0]["config"]["player"] == "inspect:smartplay/rule"
    records = save_records(log.location, tmp_path / "records")
    assert len(records) == 4
    assert all(sp.replay(record).identical for record in records)
    shown = {
        (score.name, metric.name): metric.value for score in log.results.scores for metric in score.metrics.values()
    }
    assert shown["normalized_score", "Hanoi3Disk-v0"] == 1.0
    assert shown["score", "RockPaperScissorBasic-v0 low"] < shown["score", "RockPaperScissorBasic-v0 high"]


def test_a_trial_is_the_world_of_the_same_trial_in_eval(tmp_path):
    sp.evaluate(["Hanoi3Disk-v0"], ["rule"], trials=3, seed=5, out=tmp_path / "run")
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    seeds = [sample.metadata["seed"] for sample in smartplay("Hanoi3Disk-v0", trials=3, seed=5).dataset]
    assert seeds == [episode["seed"] for episode in manifest["episodes"]]


def test_samples_that_run_at_once_do_not_disturb_each_other():
    def scores(samples: int) -> list[Any]:
        task = smartplay("BanditTwoArmedHighLowFixed-v0", trials=3)
        (log,) = evaluate(task, model="smartplay/random", display="none", max_samples=samples)
        return [sample.store_as(Played).result["state_hash"] for sample in log.samples]

    assert scores(1) == scores(3)


def test_a_score_can_be_made_again_from_the_log():
    log = run(smartplay("RockPaperScissorBasic-v0", trials=1, tool_calls=2), lambda *_: output(SAY_ROCK))
    again = score(log, smartplay_scorer(), action="overwrite", display="none")
    assert again.samples[0].scores["smartplay_scorer"].value == log.samples[0].scores["smartplay_scorer"].value


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"game": "Hanoi9Disk-v0"}, "Hanoi9Disk-v0"),
        ({"prompt_tokens": 0}, "prompt_tokens"),
        ({"trials": 0}, "trials must be at least 1"),
        ({"manual": "never"}, "manual must be one of"),
    ],
    ids=str,
)
def test_what_cannot_be_played_is_said_before_a_model_is_asked(arguments, sentence):
    with pytest.raises(sp.SmartPlayError, match=sentence):
        smartplay(**arguments)


def test_no_limit_is_written_as_a_word():
    (sample,) = smartplay("Hanoi3Disk-v0", trials=1, history="none", tool_calls=9).dataset
    assert sp.EpisodeConfig(**sample.metadata["config"]).budget == sp.Budget(history=None, tool_calls=9)


def test_the_command_line(tmp_path):
    """As a user runs it, with the installed package: Inspect finds its tasks and models by their entry point."""
    words = ["-T", "game=Hanoi3Disk-v0", "-T", "prompt_tokens=700", "-T", "trials=2", "--display", "plain"]
    program = Path(sys.executable).with_name("inspect")
    command = [str(program), "eval", "smartplay_inspect/smartplay", "--model", "smartplay/rule", *words]
    made = subprocess.run([*command, "--log-dir", str(tmp_path / "logs")], cwd=tmp_path, capture_output=True, text=True)
    if "No inspect tasks were found" in made.stdout + made.stderr:
        pytest.skip("Inspect does not see the tasks of an editable installation; `.ci/run` installs the wheel")
    assert made.returncode == 0, made.stdout + made.stderr
    (file,) = (tmp_path / "logs").glob("*.eval")
    log = read_eval_log(str(file))
    assert log.eval.task == "smartplay_inspect/smartplay"
    assert [sample.scores["smartplay_scorer"].value["normalized_score"] for sample in log.samples] == [1.0, 1.0]


def test_a_task_runs_by_its_file_as_a_register_of_evaluations_runs_it(tmp_path):
    task = f"{Path(__file__).parents[2] / 'adapters' / 'smartplay_inspect' / 'tasks.py'}@smartplay"
    words = ["--model", "smartplay/rule", "-T", "trials=1", "--display", "none", "--log-dir", str(tmp_path / "logs")]
    program = Path(sys.executable).with_name("inspect")
    printed_by(str(program), "eval", task, *words, cwd=tmp_path)
    (file,) = (tmp_path / "logs").glob("*.eval")
    (sample,) = read_eval_log(str(file)).samples
    assert sample.scores["smartplay_scorer"].value["score"] == 3


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({}, "ours"),
        ({"cache_prompt": False}, None),
        ({"extra_body": {"prompt_cache_key": "mine"}}, "mine"),
        ({"model_args": {"prompt_cache_key": "mine"}}, "mine"),
    ],
)
@pytest.mark.parametrize("responses", [False, True])
def test_openai_is_told_which_prompts_belong_to_an_episode(options, key, responses):
    episode, _ = fresh(sp.Budget(tool_calls=3))
    arguments = {"responses_api": responses, "api_key": "k", **options.get("model_args", {})}
    # Before its first Responses request, Inspect asks whether the model can summarise its reasoning.
    dialect = DIALECTS["OpenAI Responses" if responses else "OpenAI"]
    server = DialectServer(replace(dialect, model="gpt-5.5", cannot=["thoughts"]), SOLVED)
    with reached(server), episode:
        model = get_model("openai/gpt-5.5", memoize=False, base_url=server.base_url, **arguments)
        task = Task([Sample(input="Play.")], solver=smartplay_agent(lambda state, record: episode))
        own = {name: value for name, value in options.items() if name != "model_args"}
        (log,) = evaluate(task, model=model, display="none", max_retries=0, **own)
    sample_of(log)
    prompts = [body for body in server.requests if "tools" in body]
    assert [body.get("prompt_cache_key") for body in prompts] == [episode.config.key if key == "ours" else key] * 3
