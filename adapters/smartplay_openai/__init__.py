"""Models behind OpenAI's interfaces as players, through the `openai` client.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("openai:gpt-4o-mini"))

`OpenAIPlayer` is that player, which needs the `openai` client; it is imported when it is first used. `CHAT` and
`RESPONSES` are the two interfaces, and need no client; their `request` and `reply` turn a prompt into a request and an
answer into a reply, for loops written by hand. The servers that answer at these interfaces are `smartplay_gateway`'s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_openai.player import OpenAIPlayer as OpenAIPlayer, ResponsesPlayer as ResponsesPlayer
    from smartplay_tools.players import BrokenAnswerError as BrokenAnswerError, ModelCallError as ModelCallError
    from smartplay_tools.players.wire import (
        CHAT as CHAT,
        RESPONSES as RESPONSES,
        chat_reply as chat_reply,
        chat_request as chat_request,
        responses_reply as responses_reply,
        responses_request as responses_request,
    )

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
