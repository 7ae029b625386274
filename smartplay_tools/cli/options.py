"""Arguments and options that several commands have; those of an episode are in `episode_options`."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.streams import keep_streams
from smartplay_tools.types.arguments import value_in


class Format(StrEnum):
    """The output formats of tables."""

    TEXT = "text"
    MARKDOWN = "markdown"
    LATEX = "latex"
    CSV = "csv"
    JSON = "json"


Game = Annotated[
    str, typer.Argument(help="The id of a setting, which `games` lists, or FILE.py:NAME.", show_default=False)
]
Seed = Annotated[int, typer.Option(help="Seed of all randomness.", min=0)]


def for_a_program(context: typer.Context, form: Any) -> Any:
    """Keep the standard streams for output with a format, until the command line ends; return the option's value."""
    if form and form != Format.TEXT:
        context.find_root().with_resource(keep_streams())
    return form


Json = Annotated[bool, typer.Option("--json", help="Print JSON.", callback=for_a_program, is_eager=True)]
PlayerOptions = Annotated[
    list[str] | None,
    typer.Option("--player-option", metavar="[NAME.]KEY=VALUE", help="An option of the player; repeatable."),
]
BaseUrls = Annotated[
    list[str] | None,
    typer.Option(
        "--base-url", metavar="[NAME=]URL", help="Base URL of the models' server, or of the named player's; repeatable."
    ),
]
BaseUrl = Annotated[str | None, typer.Option(help="Base URL of the server of openai:MODEL.")]
Host = Annotated[str, typer.Option(help="The address to listen on; the default is this machine only.")]
Port = Annotated[int, typer.Option(help="The port; 0 is a free one.", min=0, max=65535)]
AllowHost = Annotated[list[str] | None, typer.Option(help="A name under which the server is reached; repeatable.")]
AllowOrigin = Annotated[
    list[str] | None, typer.Option(help="The origin of a web page that may use the server; repeatable.")
]
Plugins = Annotated[
    bool, typer.Option("--plugins", help="Import games of installed packages that records name, to draw them.")
]
GameFiles = Annotated[
    list[str] | None,
    typer.Option("--game", help="A game that records name, if it is in a file: PATH/FILE.py:NAME; repeatable."),
]


def _opened(names: list[str] | None) -> list[str] | None:
    """Open the tokenizers that a user names for records, which open none."""
    from smartplay_tools.context.tokens import get_tokenizer

    for name in names or ():
        get_tokenizer(name)
    return names


TOKENIZERS = "A tokenizer that records name, if it is no part of this package: hf:PATH_OR_NAME or a name; repeatable."
Tokenizers = Annotated[list[str] | None, typer.Option("--tokenizer", help=TOKENIZERS, callback=_opened)]


def _in_a_folder(path: Path | None) -> Path | None:
    """A new file in a folder that exists: a mistyped path makes no folders."""
    if path is not None and not path.parent.is_dir():
        raise InvalidArgumentError(f"There is no folder {path.parent} for {path.name}.")
    return path


TranscriptFile = Annotated[
    Path | None,
    typer.Option("--transcript", help="Write the record to this new file.", callback=_in_a_folder),
]


def import_games(games: list[str] | None) -> None:
    """Import the games in files that `GameFiles` name, as records import none."""
    from smartplay_tools.games.specs import load_game

    for game in games or ():
        load_game(game)


def on_command_line(context: typer.Context) -> set[str]:
    """Return the names of the options that were given on the command line."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}


def names(text: str | None) -> list[str]:
    """Return the parts of a list that is separated by commas; one before KEY= belongs to the part before it."""
    return [name.strip() for name in re.split(r",(?![^\W\d]\w*=)", text or "") if name.strip()]


def key_values(pairs: list[str] | None, name: str = "--option") -> dict[str, Any]:
    """Return KEY=VALUE pairs as a dictionary; a value that is not valid JSON is text."""
    options: dict[str, Any] = {}
    for pair in pairs or []:
        key, equals, value = pair.partition("=")
        if not equals:
            raise InvalidArgumentError(f"{name} {pair} has no value; write it as KEY=VALUE.")
        options[key] = value_in(value)
    return options


def with_options(
    name: str, added: Mapping[str, tuple[Any, Any]], pack: Callable[[dict[str, Any]], Any]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Add options with their defaults to a command; its argument `name` gets what `pack` makes of their values."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def wrapped(**given: Any) -> None:
            values = {option: given.pop(option) for option in added}
            command(**given, **{name: pack(values)})

        signature = inspect.signature(command, eval_str=True)
        own = [parameter for own_name, parameter in signature.parameters.items() if own_name != name]
        others = [
            inspect.Parameter(option, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            for option, (annotation, default) in added.items()
        ]
        parameters = [*(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own), *others]
        wrapped.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return wrapped

    return decorate
