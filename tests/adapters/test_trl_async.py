"""TRL's AsyncGRPO on OpenEnv's harness: the rollouts and their training rows, with a script in vLLM's place.

`.ci/run` has an environment with both. The worker's loop is TRL's own, but for the one method that asks vLLM.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from functools import partial

import pytest

pytest.importorskip("trl", reason="needs smartplay-tools[trl]; `.ci/run` has an environment with it")
pytest.importorskip("openenv", reason="needs smartplay-tools[openenv]; `.ci/run` has an environment with it")

from openenv.core.harness import HarnessRunLimits
from smartplay_openenv import SmartPlayHarness, SmartPlaySessions
from trl.chat_template_utils import add_response_schema
from trl.experimental.async_grpo.openenv_harness import _HarnessRolloutLoop

import smartplay_tools as sp
from tests.adapters import tiny_model
from tests.adapters.benchmark_rows import rows_of
from tests.adapters.conformance import GAME, WAY, move

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def event_loop_thread() -> Iterator[asyncio.AbstractEventLoop]:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    yield loop
    loop.call_soon_threadsafe(loop.stop)
    thread.join()


class RolloutLoop(_HarnessRolloutLoop):
    """TRL's loop around a session; its own constructor would connect to vLLM."""

    def __init__(self, sessions: SmartPlaySessions, event_loop: asyncio.AbstractEventLoop) -> None:
        self.tokenizer = add_response_schema(tiny_model.tokenizer())
        self.chat_template, self.chat_template_kwargs = None, {}
        self._loop, self._stop_event = event_loop, threading.Event()
        self._factory, self._adapter = sessions, SmartPlayHarness()
        self._limits = HarnessRunLimits(max_turns=100)
        self._rollout_reward_fn, self._fork_threshold_tokens, self._live_sessions = None, 0, set()
        self._moves = iter(WAY)

    async def _generate_one_turn(self, prompt_ids: list[int]) -> tuple[list[int], list[float]]:
        call = {"name": "act", "arguments": {"action": move(next(self._moves))}}
        text = f"<tool_call>\n{json.dumps(call)}\n</tool_call><|im_end|>"
        ids = self.tokenizer(text, add_special_tokens=False)["input_ids"]
        return ids, [-0.1] * len(ids)


@pytest.mark.parametrize(
    ("budget", "expected"),
    [
        (sp.Budget(history=None), 1),
        (sp.Budget(history=None, prompt_tokens=700), 3),
        (sp.Budget(history=None, prompt_tokens=700, slack=0.7), 2),
    ],
    ids=["no window", "slack 0", "slack 0.7"],
)
def test_an_episode_has_as_many_training_rows_as_its_record_says(budget, expected, tmp_path, event_loop_thread):
    sessions = partial(SmartPlaySessions, GAME, budget=budget, records=tmp_path)()
    rollout, metrics = RolloutLoop(sessions, event_loop_thread)._run_session(None, group_id=7)
    _, completion_ids, sequences, calls, failed, reward = rollout
    assert (reward, calls, failed) == (1.0, 7, 0)
    assert len(sequences) == metrics["sequences"] == expected
    assert sum(sum(sequence.completion_mask) for sequence in sequences) == len(completion_ids)
    (record,) = tmp_path.glob("7.*.jsonl")
    assert sp.replay(record).identical
    assert rows_of(record) == expected
