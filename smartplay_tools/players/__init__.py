"""Players, which answer prompts (at random, by rules, with a model, as a person), and the registry of their names.

player_registry  names of players, and players in a file: `FILE.py:CLASS`; `get_player`
prompt_reading   parses the messages of a prompt, for rule players
model            `ModelPlayer`, the base class of players that call a model: attempts, pauses, limits, clients
conversion       the steps that adapters share between the canonical form of messages and that of their framework
cache_marks      up to which messages a provider's cache is asked to store a prompt
environment      keys and proxies, checked before anything is asked
cut_prompts      servers that cut prompts without a word, noticed by their count
optional_fields  what a server that refuses a part of a request is asked without
usage            what a server says it has counted, and why its reply ended
server_errors    whose error it is that a server reports: the model's, the prompt's, the player's, or only this moment's
baselines        players of one line, which a model has to beat
scripted         players without a model: prepared replies, the first action, a random one, the game's own answer
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from smartplay_tools.registry import lazy_exports

if TYPE_CHECKING:
    from smartplay_tools.players.attempts import (
        BrokenAnswerError as BrokenAnswerError,
        ModelCallError as ModelCallError,
        ModelPromptError as ModelPromptError,
        ModelRefusedError as ModelRefusedError,
        UnreadableAnswerError as UnreadableAnswerError,
        error_in as error_in,
        given_up as given_up,
        plain_answer as plain_answer,
        reply_in as reply_in,
        unreadable as unreadable,
    )
    from smartplay_tools.players.environment import (
        check_key as check_key,
        check_url as check_url,
        readable_proxies as readable_proxies,
    )
    from smartplay_tools.players.model import ModelPlayer as ModelPlayer
    from smartplay_tools.players.optional_fields import OptionalFields as OptionalFields
    from smartplay_tools.players.player_registry import (
        PLAYERS as PLAYERS,
        get_player as get_player,
        is_interactive as is_interactive,
        player_names as player_names,
    )
    from smartplay_tools.players.prompt_reading import Reading as Reading, call as call
    from smartplay_tools.players.scripted import NotedPlayer as NotedPlayer, ScriptedPlayer as ScriptedPlayer
    from smartplay_tools.players.server_errors import ServerError as ServerError, server_error as server_error
    from smartplay_tools.players.usage import (
        asks_management as asks_management,
        left_to_provider as left_to_provider,
        read_usage as read_usage,
        with_end as with_end,
        with_management as with_management,
    )
    from smartplay_tools.providers.model_names import is_model as is_model

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_exports(__name__)
