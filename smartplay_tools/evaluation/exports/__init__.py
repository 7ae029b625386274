"""Exports: finished episodes as the data of other programs, made from their records.

    export("runs/first", "data", "sft", completed=True)

sft            which episodes are exported, and rows for supervised fine-tuning: what a model saw and what it said
atif           trajectories in the Agent Trajectory Interchange Format
dataset_cards  the dataset card that is written beside the data, with warnings about its worlds
export         the formats by name, and the function above
"""

from smartplay_tools.evaluation.exports.export import FORMATS, Exported, export
from smartplay_tools.evaluation.exports.sft import EpisodeSelection

__all__ = ["FORMATS", "EpisodeSelection", "Exported", "export"]
