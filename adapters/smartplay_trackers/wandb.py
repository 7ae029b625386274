"""Weights & Biases: a run of the project, with a line of its history for every episode."""

from __future__ import annotations

import os
from collections.abc import Mapping

PROJECT = "smartplay-tools"


class WandbTracker:
    """A run in Weights & Biases."""

    def __init__(self, name: str, facts: Mapping[str, str]) -> None:
        """Begin a run with this name; `facts` are its config."""
        import wandb

        project = None if "WANDB_PROJECT" in os.environ else PROJECT
        quiet = wandb.Settings(console="off", silent=True)
        self._run = wandb.init(project=project, name=name, config=dict(facts), settings=quiet)

    def log(self, figures: Mapping[str, float], step: int) -> None:
        """Log the figures of an episode, the step-th one of its cell."""
        cells = {key.rpartition("/")[0] for key in figures}
        self._run.log({**figures, **{f"{cell}/episode": step for cell in cells}})

    def close(self, figures: Mapping[str, float], *, complete: bool) -> None:
        """Write the figures of the whole run into its summary, and end it."""
        self._run.summary.update(dict(figures))
        self._run.finish(exit_code=0 if complete else 1)
