"""Every error that this package raises deliberately.

    SmartPlayError
    ├── InvalidArgumentError  an argument or a budget is invalid; also a ValueError
    │   └── DamageError       a file of a run is damaged
    ├── UnknownNameError      no game, player or tokenizer has that name; the message lists similar ones
    ├── ResetNeededError      a step of a game that is over, or was never reset
    ├── EngineError           a game's engine, a separate program, does not start or has stopped
    ├── GameValueError        a game handed out a value that no record can hold; ends an episode as game_error
    ├── MissingExtraError     an optional dependency is not installed; the message says how to install it
    ├── PlayerLeftError       the person at the terminal has left; ends an episode as closed, never reaches users
    ├── DiskFullError         a disk has no space left for the records of a run
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

import errno
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager

from smartplay_tools.visible import visible

__all__ = [
    "ContextOverflowError",
    "DiskFullError",
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


class DamageError(InvalidArgumentError):
    """A file of a run is damaged, or cannot be read; the message names it."""


class SmartPlayWarning(UserWarning):
    """What a user should know of and what is no error; the command line says it as a sentence."""

    def __str__(self) -> str:
        return visible(super().__str__())


class DamageWarning(SmartPlayWarning):
    """A damaged part of a run was left out, and the rest was read; the message names the part."""


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


class DiskFullError(SmartPlayError):
    """A disk has no space left for the records of a run."""


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


def install_command(extra: str = "") -> str:
    """Return the command that installs this package with one more extra, from where it was installed and as it was.

    Without an extra, it installs the package again.
    """
    import json
    import sys
    import tomllib
    from importlib.metadata import distribution
    from importlib.util import find_spec
    from pathlib import Path
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    # https://packaging.python.org/specifications/direct-url: without the file, it came from a package index.
    origin = json.loads(distribution(PACKAGE).read_text("direct_url.json") or "{}")
    receipt = Path(sys.prefix, "uv-receipt.toml")
    extras = {extra} - {""}
    if receipt.exists():
        tool = tomllib.loads(receipt.read_text(encoding="utf-8"))["tool"]
        extras.update(*(each.get("extras", ()) for each in tool["requirements"] if each["name"] == PACKAGE))
        command = "uv tool install --force"
    else:
        python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
        command = f"{python} -m pip install" if find_spec("pip") else f"uv pip install --python {python}"
        command += "" if extra else " --force-reinstall"
    wanted, url = f"[{','.join(sorted(extras))}]" if extras else "", origin.get("url", "")
    if "dir_info" in origin:
        editable = "--editable " if origin["dir_info"].get("editable") else ""
        return f'{command} {editable}"{url2pathname(urlsplit(url).path)}{wanted}"'
    vcs = origin["vcs_info"]["vcs"] + "+" if "vcs_info" in origin else ""
    return f'{command} "{PACKAGE}{wanted}{f" @ {vcs}{url}" if url else ""}"'


PACKAGE = "smartplay-tools"

PACKAGES = frozenset({"site-packages", "dist-packages"})
"""The folders of installed packages."""

MOST_LIKE = 3
"""The most similar names that a message lists."""

MOST_NAMES = 12
"""The most names that a message lists where none is similar: the first ones."""


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Raise an `InvalidArgumentError` unless a value is one of the choices."""
    if value not in choices:
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


FULL = (errno.ENOSPC, errno.EDQUOT) if hasattr(errno, "EDQUOT") else (errno.ENOSPC,)
"""The errors of a disk that is full, or of a user's quota on it."""


LONGEST_CHAIN = 20
"""How many causes of an error are looked at."""


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an error was caused by a disk without space."""
    for _ in range(LONGEST_CHAIN):
        if error is None:
            return False
        if isinstance(error, DiskFullError) or (isinstance(error, OSError) and error.errno in FULL):
            return True
        error = error.__cause__ or error.__context__
    return False


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
def record_named() -> Iterator[None]:
    """Turn what Python raises while an episode is made of a record's config and start into a `TranscriptError`."""
    try:
        yield
    except SmartPlayError:
        raise
    except SENSELESS as error:
        why = f"{type(error).__name__}: {in_one_line(error)}"
        raise TranscriptError(f"The record cannot be replayed: {why}.") from error


@contextmanager
def damage_named(what: object) -> Iterator[None]:
    """Turn the errors raised while a record is used whose events are out of place into a `DamageError` that names it.

    Each event of a record is checked when it is read; only using them all shows whether they fit each other.
    """
    try:
        yield
    except TranscriptError as error:
        raise DamageError(str(error)) from error
    except SmartPlayError:
        raise
    except SENSELESS as error:
        reason = f"{type(error).__name__}: {in_one_line(error)[:200]}"
        raise DamageError(f"{what} is damaged: {reason}.") from error
    except OSError as error:
        raise DamageError(f"{what} cannot be read: {error.strerror}.") from None


@contextmanager
def damage_left_out(what: object) -> Iterator[None]:
    """Leave out what `damage_named` finds damaged, with a warning."""
    try:
        with damage_named(what):
            yield
    except DamageError as error:
        warn_damaged(error)


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


def warn_damaged(why: SmartPlayError | str) -> None:
    """Warn that a damaged part of a run is left out."""
    import warnings

    warnings.warn(str(why), DamageWarning, stacklevel=3)


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
