"""Experiment trackers, to which a run with `--track` sends its figures through the trackers' own clients.

    mlflow    MLflow; its server, file and experiment are those of MLFLOW_TRACKING_URI and MLFLOW_EXPERIMENT_NAME
    wandb     Weights & Biases; WANDB_MODE=offline keeps everything on this machine until `wandb sync`

Both have the same interface (`smartplay_tools.evaluation.runs.tracking.Tracker`), and neither is imported unless it is
asked for.
"""

from smartplay_trackers.mlflow import MLflowTracker
from smartplay_trackers.wandb import WandbTracker

__all__ = ["MLflowTracker", "WandbTracker"]
