"""Damage: files of runs that hold no record or row, or events that are out of place."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from smartplay_tools.errors import (
    SENSELESS,
    InvalidArgumentError,
    SmartPlayError,
    SmartPlayWarning,
    TranscriptError,
    in_one_line,
)


class DamageError(InvalidArgumentError):
    """A file of a run is damaged, or cannot be read; the message names it."""


class DamageWarning(SmartPlayWarning):
    """A damaged part of a run was left out, and the rest was read; the message names the part."""


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


def warn_damaged(why: SmartPlayError | str) -> None:
    """Warn that a damaged part of a run is left out."""
    warnings.warn(str(why), DamageWarning, stacklevel=3)
