"""OpenAI's interfaces: models as players, through the `openai` client, and players as models, behind an endpoint.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("openai:gpt-4o-mini"))

`OpenAIPlayer` is that player. `CHAT` and `RESPONSES` are the two interfaces; their `request` and `reply` turn a prompt
into a request and an answer into a reply, for loops written by hand. `LocalEndpoint` serves any player under the same
interfaces, so that a loop can be tried, tested and shown without a key. `WindowEndpoint` is the game's own context
window behind the same interfaces, for other people's agents.
"""

from __future__ import annotations

from smartplay_tools.errors import extra_named
from smartplay_tools.players import BrokenAnswerError, ModelCallError

with extra_named("smartplay_openai", "openai"):
    import openai as _openai  # noqa: F401
    import starlette as _starlette  # noqa: F401
    import uvicorn as _uvicorn  # noqa: F401

from smartplay_openai.chat import CHAT
from smartplay_openai.player import OpenAIPlayer, ResponsesPlayer
from smartplay_openai.responses import RESPONSES
from smartplay_openai.server import LocalEndpoint, SimulatedLimits, endpoint_app
from smartplay_openai.window import WindowEndpoint, WindowStore, window_app

chat_request, chat_reply = CHAT.request, CHAT.reply
responses_request, responses_reply = RESPONSES.request, RESPONSES.reply

__all__ = [
    "CHAT",
    "RESPONSES",
    "BrokenAnswerError",
    "LocalEndpoint",
    "ModelCallError",
    "OpenAIPlayer",
    "ResponsesPlayer",
    "SimulatedLimits",
    "WindowEndpoint",
    "WindowStore",
    "chat_reply",
    "chat_request",
    "endpoint_app",
    "responses_reply",
    "responses_request",
    "window_app",
]
