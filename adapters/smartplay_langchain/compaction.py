"""Compactors of LangChain, deepagents and langmem, with their code unchanged.

Middlewares are called as an agent's loop calls them: those that rewrite the state before the model is called, and those
that edit the request. langmem's is a node of a graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from tempfile import TemporaryDirectory
from typing import Any

from langchain.agents.middleware import (
    AgentMiddleware,
    ClearToolUsesEdit,
    ContextEditingMiddleware,
    ExtendedModelResponse,
    ModelRequest,
    ModelResponse,
    SummarizationMiddleware,
)
from langchain_core.exceptions import ContextOverflowError
from langchain_core.messages import AIMessage, BaseMessage, RemoveMessage

from smartplay_langchain.chat_model import PlayerChatModel
from smartplay_langchain.messages import from_langchain, to_langchain
from smartplay_tools import Message
from smartplay_tools.context.strategies.imported import ImportedCompactor
from smartplay_tools.errors import extra_named


class LangChainCompactor(ImportedCompactor):
    """What compactors that work on LangChain's messages have in common."""

    packages = ("langchain", "langchain-core")
    overflow = ContextOverflowError

    @property
    def model(self) -> PlayerChatModel:
        """The model to summarize with."""
        return PlayerChatModel(player=self)

    def counter(self, messages: Iterable[BaseMessage], **_: Any) -> int:
        """Count LangChain's messages."""
        return self.count(map(from_langchain, messages))


class Summary(LangChainCompactor):
    """`SummarizationMiddleware`: a summary takes the place of all but the newest messages in the agent's state."""

    persistent = True

    def make(self, limit: int) -> AgentMiddleware[Any, Any, Any]:
        """Return the middleware."""
        return SummarizationMiddleware(
            self.model, trigger=("tokens", limit), keep=("messages", self.keep), token_counter=self.counter
        )

    def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Call the middleware before a call of the model."""
        state = {"messages": to_langchain(history)}
        made = self.made.before_model(state, None) or state
        return [from_langchain(message) for message in made["messages"] if not isinstance(message, RemoveMessage)]


class Clearing(LangChainCompactor):
    """`ContextEditingMiddleware`: a mark takes the place of old results in the request."""

    def make(self, limit: int) -> AgentMiddleware[Any, Any, Any]:
        """Return the middleware."""
        edit = ClearToolUsesEdit(trigger=limit, keep=self.keep)
        return ContextEditingMiddleware(edits=[edit], token_counter=self.counter)

    def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Have the middleware edit a request."""
        sent: list[Message] = []
        self.request(history, {}, sent)
        return sent

    def request(self, history: Sequence[Message], state: dict[str, Any], sent: list[Message]) -> Any:
        """Send a request through the middleware; `sent` receives the messages that the model would be called with."""

        def handler(request: ModelRequest[Any]) -> ModelResponse[Any]:
            is_first, sent[:] = not sent, map(from_langchain, request.messages)
            self.take(sent, is_first)
            return ModelResponse(result=[AIMessage("")])

        messages = to_langchain(history)
        request: Any = ModelRequest(
            model=self.model, messages=messages, state={**state, "messages": messages}, runtime=None
        )
        return self.made.wrap_model_call(request, handler)

    def take(self, sent: Sequence[Message], is_first: bool) -> None:
        """Take the messages of a call of the model."""


class DeepAgentsSummary(Clearing):
    """`SummarizationMiddleware` of deepagents, which also writes what it summarizes into a file.

    A request that does not fit is refused once, and it summarizes then, too.
    """

    packages = ("deepagents", "langchain", "langchain-core")

    def make(self, limit: int) -> AgentMiddleware[Any, Any, Any]:
        """Return the middleware."""
        with extra_named("deepagents-summary", "compactors"):
            from deepagents.backends import FilesystemBackend
            from deepagents.middleware.summarization import SummarizationMiddleware
        self._folder = TemporaryDirectory()
        # The random name that it would make is part of its summary.
        self._state: dict[str, Any] = {"_summarization_session_id": "session"}
        return SummarizationMiddleware(
            self.model,
            backend=FilesystemBackend(root_dir=self._folder.name, virtual_mode=True),
            trigger=("tokens", limit),
            keep=("messages", self.keep),
            token_counter=self.counter,
        )

    def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Have the middleware edit a request, and keep what it adds to the agent's state."""
        sent: list[Message] = []
        made = self.request(history, self._state, sent)
        if isinstance(made, ExtendedModelResponse):
            self._state |= {name: value for name, value in made.command.update.items() if name != "messages"}
        return sent

    def take(self, sent: Sequence[Message], is_first: bool) -> None:
        """Refuse the first request of a prompt that does not fit."""
        if is_first and self.room.tokens is not None and self.count(sent) > self.room.tokens:
            raise ContextOverflowError("The prompt is longer than its cap.")


class LangMemSummary(LangChainCompactor):
    """`SummarizationNode`: keeps a running summary, and extends it with what leaves.

    Arguments:
        tokens: where it begins to act, which is also the most that it leaves.
        keep: the tokens that it keeps for the summary.
    """

    packages = ("langmem", "langchain-core")

    def __init__(self, tokens: int | None = None, keep: int = 200) -> None:
        super().__init__(tokens, keep)
        self._context: dict[str, Any] = {}

    def make(self, limit: int) -> Any:
        """Return the node."""
        with extra_named("langmem-summary", "compactors"):
            from langmem.short_term import SummarizationNode
        return SummarizationNode(
            model=self.model, max_tokens=limit, max_summary_tokens=self.keep, token_counter=self.counter
        )

    def rewrite(self, history: Sequence[Message]) -> list[Message]:
        """Run the node."""
        messages = to_langchain(history)
        for at, message in enumerate(messages):
            message.id = f"m{at}"
        made = self.made.invoke({"messages": messages, "context": self._context})
        self._context = made.get("context", self._context)
        return [from_langchain(message) for message in made["summarized_messages"]]
