"""The tables in the pages of the documentation: each stands between its marks, and its script renews it."""

from __future__ import annotations

from pathlib import Path

END = "<!-- end -->"


def mark(name: str) -> str:
    """Return the line that begins the table of a name."""
    return f"<!-- table: {name} -->\n"


def publish(page: Path, name: str, written: str) -> None:
    """Put a table between its marks in a page; ValueError if the page does not have them."""
    before, marked, rest = page.read_text(encoding="utf-8").partition(mark(name))
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{page} has no place for the table {name}: a line {mark(name)!r} and, below it, {END!r}.")
    page.write_text(f"{before}{marked}\n{written}\n\n{end}{after}", encoding="utf-8")
