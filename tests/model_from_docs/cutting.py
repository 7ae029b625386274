"""Results that are too long: how docs/budgets.md cuts them, and the pages of docs/strategies.md, "Offload"."""

from __future__ import annotations

from collections.abc import Callable

Count = Callable[[str], int]


def _longest(fitting: int, most: int, fits: Callable[[int], bool]) -> int:
    """The longest length that fits: bisection between two lengths, both included, the middle rounded up."""
    while fitting < most:
        middle = (fitting + most + 1) // 2
        fitting, most = (middle, most) if fits(middle) else (fitting, middle - 1)
    return fitting


def cut(text: str, cap: int | None, n: Count, frame: str = "") -> str:
    """Return the text within its cap, counted behind a frame: its beginning, and how many tokens are missing."""
    if cap is None or n(frame + text) <= cap:
        return text

    def shown(length: int) -> str:
        kept = text[:length]
        beginning = kept.rstrip("\n")
        notice = f"[{n(frame + text) - n(frame + kept)} tokens cut]"
        return f"{beginning}\n{notice}" if length else notice

    cut_text = shown(_longest(0, len(text), lambda length: n(frame + shown(length)) <= cap))
    return cut_text if n(frame + cut_text) <= cap else ""


def cut_manual(text: str, cap: int | None, n: Count) -> str:
    """Return the manual within its cap: as many first and last lines as fit, one more of the first if they are odd."""
    if cap is None or n(text) <= cap:
        return text
    lines = text.split("\n")
    for kept in reversed(range(len(lines))):
        first, last = lines[: kept - kept // 2], lines[len(lines) - kept // 2 :]
        missing = n(text) - n("".join(f"{line}\n" for line in first)) - n("\n".join(last))
        beginning = "\n".join(first).rstrip("\n")
        shown = "\n".join([*([beginning] if first else []), f"[{missing} tokens cut]", *last])
        if n(shown) <= cap:
            return shown
    return ""


class Pages:
    """The results that were cut under `beyond_result="offload"`, and their pages."""

    def __init__(self, cap: int | None, n: Count) -> None:
        """`cap` is the budget's `result_tokens`."""
        self._cap = cap
        self._n = n
        self._results: list[list[str]] = []

    def offload(self, text: str, picture: int) -> str:
        """Return a result that shows an observation beside its picture, and number it if it is cut."""
        if self._cap is None or self._n(text) <= self._cap - picture:
            return text
        pages: list[str] = []
        rest = text
        while rest:
            cap = self._cap if pages else self._cap - picture
            shown, rest = self._page(rest, f"r{len(self._results) + 1}.{len(pages) + 2}", cap)
            pages.append(shown)
        self._results.append(pages)
        return pages[0]

    def _page(self, rest: str, following: str, cap: int) -> tuple[str, str]:
        n = self._n
        if n(rest) <= cap:
            return rest, ""

        def shown(length: int) -> str:
            page = rest[:length]
            return f'{page}\n[{n(rest) - n(page)} more tokens: read_result("{following}")]'

        length = _longest(1, len(rest) - 1, lambda length: n(shown(length)) <= cap)
        return (shown(length), rest[length:]) if n(shown(length)) <= cap else ("", "")

    def read(self, name: str) -> str | None:
        """Return a page by its name; None if there is none."""
        for number, pages in enumerate(self._results, 1):
            for position, page in enumerate(pages, 1):
                if name == f"r{number}.{position}":
                    return page
        return None
