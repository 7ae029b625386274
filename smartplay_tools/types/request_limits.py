"""What providers take back in a request: a model may say more in one reply, and a request that repeats it is refused.

The table is `request_limits.toml`. A call beyond the limit of a message and arguments that are too long are mistakes of
the model, which are answered and counted; what goes back of them is within the limits.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

from smartplay_tools.types.tables import read_table

__all__ = ["most", "shortened"]

CUT = " [shortened: longer than a provider takes back]"
"""The end of a text that was cut."""


@cache
def most(what: Literal["arguments", "calls", "words"]) -> int:
    """Return the most characters of a call's arguments or of a message's words, or calls of a message."""
    table = read_table(__package__, "request_limits.toml")["limit"]
    return min(int(row["most"]) for row in table if row["what"] == what)


def shortened(text: str, longest: int) -> str:
    """Return a text of at most so many characters, which says so where it was cut."""
    return text if len(text) <= longest else text[: longest - len(CUT)] + CUT
