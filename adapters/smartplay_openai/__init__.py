"""OpenAI's interfaces, both ways: models that play through the `openai` client, and players that answer as an endpoint.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("openai:gpt-4o-mini"))

`OpenAIPlayer` is that player. The functions beneath it turn a prompt into a request and an answer into a reply, for
loops written by hand. `LocalEndpoint` serves any player under the same interface, so that a loop can be tried, tested
and shown without a key.
"""

from __future__ import annotations

from smartplay_tools import BrokenAnswerError, MissingExtraError, ModelCallError

try:
    import openai as _openai  # noqa: F401
    import starlette as _starlette  # noqa: F401
    import uvicorn as _uvicorn  # noqa: F401
except ModuleNotFoundError as error:
    raise MissingExtraError("smartplay_openai", "openai") from error

from smartplay_openai.chat import reply as chat_reply
from smartplay_openai.chat import request as chat_request
from smartplay_openai.player import OpenAIPlayer, ResponsesPlayer
from smartplay_openai.responses import reply as responses_reply
from smartplay_openai.responses import request as responses_request
from smartplay_openai.server import LocalEndpoint, endpoint_app

__all__ = [
    "BrokenAnswerError",
    "LocalEndpoint",
    "ModelCallError",
    "OpenAIPlayer",
    "ResponsesPlayer",
    "chat_reply",
    "chat_request",
    "endpoint_app",
    "responses_reply",
    "responses_request",
]
