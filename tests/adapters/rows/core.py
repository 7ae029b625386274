"""The package's own ways to play: a conversation, a session, an episode, and its functions."""

from __future__ import annotations

from functools import partial
from typing import Any

import smartplay_tools as sp
from tests.adapters.conformance import Host, Send, Window, by_conversation, by_session, direct, is_of_the_game
from tests.adapters.situations import LOOP


def through_episode(episode: sp.Episode) -> Send:
    async def send(name: str, arguments: Any) -> tuple[str, bool]:
        result = await episode.acall(name, arguments)
        return result.text, result.is_error

    return send


def through_functions(episode: sp.Episode) -> Send:
    functions = {function.__name__: function for function in episode.functions()}

    async def send(name: str, arguments: Any) -> tuple[str, None]:
        return functions[name](**arguments), None

    return send


def a_call_that_python_can_make(name: str, arguments: Any) -> bool:
    return is_of_the_game(name, arguments) and list(arguments) == (["action"] if name == "act" else [])


WINDOW = {
    "AgentSession": Window(by_session, "`AgentSession`", lacks=LOOP),
    "Conversation": Window(by_conversation, "`Conversation`", lacks=LOOP),
}
HOST = {
    "Episode": Host(partial(direct, send_to=through_episode), "`Episode.call`"),
    "Functions": Host(partial(direct, send_to=through_functions), "`Episode.functions()`", a_call_that_python_can_make),
}
