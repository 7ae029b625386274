"""Experiment trackers, to which a run with `--track` sends its figures through the trackers' own clients.

    MLflowTracker  a run of MLflow, at MLFLOW_TRACKING_URI in MLFLOW_EXPERIMENT_NAME
    WandbTracker   a run of Weights & Biases; WANDB_MODE=offline keeps everything on this machine until `wandb sync`

Both have the same interface (`smartplay_tools.evaluation.runs.tracking.Tracker`), and neither is imported unless it is
asked for. A run of Weights & Biases has a line of its history for every episode, a run of MLflow a step for every
episode of a cell.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

__all__ = [
    "MLflowTracker",
    "WandbTracker",
]


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


EXPERIMENT = "smartplay-tools"


class MLflowTracker:
    """A run in MLflow."""

    def __init__(self, name: str, facts: Mapping[str, str]) -> None:
        """Begin a run with this name; `facts` are its parameters."""
        from mlflow import MlflowClient

        self._client = MlflowClient()
        wanted = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
        existing = self._client.get_experiment_by_name(wanted)
        experiment = self._client.create_experiment(wanted) if existing is None else existing.experiment_id
        self._run: str = self._client.create_run(experiment, run_name=name).info.run_id
        for fact, value in facts.items():
            self._client.log_param(self._run, fact, value)

    def log(self, figures: Mapping[str, float], step: int) -> None:
        """Log the figures of an episode, the step-th one of its cell."""
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        self._client.log_batch(self._run, [Metric(key, value, now, step) for key, value in figures.items()])

    def close(self, figures: Mapping[str, float], *, complete: bool) -> None:
        """Log the figures of the whole run, and end it."""
        self.log(figures, 0)
        self._client.set_terminated(self._run, "FINISHED" if complete else "KILLED")
