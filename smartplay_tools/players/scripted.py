"""The scripted player: gives prepared replies, for tests and demonstrations."""

from __future__ import annotations

from collections.abc import Iterable

from smartplay_tools.types import Prompt, Reply, Usage
from smartplay_tools.types.messages import Message


class ScriptedPlayer:
    """Replies with the given messages in order, and stores the prompts that it received in `prompts`."""

    name = "scripted"
    observations = ("text", "picture", "both")

    def __init__(self, messages: Iterable[Message], usage: Usage | None = None) -> None:
        self._messages = iter(messages)
        self._usage = usage
        self.prompts: list[Prompt] = []

    def reply(self, prompt: Prompt) -> Reply:
        """Return the next message as a reply; raise StopIteration when there is no further message."""
        self.prompts.append(prompt)
        return Reply(next(self._messages), self._usage)
