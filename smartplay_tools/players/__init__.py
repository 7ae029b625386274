"""Players, which answer prompts (at random, by rules, with a model, as a person), and the registry of their names.

player_registry  names of players, and players in a file: `FILE.py:CLASS`; `get_player`
prompt_reading   parses the messages of a prompt, for rule players
model            `ModelPlayer`, the base class of players that call a model: attempts, pauses, limits, clients
scripted         players without a model: prepared replies, the first action, a random one, the game's own answer
"""

from smartplay_tools.players.attempts import BrokenAnswerError, ModelCallError, count_in, error_in, plain_answer
from smartplay_tools.players.model import ModelPlayer
from smartplay_tools.players.player_registry import PLAYERS, get_player, is_interactive, is_model, player_names
from smartplay_tools.players.prompt_reading import Reading, call
from smartplay_tools.players.scripted import NotedPlayer, ScriptedPlayer

__all__ = [
    "PLAYERS",
    "BrokenAnswerError",
    "ModelCallError",
    "ModelPlayer",
    "NotedPlayer",
    "Reading",
    "ScriptedPlayer",
    "call",
    "count_in",
    "error_in",
    "get_player",
    "is_interactive",
    "is_model",
    "plain_answer",
    "player_names",
]
