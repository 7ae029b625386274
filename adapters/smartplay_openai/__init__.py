"""OpenAI's interfaces: models as players, through the `openai` client, and players as models, behind an endpoint.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("openai:gpt-4o-mini"))

There are three parts, each imported when it is first used. `OpenAIPlayer` is that player; it needs the `openai` client.
`LocalEndpoint` serves any player under the same interfaces, so that a loop can be tried, tested and shown without a
key. `WindowEndpoint` is the game's own context window behind the same interfaces, for other people's agents. Both are
servers, which need the extra `serve`.

`CHAT` and `RESPONSES` are the two interfaces, and need neither; their `request` and `reply` turn a prompt into a
request and an answer into a reply, for loops written by hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_openai.chat import CHAT as CHAT, chat_reply as chat_reply, chat_request as chat_request
    from smartplay_openai.player import OpenAIPlayer as OpenAIPlayer, ResponsesPlayer as ResponsesPlayer
    from smartplay_openai.responses import (
        RESPONSES as RESPONSES,
        responses_reply as responses_reply,
        responses_request as responses_request,
    )
    from smartplay_openai.server import (
        LocalEndpoint as LocalEndpoint,
        SimulatedLimits as SimulatedLimits,
        endpoint_app as endpoint_app,
    )
    from smartplay_openai.window import (
        WindowEndpoint as WindowEndpoint,
        WindowStore as WindowStore,
        window_app as window_app,
    )
    from smartplay_tools.players import BrokenAnswerError as BrokenAnswerError, ModelCallError as ModelCallError

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
