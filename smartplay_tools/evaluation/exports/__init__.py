"""Exports: finished episodes as the data of other programs, made from their records.

    export("runs/first", "data", "sft", completed=True)

sft            rows for supervised fine-tuning
export         the formats by name, which episodes are exported, and the function above
"""

from smartplay_tools.evaluation.exports.export import FORMATS, Exported, export

__all__ = ["FORMATS", "Exported", "export"]
