"""Anthropic's Messages interface: models that play through the `anthropic` client.

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("anthropic:MODEL"))

`request` and `reply` turn a prompt into a request and an answer into a reply, for loops written by hand, and need no
client.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_anthropic.codec import reply as reply, request as request
    from smartplay_anthropic.player import AnthropicPlayer as AnthropicPlayer

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
