"""smartplay-tools: the SmartPlay benchmark's games as three tools for any tool-calling agent.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("rule"))

Importing this registers every setting with Gymnasium as `smartplay/<id>`.
"""

from __future__ import annotations

import gymnasium as _gymnasium

from smartplay_tools.context import ContextWindow, View
from smartplay_tools.conversation import Conversation
from smartplay_tools.episode import Episode
from smartplay_tools.errors import (
    InvalidArgumentError,
    MissingExtraError,
    SmartPlayError,
    TranscriptError,
    UnknownNameError,
)
from smartplay_tools.games.base import TextGame
from smartplay_tools.messages import Message, MessageToolCall, assistant_message, calls_of, text_of
from smartplay_tools.paper_protocol import PaperConversation
from smartplay_tools.players import get_player, player_names
from smartplay_tools.players.attempts import BrokenAnswerError, ModelCallError
from smartplay_tools.players.model import ModelPlayer
from smartplay_tools.players.scripted import ScriptedPlayer
from smartplay_tools.playing import aplay, play
from smartplay_tools.records import (
    AsyncPlayer,
    Budget,
    EpisodeResult,
    Player,
    Prompt,
    Reply,
    ResolvedBudget,
    ToolCall,
    ToolResult,
    ToolSpec,
    Usage,
)
from smartplay_tools.replay import Replay, replay
from smartplay_tools.specs import GAMES, PAPER_RESULTS, GameSpec, get_spec
from smartplay_tools.tokens import TokenCounter, Tokenizer, get_tokenizer
from smartplay_tools.tools import schema
from smartplay_tools.transcript import read_transcript

__all__ = [
    "GAMES",
    "PAPER_RESULTS",
    "AsyncPlayer",
    "BrokenAnswerError",
    "Budget",
    "ContextWindow",
    "Conversation",
    "Episode",
    "EpisodeResult",
    "GameSpec",
    "InvalidArgumentError",
    "Message",
    "MessageToolCall",
    "MissingExtraError",
    "ModelCallError",
    "ModelPlayer",
    "PaperConversation",
    "Player",
    "Prompt",
    "Replay",
    "Reply",
    "ResolvedBudget",
    "ScriptedPlayer",
    "SmartPlayError",
    "TextGame",
    "TokenCounter",
    "Tokenizer",
    "ToolCall",
    "ToolResult",
    "ToolSpec",
    "TranscriptError",
    "UnknownNameError",
    "Usage",
    "View",
    "aplay",
    "assistant_message",
    "calls_of",
    "get_player",
    "get_spec",
    "get_tokenizer",
    "play",
    "player_names",
    "read_transcript",
    "replay",
    "schema",
    "text_of",
]

for _spec in GAMES.values():
    _gymnasium.register(
        id=f"smartplay/{_spec.id}",
        entry_point=_spec.entry_point,
        kwargs={"history": _spec.history, **_spec.kwargs},
        max_episode_steps=_spec.rollout,
    )
