"""TRL: a game as the environment of `GRPOTrainer`, which trains a model by reinforcement learning.

    data = Dataset.from_dict(rows("Hanoi3Disk-v0", range(1_000_000, 1_001_000)))
    GRPOTrainer(..., train_dataset=data, environment_factory=environment("Hanoi3Disk-v0", reward="normalized"))

`environment` makes a class as the trainer wants it: the game's tools are its methods, a row of the dataset chooses the
seed, and the reward of a rollout is the game's. `GRPOTrainer` shows its model a conversation that only grows; a loop of
your own around a `Conversation`, and `smartplay_verifiers`, train in the exact context window.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_trl", "trl"):
    import trl as _trl  # noqa: F401

from smartplay_trl.environment import GameEnvironment, environment, rows, tools_as_text

__all__ = ["GameEnvironment", "environment", "rows", "tools_as_text"]
