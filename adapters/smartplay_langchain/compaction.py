"""Compactors of LangChain, deepagents and langmem, with their code unchanged.

Middlewares are called as an agent's loop calls them: those that rewrite the state before the model is called, and those
that edit the request. langmem's is a node of a graph.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from langchain.agents import middleware
from langchain_core.exceptions import ContextOverflowError
from langchain_core.messages import AIMessage, RemoveMessage
from langgraph.store.memory import InMemoryStore

from smartplay_langchain.chat_model import PlayerChatModel
from smartplay_langchain.messages import from_langchain, to_langchain
from smartplay_tools import Message
from smartplay_tools.compactors.imported import ImportedCompactor
from smartplay_tools.context.compaction import GivenHistory


class LangChainCompactor(ImportedCompactor):
    """What compactors that work on LangChain's messages have in common."""

    packages: ClassVar[tuple[str, ...]] = ("langchain", "langchain-core")
    overflow = ContextOverflowError

    @property
    def model(self) -> PlayerChatModel:
        """The model to summarize with."""
        return PlayerChatModel(player=self)

    def counter(self, messages: Iterable[Any], **_: Any) -> int:
        """Count LangChain's messages."""
        return self.count(map(from_langchain, messages))


@dataclass(eq=False)
class LangChainSummary(LangChainCompactor):
    """`SummarizationMiddleware`: a summary takes the place of all but the newest messages in the agent's state."""

    keep: int = 6
    """The messages that stay."""
    persistent = True

    def make(self) -> Any:
        """Return the middleware."""
        return middleware.SummarizationMiddleware(
            self.model, trigger=("tokens", self.limit), keep=("messages", self.keep), token_counter=self.counter
        )

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Call the middleware before a call of the model."""
        state = {"messages": to_langchain(history)}
        made = self.made.before_model(state, None) or state
        return [from_langchain(message) for message in made["messages"] if not isinstance(message, RemoveMessage)]


@dataclass(eq=False)
class LangChainClearing(LangChainCompactor):
    """`ContextEditingMiddleware`: a mark takes the place of old results in the request."""

    keep: int = 6
    """The results, or the messages, that stay."""
    _state: dict[str, Any] = field(default_factory=dict, init=False)

    def make(self) -> Any:
        """Return the middleware."""
        edit = middleware.ClearToolUsesEdit(trigger=self.limit, keep=self.keep)
        return middleware.ContextEditingMiddleware(edits=[edit], token_counter=self.counter)

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Have the middleware edit a request, and keep what it adds to the agent's state."""
        self.sent: list[Message] = []
        messages = to_langchain(history)
        state: Any = {**self._state, "messages": messages}
        request: Any = middleware.ModelRequest(model=self.model, messages=messages, state=state)
        made = self.made.wrap_model_call(request, self.take)
        if isinstance(made, middleware.ExtendedModelResponse) and made.command is not None:
            self._state |= made.command.update or {}
        return self.sent

    def take(self, request: Any) -> Any:
        """Answer an edited request, as the model would: `sent` is what it would be called with."""
        self.sent = [from_langchain(message) for message in request.messages]
        return middleware.ModelResponse(result=[AIMessage("")])


@dataclass(eq=False)
class DeepAgentsSummary(LangChainClearing):
    """`SummarizationMiddleware` of deepagents, which also writes what it summarizes into a file.

    A request that does not fit is refused once, as a provider would refuse it; it summarizes then, too.
    """

    packages = ("deepagents", *LangChainCompactor.packages)
    # The random name that it would make is part of its summaries.
    _state: dict[str, Any] = field(default_factory=lambda: {"_summarization_session_id": "session"}, init=False)

    def make(self) -> Any:
        """Return the middleware."""
        from deepagents.backends import StoreBackend
        from deepagents.middleware.summarization import SummarizationMiddleware

        return SummarizationMiddleware(
            self.model,
            backend=StoreBackend(store=InMemoryStore(), namespace=lambda _: ("session",)),
            trigger=("tokens", self.limit),
            keep=("messages", self.keep),
            token_counter=self.counter,
        )

    def take(self, request: Any) -> Any:
        """Refuse the first request of a prompt that does not fit."""
        is_first, answer = not self.sent, super().take(request)
        if is_first and self.is_full(self.sent):
            raise ContextOverflowError("The prompt is longer than its cap.")
        return answer


@dataclass(eq=False)
class LangMemSummary(LangChainCompactor):
    """`SummarizationNode`: keeps a running summary, and extends it with what leaves; `tokens` is the most it leaves."""

    summary: int = 200
    """The tokens for the summary."""
    packages = ("langmem", "langchain-core")
    _context: dict[str, Any] = field(default_factory=dict, init=False)

    def make(self) -> Any:
        """Return the node."""
        from langmem.short_term import SummarizationNode

        return SummarizationNode(
            model=self.model, max_tokens=self.limit, max_summary_tokens=self.summary, token_counter=self.counter
        )

    def rewrite(self, history: GivenHistory) -> list[Message]:
        """Run the node, which knows messages by their ids."""
        messages = to_langchain(history)
        for at, message in enumerate(messages):
            message.id = f"m{at}"
        made = self.made.invoke({"messages": messages, "context": self._context})
        self._context = made.get("context", self._context)
        return [from_langchain(message) for message in made["summarized_messages"]]
