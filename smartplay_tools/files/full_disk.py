"""A disk without space for the records of a run, whatever the error that says so has been made into."""

from __future__ import annotations

import errno

from smartplay_tools.errors import SmartPlayError

FULL = (errno.ENOSPC, errno.EDQUOT) if hasattr(errno, "EDQUOT") else (errno.ENOSPC,)
"""The errors of a disk that is full, or of a user's quota on it."""

LONGEST_CHAIN = 20
"""How many causes of an error are looked at."""


class DiskFullError(SmartPlayError):
    """A disk has no space left for the records of a run."""


def is_disk_full(error: BaseException | None) -> bool:
    """Return whether an error was caused by a disk without space."""
    for _ in range(LONGEST_CHAIN):
        if error is None:
            return False
        if isinstance(error, DiskFullError) or (isinstance(error, OSError) and error.errno in FULL):
            return True
        error = error.__cause__ or error.__context__
    return False
