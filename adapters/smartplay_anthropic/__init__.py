"""Anthropic's Messages interface: models that play through the `anthropic` client.

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("anthropic:MODEL"))

`request` and `reply` turn a prompt into a request and an answer into a reply, for loops written by hand;
`tools` are an episode's tools for the client's own `tool_runner`.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named

with extra_named("smartplay_anthropic", "anthropic"):
    import anthropic as _anthropic  # noqa: F401

from smartplay_anthropic.codec import reply, request
from smartplay_anthropic.player import AnthropicPlayer, async_tools, tools

__all__ = ["AnthropicPlayer", "async_tools", "reply", "request", "tools"]
