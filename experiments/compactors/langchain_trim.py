"""`trim_messages` of langchain-core, with its code unchanged: the newest messages that fit.

pip install 'smartplay-tools[langchain]'
smartplay-tools eval ... --prompt-tokens 1500 --strategy experiments/compactors/langchain_trim.py:Trim
"""

from __future__ import annotations

from dataclasses import dataclass

from langchain_core.messages import trim_messages
from smartplay_langchain.messages import from_langchain, to_langchain

from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory


@dataclass(eq=False)
class Trim(ImportedCompactor):
    """Keeps the newest messages, and begins with a user's, as its documentation has it: with none, nothing is left."""

    start_on: str = "human"
    packages = ("langchain-core",)

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Trim."""
        kept = trim_messages(
            to_langchain(history),
            max_tokens=self.limit,
            token_counter=lambda messages: self.count(map(from_langchain, messages)),
            strategy="last",
            start_on=self.start_on,
        )
        return [from_langchain(message) for message in kept]
