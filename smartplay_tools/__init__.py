"""smartplay-tools: the SmartPlay benchmark's games as three tools for any tool-calling agent.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("rule"))

Every setting is also a Gymnasium environment: importing this package registers it as `smartplay/<id>`. The import takes
milliseconds, because each name is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from smartplay_tools.games.gymnasium_names import announce_games
from smartplay_tools.lazy import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.context.strategies import Choice, Past, Strategy, register_strategy
    from smartplay_tools.conversation.agent_session import AgentSession, Conversation
    from smartplay_tools.conversation.loop import aplay, play
    from smartplay_tools.conversation.text_env import TextEnv
    from smartplay_tools.episode.config import EpisodeConfig
    from smartplay_tools.episode.episode import Episode
    from smartplay_tools.episode.tools import schema
    from smartplay_tools.errors import InvalidArgumentError, SmartPlayError
    from smartplay_tools.evaluation.runs.runner import evaluate
    from smartplay_tools.evaluation.runs.sweeps import sweep
    from smartplay_tools.games.base import TextGame
    from smartplay_tools.games.specs import GAMES, GameSpec, register
    from smartplay_tools.messages import Message
    from smartplay_tools.players.player_registry import get_player
    from smartplay_tools.players.prompt_reading import call
    from smartplay_tools.players.scripted import ScriptedPlayer
    from smartplay_tools.records.replays import replay
    from smartplay_tools.records.resumption import fork, resume
    from smartplay_tools.transcript.file import read_transcript
    from smartplay_tools.types import (
        AsyncPlayer,
        Budget,
        EpisodeResult,
        Player,
        Prompt,
        Reply,
        SampledTokens,
        ToolResult,
        ToolSpec,
        Usage,
    )

    __version__: str

__all__ = [
    "GAMES",
    "AgentSession",
    "AsyncPlayer",
    "Budget",
    "Choice",
    "Conversation",
    "Episode",
    "EpisodeConfig",
    "EpisodeResult",
    "GameSpec",
    "InvalidArgumentError",
    "Message",
    "Past",
    "Player",
    "Prompt",
    "Reply",
    "SampledTokens",
    "ScriptedPlayer",
    "SmartPlayError",
    "Strategy",
    "TextEnv",
    "TextGame",
    "ToolResult",
    "ToolSpec",
    "Usage",
    "aplay",
    "call",
    "evaluate",
    "fork",
    "get_player",
    "play",
    "read_transcript",
    "register",
    "register_strategy",
    "replay",
    "resume",
    "schema",
    "sweep",
]

if not TYPE_CHECKING:
    _of_a_module, __dir__ = lazy_exports(
        __name__,
        {
            "context.strategies": (
                "Choice",
                "Past",
                "Strategy",
                "register_strategy",
            ),
            "conversation.loop": (
                "aplay",
                "play",
            ),
            "conversation.agent_session": (
                "AgentSession",
                "Conversation",
            ),
            "conversation.text_env": ("TextEnv",),
            "episode.config": ("EpisodeConfig",),
            "episode.episode": ("Episode",),
            "episode.tools": ("schema",),
            "errors": (
                "InvalidArgumentError",
                "SmartPlayError",
            ),
            "evaluation.runs.runner": ("evaluate",),
            "evaluation.runs.sweeps": ("sweep",),
            "games.base": ("TextGame",),
            "games.specs": (
                "GAMES",
                "GameSpec",
                "register",
            ),
            "messages": ("Message",),
            "players.prompt_reading": ("call",),
            "players.player_registry": ("get_player",),
            "players.scripted": ("ScriptedPlayer",),
            "records.replays": ("replay",),
            "records.resumption": (
                "fork",
                "resume",
            ),
            "transcript.file": ("read_transcript",),
            "types": (
                "AsyncPlayer",
                "Budget",
                "EpisodeResult",
                "Player",
                "Prompt",
                "Reply",
                "SampledTokens",
                "ToolResult",
                "ToolSpec",
                "Usage",
            ),
        },
    )

    def __getattr__(name: str) -> object:
        """Import a name when it is first used; finding the version takes longer than importing all the others."""
        if name == "__version__":
            return import_module("smartplay_tools.version").__version__
        return _of_a_module(name)


announce_games()
