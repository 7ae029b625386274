"""verifiers: the games as a taskset, and a harness that shows a model the exact context window.

    vf-eval smartplay_verifiers -n 10 -m MODEL --env.taskset.game Hanoi3Disk-v0 --env.taskset.budget.prompt-tokens 1500

Tasks are seeds. The harness plays in the process of the evaluation, and every call of the model goes through verifiers,
which records it for training.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_verifiers", "verifiers"):
    import verifiers as _verifiers  # noqa: F401

from smartplay_verifiers.harness import SmartPlayHarness, SmartPlayHarnessConfig
from smartplay_verifiers.tasks import (
    SmartPlayConfig,
    SmartPlayData,
    SmartPlayEnv,
    SmartPlayEnvConfig,
    SmartPlayTask,
    SmartPlayTaskset,
    save_records,
)

__all__ = [
    "SmartPlayConfig",
    "SmartPlayData",
    "SmartPlayEnv",
    "SmartPlayEnvConfig",
    "SmartPlayHarness",
    "SmartPlayHarnessConfig",
    "SmartPlayTask",
    "SmartPlayTaskset",
    "save_records",
]
