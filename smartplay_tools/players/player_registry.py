"""The registry of players by name, and the creation of players.

A name is looked up here, then among the entry points of the group `smartplay_tools.players` that installed packages
declare. Text after a colon is the player's argument: `openai:MODEL` is a player that calls this model.
`FILE.py:CLASS` names a class in a file, without a package around it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, overload

from smartplay_tools.errors import InvalidArgumentError, SmartPlayError, name_of
from smartplay_tools.registry import Registry, is_in_file, read_file
from smartplay_tools.types import AsyncPlayer, Player


def load_from_file(name: str) -> Callable[..., Any]:
    """Return a function that makes the player `FILE.py:CLASS`, without `seed` if its constructor takes none."""
    return partial(make_player, read_file(name).value)


def make_player(factory: Callable[..., Any], *, seed: int, **options: Any) -> Any:
    """Return a new player of a class or function, with `seed` if it takes one."""
    return factory(**({"seed": seed} if takes_seed(factory) else {}), **options)


def takes_seed(factory: Callable[..., Any]) -> bool:
    """Return whether a factory of players takes `seed`; True if its signature is not known."""
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return True
    return any(parameter.name == "seed" or parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters)


PLAYERS: dict[str, str] = {
    "always": "smartplay_tools.players.baselines:AlwaysPlayer",
    "anthropic": "smartplay_anthropic:AnthropicPlayer",
    "blind": "smartplay_tools.evaluation.runs.blind:BlindPlayer",
    "count-last-5": "smartplay_tools.players.baselines:CountLastFivePlayer",
    "first": "smartplay_tools.players.scripted:FirstPlayer",
    "human": "smartplay_tools.players.human.player:HumanPlayer",
    "langchain": "smartplay_langchain:LangChainPlayer",
    "last-hand": "smartplay_tools.players.baselines:LastHandPlayer",
    "leave-after-two": "smartplay_tools.players.baselines:LeaveAfterTwoPlayer",
    "local": "smartplay_local:LocalPlayer",
    "openai": "smartplay_openai:OpenAIPlayer",
    "openai-responses": "smartplay_openai:ResponsesPlayer",
    "oracle": "smartplay_tools.players.scripted:OraclePlayer",
    "random": "smartplay_tools.players.scripted:RandomPlayer",
    "reader": "smartplay_tools.players.reader:ReaderPlayer",
    "rule": "smartplay_tools.players.rule:RulePlayer",
    "rule-notes": "smartplay_tools.players.rule:RuleNotesPlayer",
    "win-stay": "smartplay_tools.players.baselines:WinStayPlayer",
}
"""The players of this package: name -> location of the class."""

ENTRY_POINTS = "smartplay_tools.players"
"""The group under which other packages declare players."""

_REGISTRY = Registry("player", PLAYERS, ENTRY_POINTS)


@overload
def get_player(
    name: Literal[
        "count-last-5",
        "first",
        "human",
        "last-hand",
        "leave-after-two",
        "oracle",
        "random",
        "reader",
        "rule",
        "rule-notes",
        "win-stay",
    ],
    *,
    seed: int = 0,
    **options: Any,
) -> Player: ...


@overload
def get_player(name: str, *, seed: int = 0, **options: Any) -> Player | AsyncPlayer: ...


def get_player(name: str, *, seed: int = 0, **options: Any) -> Player | AsyncPlayer:
    """Return a new player by name; `seed` is the seed of its random draws.

    "NAME:ARGUMENT" gives the argument to the player's class as its first; "FILE.py:CLASS" is a class in a file of
    yours. An unknown name raises `UnknownNameError`, an option or argument that the player does not take an
    `InvalidArgumentError`.
    """
    if not isinstance(name, str):
        raise InvalidArgumentError(
            f"{name_of(name)} is not the name of a player; a class that is not registered is called, and in a run it "
            f'has a name: {{"p": {name_of(name)}}}.'
        )
    if is_in_file(name):
        colon, argument, factory = "", "", load_from_file(name)
    else:
        base, colon, argument = name.partition(":")
        factory = _REGISTRY[base]
    try:
        player: Player | AsyncPlayer = factory(*([argument] if colon else []), seed=seed, **options)
    except TypeError as error:
        raise InvalidArgumentError(f"The player {name!r} cannot be made with these arguments: {error}.") from error
    except SmartPlayError:
        raise
    except Exception as error:
        if not colon:
            raise
        # The error of a model's library about a missing key or package.
        problem = str(error).partition("\n")[0].rstrip(".")
        raise InvalidArgumentError(f"The player {name!r} cannot be made: {problem}.") from error
    return player


def is_interactive(name: str) -> bool:
    """Return whether a player needs the terminal for itself, as a human player does."""
    return not is_in_file(name) and bool(getattr(_REGISTRY[name.partition(":")[0]], "interactive", False))


def player_names() -> list[str]:
    """Return every name that `get_player` knows, sorted."""
    return sorted(_REGISTRY)


SECOND = "compactor_player"
"""The option of a player that names another one, which answers the questions of a compactor."""


def without_second(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that are the player's own."""
    return {name: value for name, value in options.items() if name != SECOND}


def second_player(options: Mapping[str, Any], *, seed: int) -> Player | AsyncPlayer | None:
    """Return a new player that answers a compactor's questions, as a player's options name it; None if none is named.

    The option is a name, or a mapping with a `name` and the options of that player.
    """
    if (name := second_name(options)) is None:
        return None
    asked = options[SECOND]
    own = {} if isinstance(asked, str) else {key: value for key, value in asked.items() if key != "name"}
    player: Player | AsyncPlayer = get_player(name, seed=seed, **own)
    return player


def second_name(options: Mapping[str, Any]) -> str | None:
    """Return the name of the player that answers a compactor's questions; None if none is named."""
    asked = options.get(SECOND)
    name: Any = asked.get("name") if isinstance(asked, Mapping) else asked
    if asked is not None and not isinstance(name, str):
        raise InvalidArgumentError(f"{SECOND} is the name of a player, or has a name and its options, not {asked!r}.")
    return name  # type: ignore[no-any-return]
