"""The base class of OpenAI's two interfaces: the operations of a wire format, for clients and for servers.

An `Interface` is the only place that knows a wire format. A client turns a prompt into a request and an answer into a
reply; a server turns a request into a prompt and a reply into an answer. Both directions are in one object, because
they have to agree field by field.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from smartplay_tools.players.wire.problems import RequestError
from smartplay_tools.players.wire.tool_choice import ToolChoice
from smartplay_tools.tool_formats.schemas import schema
from smartplay_tools.types import Prompt, Reply, Usage
from smartplay_tools.types.messages import Message

Event = tuple[str | None, dict[str, Any] | str]
"""A server-sent event: its name, if it has one, and its data."""

BREAKPOINT = {"prompt_cache_breakpoint": {"mode": "explicit"}}
"""The mark of a content part up to which the provider caches a prompt."""


class Streaming(ABC):
    """An interface, as far as a stream has its form: events, an error, and signs of life before the first event."""

    alive: ClassVar[str] = ": the model has not replied yet\n\n"
    """A server-sent comment, which clients ignore."""

    @abstractmethod
    def stream(self, answer: dict[str, Any], body: Mapping[str, Any]) -> Iterator[Event]:
        """Yield an answer's events: text and arguments in two pieces each, so that readers have to join them."""

    def failure(self, error: RequestError) -> Event:
        """Return the event of a stream that ends without an answer."""
        return None, error.body()


class Interface(Streaming):
    """One of OpenAI's interfaces."""

    path: ClassVar[str]
    """The path of the interface on a server."""

    limit_field: ClassVar[str]
    """The name of the cap on the reply."""

    least_limit: ClassVar[int | None] = None
    """The least cap on a reply that is not refused, where there is one; a reply that uses more than the budget's is
    recorded as an overrun."""

    tool_format: ClassVar[Literal["openai", "responses"]]
    """The form in which the interface takes tools."""

    required: ClassVar[Mapping[str, Any]] = {}
    """Arguments, apart from the model, that `create` requires even if `extra_body` has everything."""

    stream_options: ClassVar[Mapping[str, Any]]
    """The fields that make a request a stream that ends with its usage."""

    # The client's side.

    def request(
        self,
        prompt: Prompt,
        *,
        limit_field: str | None = None,
        own: Mapping[str, Any] = MappingProxyType({}),
        mark: bool = False,
    ) -> dict[str, Any]:
        """Return the keyword arguments of the client's `create`, except the model.

        `limit_field` is the name of the cap on the reply, if the server has another one; `own` are further fields, of
        which a cap applies where it is smaller than the prompt's. `mark` marks the end of what is unchanged since the
        previous prompt for the provider's cache.
        """
        arguments, cap = self.conversation(prompt, mark=mark), limit_field or self.limit_field
        if prompt.tools:
            arguments["tools"] = [schema(tool, self.tool_format) for tool in prompt.tools]
        arguments |= prompt.settings(own, cap=cap)
        if prompt.max_tokens is not None and self.least_limit is not None:
            arguments[cap] = max(arguments[cap], self.least_limit)
        return arguments

    @abstractmethod
    def conversation(self, prompt: Prompt, *, mark: bool) -> dict[str, Any]:
        """Return the arguments that hold a prompt's messages; `mark` as for `request`."""

    @abstractmethod
    def create(self, client: Any) -> Callable[..., Any]:
        """Return the client's method that sends a request."""

    @abstractmethod
    def reply(self, answer: Any) -> Reply:
        """Return the reply in an answer; raise `BrokenAnswerError` if there is none."""

    @abstractmethod
    def assemble(self, parts: Iterable[Any]) -> dict[str, Any]:
        """Return the answer that consists of a stream's parts; raise `BrokenAnswerError` if the stream was cut."""

    # The server's side.

    @abstractmethod
    def read(self, body: Mapping[str, Any]) -> Prompt:
        """Return the prompt in a request; raise `RequestError` for a request that OpenAI would refuse."""

    @abstractmethod
    def read_tool_choice(self, body: Mapping[str, Any]) -> ToolChoice:
        """Return which tools the reply may and must call; raise `RequestError` for an invalid choice."""

    @abstractmethod
    def write(self, message: Message, model: str, usage: Usage) -> dict[str, Any]:
        """Return the answer that says a message; its calls keep their ids, which have to be unique."""
