"""smartplay-tools: the SmartPlay benchmark's games as three tools for any tool-calling agent.

    import smartplay_tools as sp

    with sp.Episode("Hanoi3Disk-v0", seed=7, budget=sp.Budget(prompt_tokens=4096)) as episode:
        result = sp.play(episode, sp.get_player("rule"))

Every setting is also a Gymnasium environment: importing this package registers it as `smartplay/<id>`. The import takes
milliseconds, because each name is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.games.gymnasium_names import when_gymnasium_is_imported
from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.context.strategies.choices import Choice as Choice, Past as Past, Strategy as Strategy
    from smartplay_tools.context.strategies.custom import register_strategy as register_strategy
    from smartplay_tools.conversation.agent_session import AgentSession as AgentSession, Conversation as Conversation
    from smartplay_tools.conversation.loop import aplay as aplay, play as play
    from smartplay_tools.episode.config import EpisodeConfig as EpisodeConfig
    from smartplay_tools.episode.episode import Episode as Episode
    from smartplay_tools.errors import (
        InvalidArgumentError as InvalidArgumentError,
        PromptOverflowError as PromptOverflowError,
        SmartPlayError as SmartPlayError,
    )
    from smartplay_tools.evaluation.runs.runner import evaluate as evaluate
    from smartplay_tools.evaluation.runs.sweeps import sweep as sweep
    from smartplay_tools.games.base import TextGame as TextGame
    from smartplay_tools.games.game_registry import GameSpec as GameSpec
    from smartplay_tools.games.specs import GAMES as GAMES, register as register
    from smartplay_tools.manager.fitted import FittedPrompt as FittedPrompt
    from smartplay_tools.manager.manager import ContextManager as ContextManager
    from smartplay_tools.manager.summaries import Summaries as Summaries
    from smartplay_tools.players.player_registry import get_player as get_player
    from smartplay_tools.players.prompt_reading import call as call
    from smartplay_tools.players.scripted import ScriptedPlayer as ScriptedPlayer
    from smartplay_tools.records.replays import replay as replay
    from smartplay_tools.records.resumption import fork as fork, resume as resume
    from smartplay_tools.tool_formats.schemas import schema as schema
    from smartplay_tools.transcript.file import read_transcript as read_transcript
    from smartplay_tools.types import (
        AsyncPlayer as AsyncPlayer,
        Budget as Budget,
        EpisodeResult as EpisodeResult,
        Player as Player,
        Prompt as Prompt,
        Reply as Reply,
        SampledTokens as SampledTokens,
        ToolResult as ToolResult,
        ToolSpec as ToolSpec,
        Usage as Usage,
    )
    from smartplay_tools.types.messages import Message as Message

    __version__: str

if not TYPE_CHECKING:
    _of_a_module, __dir__, __all__ = lazy_exports(__name__)

    def __getattr__(name: str) -> object:
        """Import a name when it is first used; finding the version takes longer than importing all the others."""
        if name == "__version__":
            from importlib.metadata import version

            return version("smartplay-tools")
        return _of_a_module(name)


def _register_games() -> None:
    from smartplay_tools.games.specs import GAMES

    GAMES.tell_gymnasium()


when_gymnasium_is_imported(_register_games)
