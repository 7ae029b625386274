"""Exports: finished episodes as the data of other programs, made from their records.

    export("runs/first", "data", "sft", completed=True)

sft            rows for supervised fine-tuning, and which episodes they are made of
atif           trajectories in the Agent Trajectory Interchange Format
published      results in the formats of those who collect them
dataset_cards  the dataset card that is written beside the data, with warnings about its worlds
export         the formats by name, and the function above
"""

from smartplay_tools.evaluation.exports.export import FORMATS, RESULTS, Exported, export
from smartplay_tools.evaluation.exports.published import Publication
from smartplay_tools.evaluation.exports.sft import EpisodeSelection

__all__ = ["FORMATS", "RESULTS", "EpisodeSelection", "Exported", "Publication", "export"]
