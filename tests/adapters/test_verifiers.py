"""verifiers: its own evaluation, offline, with a player of this package as the model. `.ci/run` has an environment."""

from __future__ import annotations

import asyncio
import itertools
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("verifiers", reason="needs smartplay-tools[verifiers]; `.ci/run` has an environment with it")

import verifiers.v1 as vf
from packaging.requirements import Requirement
from smartplay_gateway import LocalEndpoint
from smartplay_verifiers import (
    SmartPlayConfig,
    SmartPlayHarness,
    SmartPlayHarnessConfig,
    SmartPlayTaskset,
    save_records,
)
from smartplay_verifiers.tasks import BudgetConfig, SmartPlayData
from verifiers.v1.trace import AgentInfo, TraceTask

import smartplay_tools as sp
from smartplay_tools.context.strategies import custom
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.registry import NamedInFiles
from tests.adapters.benchmark_rows import rows_of
from tests.adapters.conformance import GAME, WAY, Held, Window, WindowConformance, act, calling
from tests.adapters.openai_stub import OpenAIStub
from tests.adapters.situations import SituationConformance, lacking
from tests.processes import printed_by

pytestmark = pytest.mark.filterwarnings("ignore")


def launched(
    base_url: str, harness: SmartPlayHarness | None = None, own_cap: int | None = None, **options: Any
) -> tuple[vf.Trace[Any, Any], vf.ProgramResult]:
    """Run a harness as verifiers does, with something else behind the endpoint."""
    task, harness, trace, ctx = rollout(base_url, harness, own_cap, **options)
    return trace, asyncio.run(harness.launch(ctx, trace, None, base_url, "none", {}, task.data))


def rollout(
    base_url: str, harness: SmartPlayHarness | None = None, own_cap: int | None = None, **options: Any
) -> tuple[Any, SmartPlayHarness, vf.Trace[Any, Any], vf.ModelContext]:
    """The task, the harness, the trace and the model of a rollout."""
    harness = harness or SmartPlayHarness(SmartPlayHarnessConfig())
    (task,) = tasks(1, **options)
    agent = AgentInfo(config=vf.AgentConfig(harness=harness.config), name="agent")
    trace = vf.Trace(task=TraceTask(type="SmartPlayTask", data=task.data), agent=agent)
    ctx = vf.ModelContext(
        model="rule", client=vf.EvalClientConfig(base_url=base_url), sampling=vf.Sampling(max_tokens=own_cap)
    )
    return task, harness, trace, ctx


def hold(episode: sp.Episode, script: Iterable[sp.Message], *, own_cap: int | None = None, situation: str = "") -> Held:
    class Given(SmartPlayHarness):
        """Plays an episode that is there already."""

        def new_episode(self, data: SmartPlayData, record: list[Any]) -> sp.Episode:
            return episode

    with OpenAIStub(script) as stub:
        launched(stub.base_url, Given(SmartPlayHarnessConfig()), own_cap)
    return Held(stub.received)


LACKS = lacking("the harness is ours, and every call of its model goes through verifiers' endpoint, which counts it")


class TestConformance(SituationConformance, WindowConformance):
    row = Window(hold, "verifiers `SmartPlayHarness`", lacks=LACKS)


# --- The taskset -------------------------------------------------------------------------------------------------


def tasks(number: int, **options: Any) -> list[Any]:
    return list(itertools.islice(SmartPlayTaskset(SmartPlayConfig(**options)), number))


def test_tasks_are_the_trials_of_an_evaluation():
    trials = tasks(3, game=GAME, seed=5, budget=BudgetConfig(prompt_tokens=700, history="none"))
    assert [task.data.config["seed"] for task in trials] == [trial_seed(5, GAME, trial) for trial in range(3)]
    config = sp.EpisodeConfig(**trials[0].data.config)
    assert (config.budget.prompt_tokens, config.budget.history) == (700, None)
    assert trials[2].data.name == f"{GAME}-2"


def test_a_task_finds_its_strategy_in_another_process(monkeypatch, tmp_path):
    """A config names the file without its folders, so the task has the path beside it."""
    path = Path(__file__).parents[2] / "experiments" / "first_and_newest.py"
    (task,) = tasks(1, game=GAME, budget=BudgetConfig(strategy=f"{path}:FirstAndNewest"))
    assert task.data.config["budget"]["strategy"] == "first_and_newest.py:FirstAndNewest"
    monkeypatch.setattr(custom, "IN_FILES", NamedInFiles("strategy"))  # as in a new process
    monkeypatch.chdir(tmp_path)
    with task.data.episode([]) as episode:
        assert episode.ledger.strategies.custom is not None


@pytest.mark.parametrize(("game", "gold"), [("Hanoi3Disk-v0", "valid"), ("MessengerL1-v0", "unchecked")])
def test_tasks_are_validated_without_a_model(game, gold, tmp_path):
    """The oracle is the reference, where there is one; and what nobody plays does not pass."""
    command = [str(Path(sys.executable).with_name("vf-validate")), "smartplay_verifiers", "--taskset.game", game]
    command += ["-n", "1", "--runtime.type", "subprocess"]
    printed_by(*command, cwd=tmp_path)
    (row,) = map(json.loads, next(tmp_path.rglob("results.jsonl")).read_text(encoding="utf-8").splitlines())
    assert (row["gold"]["reason"], row["noop"]["reason"]) == (gold, "valid")


def test_a_wrong_budget_is_one_sentence():
    with pytest.raises(
        sp.InvalidArgumentError, match=r"^slack=2 is no limit of a budget: .* less than or equal to 1\.$"
    ):
        tasks(1, budget=BudgetConfig(slack=2))


def test_a_game_without_a_human_score_needs_another_reward():
    with pytest.raises(sp.InvalidArgumentError, match='reward="score"'):
        tasks(1, game="Hanoi4Disk-v0")
    assert tasks(1, game="Hanoi4Disk-v0", reward="score")


# --- The harness -------------------------------------------------------------------------------------------------


def test_a_model_that_cannot_be_reached_fails_the_rollout():
    trace, result = launched("http://127.0.0.1:9/v1")
    assert (result.exit_code, trace.info["smartplay"]["result"]["end_reason"]) == (1, "player_error")


@pytest.mark.parametrize(("reward", "expected"), [("normalized", 1.0), ("score", 3.0), ("return", 100.0)])
def test_the_reward_is_the_one_that_the_task_asks_for(reward, expected):
    with LocalEndpoint(sp.get_player("rule")) as endpoint:
        trace, result = launched(endpoint.base_url, reward=reward)
    assert (result.exit_code, trace.info["smartplay"]["reward"]) == (0, expected)


# --- `vf-eval` ---------------------------------------------------------------------------------------------------


def evaluated(folder: Path, *options: str, environment: str = "smartplay_verifiers") -> list[dict[str, Any]]:
    """Run `vf-eval` offline on an environment, and return the traces."""
    script = Path(sys.executable).with_name("vf-eval")
    variables = {**os.environ, "KEY": "none", "NO_PROXY": "127.0.0.1", "PRIME_DISABLE_VERSION_CHECK": "1"}
    with LocalEndpoint(sp.get_player("rule")) as endpoint:
        client = ["--client.base-url", endpoint.base_url, "--client.api-key-var", "KEY"]
        taskset = ["--env.taskset.game", GAME, "--env.taskset.options", '{"manual": "pinned"}']
        output = ["--no-push", "--no-rich", "--output-dir", str(folder)]
        command = [script, environment, "-m", "rule", *client, *taskset, *output, *options]
        done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return [trace for line in lines(folder) for trace in json.loads(line)["traces"]]


def traces_file(folder: Path) -> Path:
    (file,) = folder.glob("**/traces.jsonl")
    return file


def lines(folder: Path) -> list[str]:
    return traces_file(folder).read_text(encoding="utf-8").splitlines()


def leaves(trace: dict[str, Any]) -> int:
    """The branches of a trace's message graph; verifiers trains on each as one sample."""
    return vf.Trace.model_validate(trace).num_branches


def test_an_evaluation_is_rewarded_recorded_and_split_into_rows_where_the_window_moves(tmp_path):
    window = ["--env.taskset.budget.prompt-tokens", "800", "--env.taskset.budget.history", "none"]
    traces = evaluated(tmp_path / "out", "-n", "2", "-r", "2", *window)
    records = save_records(traces_file(tmp_path / "out"), tmp_path / "records")
    assert len(traces) == len(records) == 4
    for trace, record in zip(traces, records, strict=True):
        assert (trace["rewards"]["game_reward"]["score"], trace["metrics"]["score"]) == (1.0, 3.0)
        ours = [event for event in sp.read_transcript(record) if event["event"] == "usage"]
        theirs = [call["usage"]["prompt_tokens"] for call in trace["calls"]]
        assert [event["prompt"] for event in ours] == theirs
        assert max(theirs) <= 800
        assert sp.replay(record).identical
        assert leaves(trace) == rows_of(record) > 1


def test_a_limit_of_verifiers_ends_the_episode_as_the_hosts_and_keeps_the_score(tmp_path):
    (trace,) = evaluated(tmp_path, "-n", "1", "--env.agent.max-turns", "4")
    result = trace["info"]["smartplay"]["result"]
    assert (result["end_reason"], result["detail"], result["turns"]) == ("host", "max_turns", 4)
    assert trace["rewards"]["game_reward"]["score"] == result["normalized_score"]
    assert leaves(trace) == 1, "without a window an episode is one row"


class Slow(OpenAIStub):
    """Answers the third request late."""

    def say(self, path: str, body: dict[str, Any], message: Any) -> dict[str, Any]:
        if len(self.requests) == 3:
            time.sleep(1)
        return super().say(path, body, message)


async def test_a_limit_of_time_keeps_the_score_and_the_record():
    with Slow([calling(act(each)) for each in WAY[:3]]) as stub:
        task, harness, trace, ctx = rollout(stub.base_url)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.7):
                await harness.launch(ctx, trace, None, stub.base_url, "none", {}, task.data)
    await task.finalize(trace, None)
    result, record = trace.info["smartplay"]["result"], trace.info["smartplay"]["record"]
    assert (result["end_reason"], result["detail"], result["steps"]) == ("host", "cancelled", 2)
    assert sp.replay([json.loads(line) for line in record.splitlines()]).identical


def test_a_trace_with_half_a_character_can_be_written():
    with OpenAIStub([calling(("act", '{"action": "half \\ud83d"}')), *[calling(say="Well.")] * 3]) as stub:
        trace, _ = launched(stub.base_url)
    record = json.loads(trace.model_dump_json())["info"]["smartplay"]["record"]
    events = [json.loads(line) for line in record.splitlines()]
    assert any("half \ud83d" in event["text"] for event in events if event["event"] == "call")
    assert sp.replay(events).identical


def test_the_package_for_the_hub_plays_under_the_hubs_name(tmp_path):
    (trace,) = evaluated(tmp_path, "-n", "1", environment="somebody/smartplay-v1")
    assert trace["rewards"]["game_reward"]["score"] == 1.0
    assert trace["info"]["smartplay"]["result"]["end_reason"] == "terminated"
    requirements = [Requirement(needed) for needed in metadata.requires("smartplay-v1") or ()]
    floors = {needed.name: str(needed.specifier) for needed in requirements}
    assert floors["verifiers"] == ">=0.4", "the Hub tells by it that the package is written for verifiers v1"


def test_traces_of_other_tasks_have_no_records(tmp_path):
    file = tmp_path / "traces.jsonl"
    file.write_text(json.dumps({"traces": [{"info": {}, "task": {"data": {"name": "x"}}}]}) + "\n", encoding="utf-8")
    with pytest.raises(sp.SmartPlayError, match="holds no record"):
        save_records(file, tmp_path / "records")


def test_a_record_is_saved_from_its_text(tmp_path):
    events: list[Any] = []
    with sp.Episode(GAME, seed=7, transcript=events) as episode:
        sp.play(episode, sp.get_player("rule"))
    text = "".join(json.dumps(event) + "\n" for event in events)
    traces = [{"info": {"smartplay": {"record": text}}, "task": {"data": {"name": "x"}}}] * 2
    file = tmp_path / "traces.jsonl"
    file.write_text(json.dumps({"traces": traces}) + "\n", encoding="utf-8")
    records = save_records(file, tmp_path / "records")
    assert [sp.replay(record).identical for record in records] == [True, True]
