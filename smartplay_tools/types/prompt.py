"""Prompts, replies, and the players that answer prompts with replies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, Protocol, runtime_checkable

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.types.messages import Message, copy_of
from smartplay_tools.types.pictures import NO_PICTURES, Picture
from smartplay_tools.types.result import SampledTokens, ToolSpec, Usage

Purpose = Literal["play", "summary", "compaction"]
"""What a prompt asks for: the next reply of the play, a summary of the turns that are about to leave, or the answer to
a question of a compactor."""


@dataclass(frozen=True)
class Prompt:
    """The input of a player: messages in chat form, the tools, and how many tokens the reply may have."""

    shared: Sequence[Message]
    """The messages, which must not be changed: the prompts of a conversation share them."""
    tools: tuple[ToolSpec, ...] = ()
    max_tokens: int | None = None
    prefix_messages: int = field(default=0, compare=False)
    """How many messages at the beginning are the same as in the previous prompt: a provider's cache can serve them."""
    purpose: Purpose = "play"
    """What is asked for. Any but "play" is sent with `tool_choice`, below, and its reply is not a turn."""
    cache_key: str = field(default="", compare=False)
    """The same for all prompts of an episode, for providers that cache prompts with the same key together."""
    pictures: Mapping[str, Picture] = field(default_factory=lambda: NO_PICTURES, compare=False)
    """The pictures that the messages name, by their sha256."""
    version: str = field(default="", compare=False)
    """The version of the words around the game; empty for a prompt that came through a provider's interface."""
    tokens: int = field(default=0, compare=False)
    """Its budget tokens; 0 for one that came through a provider's interface."""

    def __post_init__(self) -> None:
        """Hold the messages as a tuple, so that prompts with the same messages are equal."""
        object.__setattr__(self, "shared", tuple(self.shared))

    @cached_property
    def messages(self) -> list[Message]:
        """The messages as copies, which the player may change. A player that needs only the tools has none made."""
        return list(map(copy_of, self.shared))

    @property
    def tool_choice(self) -> Literal["auto", "none"]:
        """The provider's tool choice: a summary is written in words, even if the tools are sent with its prompt."""
        return "none" if self.purpose != "play" and self.tools else "auto"

    def settings(
        self, own: Mapping[str, Any] = MappingProxyType({}), *, cap: str = "max_tokens", no_tools: Any = "none"
    ) -> dict[str, Any]:
        """Return a caller's own settings of a model with those of this prompt.

        Of two caps on the reply the smaller one applies. The tool choice is the caller's, unless tools must not be
        called; a choice with which the model cannot play is an `InvalidArgumentError`.

        Arguments:
            own: the caller's settings.
            cap: the provider's name of the cap on a reply.
            no_tools: the provider's value of `tool_choice` where tools must not be called.
        """
        settings = dict(own)
        if self.max_tokens is not None:
            settings[cap] = min(self.max_tokens, own.get(cap) or self.max_tokens)
        if self.tool_choice == "none":
            settings["tool_choice"] = no_tools
        elif self.purpose != "play":
            for name in ("tool_choice", "parallel_tool_calls"):  # a provider refuses them without tools
                settings.pop(name, None)
        elif own.get("tool_choice") in ("none", no_tools):
            raise InvalidArgumentError(
                "With the tool choice `none` the model cannot play; take it out of the settings."
            )
        return settings


@dataclass(frozen=True, slots=True)
class Reply:
    """The output of a player: an assistant message, and the provider's usage if it is known."""

    message: Message
    usage: Usage | None = None
    sampled: SampledTokens | None = None
    """The tokens of which the reply was made, where the player knows them and wants them in the record."""


@runtime_checkable
class Player(Protocol):
    """Anything that answers a prompt: a rule, a model behind an endpoint, a person at a terminal."""

    name: str

    def reply(self, prompt: Prompt) -> Reply:
        """Answer the prompt."""
        ...


@runtime_checkable
class AsyncPlayer(Protocol):
    """A player whose reply is awaited, such as a model behind a network."""

    name: str

    async def areply(self, prompt: Prompt) -> Reply:
        """Answer the prompt."""
        ...
