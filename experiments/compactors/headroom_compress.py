"""Headroom's compression, with its code unchanged: it takes OpenAI's messages, and shortens long results.

pip install smartplay-tools headroom-ai
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/headroom_compress.py:Compression
"""

from __future__ import annotations

from typing import Any

from headroom.compress import compress

from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory


class Compression(ImportedCompactor):
    """`compress`, told that the room is the model's limit."""

    packages = ("headroom-ai", "tiktoken")

    def make(self) -> Any:
        """Return the function."""
        return compress

    def rewrite(self, history: GivenHistory) -> Any:
        """Compress."""
        return self.made([*history], model="gpt-4o", model_limit=self.limit).messages
