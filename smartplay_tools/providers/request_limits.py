"""What providers take back in a request: a model may say more in one reply, and a request that repeats it is refused.

The smallest limit of any provider holds for all, so that the same reply has the same prompts everywhere. A call beyond
the limit of a message and arguments that are too long are mistakes of the model, which are answered and counted; what
goes back of them is within the limits.
"""

from __future__ import annotations

from functools import cache
from typing import Literal

from smartplay_tools.providers.tables import rows

__all__ = ["most", "shortened"]

CUT = " [shortened: longer than a provider takes back]"
"""The end of a text that was cut."""


@cache
def most(what: Literal["arguments", "calls", "words"]) -> int:
    """Return the most characters of a call's arguments or of a message's words, or calls of a message."""
    return min(int(row["most"]) for _, row in rows("limit") if row["what"] == what)


def shortened(text: str, longest: int) -> str:
    """Return a text of at most so many characters, which says so where it was cut."""
    return text if len(text) <= longest else text[: longest - len(CUT)] + CUT
