"""Imported compactors: the compaction of other projects by name, each with its code unchanged.

`IMPORTED` lists them. Each is a class of the adapter of its framework, which converts messages with the adapter's
functions and calls what the framework's own agents call. `ImportedCompactor` is what these classes share: the
framework's questions to a model become questions of the compactor, our counter takes the place of its tokenizer, and
the versions of its packages are in the record.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Any, ClassVar

from smartplay_tools.context.compaction import ContextOverflowError, Room, asked
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types import Prompt, Reply
from smartplay_tools.types.messages import Message, pictures_of

__all__ = ["IMPORTED", "ImportedCompactor"]

IMPORTED = {
    "adk-summary": "smartplay_compactors.adk:Compaction",
    "agent-framework-summary": "smartplay_compactors.agent_framework:Summary",
    "deepagents-summary": "smartplay_langchain.compaction:DeepAgentsSummary",
    "inspect-edit": "smartplay_inspect.compaction:Edit",
    "inspect-summary": "smartplay_inspect.compaction:Summary",
    "inspect-trim": "smartplay_inspect.compaction:Trim",
    "langchain-clear": "smartplay_langchain.compaction:Clearing",
    "langchain-summary": "smartplay_langchain.compaction:Summary",
    "langmem-summary": "smartplay_langchain.compaction:LangMemSummary",
    "llama-index-summary": "smartplay_compactors.llama_index:Summary",
    "memory-bm25": "smartplay_tools.context.strategies.retrieval:WordMemory",
    "memory-wordllama": "smartplay_compactors.embeddings:VectorMemory",
    "openhands-summary": "smartplay_compactors.openhands:Summary",
    "pydantic-ai-newest": "smartplay_pydantic_ai.compaction:Newest",
    "pydantic-ai-summary": "smartplay_pydantic_ai.compaction:Summary",
    "pydantic-ai-window": "smartplay_pydantic_ai.compaction:Window",
}
"""The place of each class by the name of the strategy."""

SHARE = 0.8
"""How full the room for the conversation is when a compactor acts that was not told at how many tokens."""


class ImportedCompactor(ABC):
    """The compaction of a framework, for one episode.

    It is also the player behind the framework's class for models: a prompt that it is asked to reply to is a question.

    Arguments:
        tokens: where it begins to act, in tokens of the conversation; four fifths of the room for it by default.
        keep: how many of the newest messages, turns or results it keeps, in the framework's terms.
    """

    name = "compactor"
    persistent: ClassVar[bool] = False
    packages: ClassVar[tuple[str, ...]]
    """The packages of the framework, whose versions are recorded."""
    overflow: Callable[[str], Exception] = ContextOverflowError
    """What the framework takes for a full context."""

    def __init__(self, tokens: int | None = None, keep: int = 6) -> None:
        self.tokens, self.keep = tokens, keep
        self.made: Any = None
        """The framework's object."""
        self.room: Room
        self.ask: Callable[[Sequence[Message]], Message]
        """Asks the model, and waits for its reply."""

    @abstractmethod
    def make(self, limit: int) -> Any:
        """Return the framework's object, which begins to act at `limit` tokens."""

    @abstractmethod
    def rewrite(self, history: Sequence[Message]) -> Any:
        """Return the messages that the framework makes of a history; blocking or asynchronous."""

    def compact(self, history: Sequence[Message], room: Room) -> Generator[list[Message], Message, list[Message]]:
        """Have the framework rewrite the history, and yield what it asks a model."""
        if any(pictures_of(message) for message in history):
            raise InvalidArgumentError(f"{type(self).__name__} rewrites words; leave out observation and pictures.")
        self.room = room
        if self.made is None:
            self.made = self.make(self._limit())

        def work(ask: Callable[[Sequence[Message]], Message]) -> Any:
            self.ask = ask
            return self.rewrite(history)

        return asked(work, overflow=self.overflow)

    def reply(self, prompt: Prompt) -> Reply:
        """Answer a prompt of the framework's class for models."""
        return Reply(self.ask(prompt.messages))

    def count(self, messages: Iterable[Message]) -> int:
        """Return the tokens of messages as the window counts them."""
        return self.room.count(list(messages))

    def count_text(self, text: str) -> int:
        """Return the tokens of a text, for frameworks that count no messages."""
        return self.count([{"role": "user", "content": text}]) - self.count([{"role": "user", "content": ""}])

    def _limit(self) -> int:
        if self.tokens is not None:
            return self.tokens
        if self.room.tokens is None:
            raise InvalidArgumentError("A compactor needs prompt_tokens, or its option tokens=N, to know when to act.")
        return int(SHARE * self.room.tokens)
