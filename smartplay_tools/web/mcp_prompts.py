"""The prompts of the MCP server, for the menus of hosts: `play`, `manual`; and the completion of an action's name.

Hosts show prompts to people, as commands behind a slash for instance, and complete their arguments while they type.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from smartplay_tools.episode.episode import Episode

PLAY, MANUAL = "play", "manual"
ARGUMENT = "action"
MOST = 100
"""The most values that the protocol lets one completion have."""


def listed(episode: Episode) -> list[dict[str, Any]]:
    """Return the prompts of an episode; a manual that is withheld has none."""
    first = {"name": ARGUMENT, "description": "The action to begin with.", "required": False}
    play = {
        "name": PLAY,
        "title": "Play the game",
        "description": "Have the model play until the game is over.",
        "arguments": [first],
    }
    manual = {"name": MANUAL, "title": "Read the manual", "description": "Show the model the game's manual."}
    return [play] if episode.config.manual == "none" else [play, manual]


def text_of_play(arguments: Mapping[str, Any]) -> str:
    """Return the text of the prompt `play`."""
    action = arguments.get(ARGUMENT)
    begin = f' Begin with the action "{action}".' if isinstance(action, str) and action else ""
    return f"Play the game until it is over.{begin}"


def prompt(description: str, text: str) -> dict[str, Any]:
    """Return a prompt in the protocol's form."""
    message = {"role": "user", "content": {"type": "text", "text": text}}
    return {"description": description, "messages": [message]}


def completed(episode: Episode, params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the actions that begin with what was typed, in the order of the manual; none where it is withheld."""
    reference, argument = params.get("ref"), params.get("argument")
    typed = argument.get("value") if isinstance(argument, Mapping) and argument.get("name") == ARGUMENT else None
    is_known = isinstance(reference, Mapping) and reference.get("name") == PLAY and episode.config.manual != "none"
    actions = episode.game.numbered_actions if is_known and isinstance(typed, str) else ()
    values = [action for action in actions if action.lower().startswith(str(typed).lower())]
    return {"completion": {"values": values[:MOST], "total": len(values), "hasMore": len(values) > MOST}}
