"""Truncation of tool results: a text over its cap is cut, and a notice in the text says how much is missing.

A result is cut when it is made; only its copy in the head of another trial can be cut again. The notice counts towards
the cap, so a cut result is never longer than its cap; where not even the notice fits, the text is empty.
"""

from __future__ import annotations

from collections.abc import Callable

Count = Callable[[str], int]
"""A text's tokens."""

Notice = Callable[[int], str]
"""Says how many tokens are missing."""

Cut = Callable[[str, int, Count, Notice], str]
"""A way to cut a text to a cap."""


def cut_end(text: str, cap: int, count: Count, notice: Notice) -> str:
    """Keep the beginning of a text; the notice follows at the end."""
    return _cut_end(text, text, cap, count, notice)


def cut_middle(text: str, cap: int, count: Count, notice: Notice) -> str:
    """Keep whole lines from both ends of a text, as many above as below; the notice is between them."""
    lines = text.splitlines(keepends=True)

    def keep(number: int) -> str:
        above, below = lines[: number - number // 2], lines[len(lines) - number // 2 :]
        return _with_notice("".join(above), "".join(below), text, count, notice)

    return _longest(len(lines) - 1, keep, cap, count)


def cut_history(history: Callable[[int], str], steps: int, current: str, cap: int, count: Count, notice: Notice) -> str:
    """Keep the current observation and as many of the newest past steps as fit; the notice comes first.

    `history(n)` prints the newest n past steps. If the current observation alone is too long, its end is cut.
    """

    def join(*parts: str) -> str:
        return "\n\n".join(part for part in parts if part)

    whole = join(history(steps), current)

    def keep(number: int) -> str:
        kept = join(history(number), current)
        return join(notice(count(whole) - count(kept)), kept)

    return _longest(steps - 1, keep, cap, count, fallback=lambda: _cut_end(current, whole, cap, count, notice))


def cut_page(text: str, cap: int, count: Count, line: Notice) -> tuple[str, int]:
    """Keep the beginning of a text that is over its cap, at least a character, and `line(missing)` below it.

    Return that, and the number of characters kept; without any, the text is empty.
    """

    def keep(length: int) -> str:
        return f"{text[:length]}\n{line(count(text) - count(text[:length]))}"

    length = _bisect(1, len(text) - 1, lambda length: count(keep(length)) <= cap)
    page = keep(length)
    return (page, length) if text and count(page) <= cap else ("", 0)


def _cut_end(text: str, whole: str, cap: int, count: Count, notice: Notice) -> str:
    """Keep the beginning of a part of a text; the notice is about the whole."""
    return _longest(len(text), lambda length: _with_notice(text[:length], "", whole, count, notice), cap, count)


def _with_notice(above: str, below: str, whole: str, count: Count, notice: Notice) -> str:
    missing = count(whole) - count(above) - count(below)
    parts = (above.rstrip("\n"), notice(missing), below)
    return "\n".join(part for part in parts if part)


def _longest(
    most: int, keep: Callable[[int], str], cap: int, count: Count, fallback: Callable[[], str] = lambda: ""
) -> str:
    """Return `keep(n)` for the largest n that the search finds to fit, `fallback()` if not even `keep(0)` does.

    The token count grows with the text, except for a token or two where pieces meet, so bisection finds the largest
    `n` or one close to it; the last check is exact, and the result always fits.
    """
    kept = keep(_bisect(0, most, lambda number: count(keep(number)) <= cap))
    return kept if count(kept) <= cap else fallback()


def _bisect(low: int, high: int, fits: Callable[[int], bool]) -> int:
    """Return a number that fits, where the next one does not; `low` if none does."""
    while low < high:
        middle = (low + high + 1) // 2
        if fits(middle):
            low = middle
        else:
            high = middle - 1
    return low
