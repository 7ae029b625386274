"""Every error that this package raises deliberately.

    SmartPlayError
    ├── InvalidArgumentError  an argument or a budget is invalid; also a ValueError
    │   └── DamageError       a file of a run is damaged (in `records.damage`)
    ├── UnknownNameError      no game, player or tokenizer has that name; the message lists similar ones
    ├── ResetNeededError      a step of a game that is over, or was never reset
    ├── EngineError           a game's engine, a separate program, does not start or has stopped
    ├── GameValueError        a game handed out a value that no record can hold; ends an episode as game_error
    ├── MissingExtraError     an optional dependency is not installed; the message says how to install it
    ├── PlayerLeftError       the person at the terminal has left; ends an episode as closed, never reaches users
    ├── DiskFullError         a disk has no space left for the records of a run (in `files.full_disk`)
    ├── PromptOverflowError   what a prompt cannot leave out does not fit its cap; ends an episode
    ├── StrategyError         a strategy's choice cannot be shown; ends an episode, never reaches users
    ├── ContextOverflowError  a compactor's question is longer than its cap; raised where it yields the question
    ├── PromptRefusedError    a server refuses this one prompt; ends an episode, as its result after the first reply
    ├── ModelCallError        a model gave no reply (in `players.attempts`); ends an episode as player_error
    └── TranscriptError       a file is not a transcript, or cannot be written, read or replayed

A mistake of a *model* never raises: it becomes a `ToolResult` with `is_error`. A mistake of a *user* raises one of the
errors above, with one sentence that names the remedy. Any other exception is a bug.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager

from smartplay_tools.installation import install_command
from smartplay_tools.visible import visible

__all__ = [
    "ContextOverflowError",
    "EngineError",
    "GameValueError",
    "InvalidArgumentError",
    "MissingExtraError",
    "PlayerLeftError",
    "PromptOverflowError",
    "PromptRefusedError",
    "ResetNeededError",
    "SmartPlayError",
    "SmartPlayWarning",
    "StrategyError",
    "TranscriptError",
    "UnknownNameError",
    "extra_named",
    "in_one_line",
]


class SmartPlayError(Exception):
    """Base class of all errors that smartplay-tools raises deliberately."""

    def __str__(self) -> str:
        return visible(super().__str__())


class InvalidArgumentError(SmartPlayError, ValueError):
    """An argument is invalid; the message says what is valid."""


class SmartPlayWarning(UserWarning):
    """What a user should know of and what is no error; the command line says it as a sentence."""

    def __str__(self) -> str:
        return visible(super().__str__())


class ClosingWarning(SmartPlayWarning):
    """A game, a player or an executor raised an exception while it was closed; what it had done is kept."""


class UnknownNameError(SmartPlayError, KeyError):
    """A name that is not registered."""

    def __init__(self, kind: str, name: object, registered: Iterable[str], remedy: str = "") -> None:
        self.message = f"There is no {kind} {name!r}; {similar(name, registered)}{remedy}"
        super().__init__(self.message)

    def __str__(self) -> str:
        # KeyError prints the repr of its argument, which would quote the sentence.
        return visible(self.message)


class ResetNeededError(SmartPlayError, RuntimeError):
    """A step was taken while no episode is running."""


class EngineError(SmartPlayError, RuntimeError):
    """An engine that runs outside of this process does not start, does not answer or has stopped."""


class GameValueError(SmartPlayError, ValueError):
    """A game handed out what is no finite number, no text or no truth value; playing it again would give it again."""


class MissingExtraError(SmartPlayError, ImportError):
    """An optional dependency is missing."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an optional dependency: {install_command(extra)}")


class PlayerLeftError(SmartPlayError):
    """The person who plays has left: neither an error of the player nor a result of the game."""


class PromptOverflowError(SmartPlayError):
    """The parts of a prompt that cannot be left out need more than `prompt_tokens`.

    A context manager says which: tools, head, pinned messages and the newest turn, in tokens.
    """

    parts: Mapping[str, int] = {}
    """The tokens of each of these parts; empty where an episode has ended."""

    @classmethod
    def of(cls, cap: int, parts: Mapping[str, int]) -> PromptOverflowError:
        """Return the error of parts that need more than a cap."""
        words = ", ".join(f"{name} {tokens:,}" for name, tokens in parts.items())
        error = cls(
            f"What cannot be left out takes {sum(parts.values()):,} tokens of {cap:,}: {words}. "
            "Raise prompt_tokens, or give the agent shorter instructions, fewer tools or shorter messages."
        )
        error.parts = dict(parts)
        return error


class PromptRefusedError(SmartPlayError):
    """A server refuses a prompt, and not its player: it would refuse the same prompt again."""


class StrategyError(SmartPlayError):
    """A strategy's choice cannot be shown: it does not fit, or names a turn that does not exist."""


class ContextOverflowError(SmartPlayError):
    """A question of a compactor is longer than `question_tokens`, so it is not sent."""


class TranscriptError(SmartPlayError, ValueError):
    """A file is not a transcript, or cannot be written, read or replayed here."""


PACKAGES = frozenset({"site-packages", "dist-packages"})
"""The folders of installed packages."""

MOST_LIKE = 3
"""The most similar names that a message lists."""

MOST_NAMES = 12
"""The most names that a message lists where none is similar: the first ones."""


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Raise an `InvalidArgumentError` unless a value is one of the choices."""
    if value not in [*choices]:  # a list is no key of a mapping
        raise InvalidArgumentError(f"{name} must be one of {', '.join(choices)}, not {value!r}.")


def similar(name: object, registered: Iterable[str]) -> str:
    """Return "did you mean ...?" with the names like an unknown one or, if there are none, the known names."""
    import difflib  # with regular expressions and heaps, for this function alone

    names = list(registered)
    part = str(name).casefold()
    parts = [each for each in names if part in each.casefold()][:MOST_LIKE] if part else []
    if near := parts or difflib.get_close_matches(str(name), names, n=MOST_LIKE, cutoff=0.5):
        return f"did you mean {' or '.join(near)}?"
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"known: {', '.join(names[:MOST_NAMES])}{more}."


SENSELESS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    StopIteration,
    TypeError,
    ValueError,
)
"""The exceptions that Python raises if events have values that do not fit each other, or come in another order."""


@contextmanager
def warned_if_not_closed(what: object) -> Iterator[None]:
    """Turn an exception that is raised while something is closed into a warning: it undoes nothing that was done."""
    import warnings

    try:
        yield
    except Exception as error:  # whatever foreign code does at its end
        why = f"{type(error).__name__}: {in_one_line(error)}{place_of(error)}"
        warnings.warn(f"{what} could not be closed: {why}.", ClosingWarning, stacklevel=3)


def place_of(error: BaseException) -> str:
    """Return where an error occurred in a user's own code: the innermost line that is in no library, in words."""
    import sys
    import traceback
    from pathlib import Path

    for frame, line in reversed([*traceback.walk_tb(error.__traceback__)]):
        module, file = frame.f_globals.get("__name__", "").partition(".")[0], Path(frame.f_code.co_filename)
        is_ours = module.startswith("smartplay_") and not module.startswith("smartplay_file_")
        if not is_ours and module not in sys.stdlib_module_names and PACKAGES.isdisjoint(file.parts):
            return f" ({file.name}, line {line})"
    return ""


@contextmanager
def extra_named(feature: str, extra: str) -> Iterator[None]:
    """Turn a failed import into a `MissingExtraError` that says which extra the feature needs."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(feature, extra) from error


def name_of(thing: object) -> str:
    """Return the name of a class or function, or of an object's class, for messages about a wrong argument."""
    return str(getattr(thing, "__name__", type(thing).__name__))


def in_one_line(error: BaseException) -> str:
    """Return the message of an error as one line; for a pydantic model the first of its errors, with the field."""
    if isinstance(error, ValueError) and callable(errors := getattr(error, "errors", None)):
        first = errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    return " ".join(str(error).split())
