"""Exports: finished episodes as the data of other programs, made from their records.

    export("runs/first", "data", "sft", completed=True)

sft            rows for supervised fine-tuning, and which episodes they are made of
export         the formats by name, and the function above
"""

from smartplay_tools.evaluation.exports.export import FORMATS, Exported, export
from smartplay_tools.evaluation.exports.sft import EpisodeSelection

__all__ = ["FORMATS", "EpisodeSelection", "Exported", "export"]
