r"""Text that is not ours, as people may see it: control characters are written out, as `\x1b`.

What a model says, a server answers, a stranger's folder is called or a game prints can hold sequences that clear a
screen, write the clipboard or hide what follows, and halves of characters, which nothing can draw. Records, JSON and
prompts keep such text as it is. What is shown passes here: terminals (`terminal.py`), logs (`logger`), errors
and warnings, tables, figures, pages and what notebooks show (`as_html`).
"""

from __future__ import annotations

import html
import logging
import re
from collections.abc import Iterable
from typing import Any, TextIO

__all__ = ["VisibleStream", "as_html", "logger", "visible", "written_as"]

_HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""C0 and C1 but newline and tab, what turns the direction of a text, and lone surrogates."""


def visible(text: str) -> str:
    """Return a text with its control characters, turns of direction and lone surrogates written out."""
    return text if text.isascii() and text.isprintable() else _HIDDEN.sub(_written, text)


def _written(found: re.Match[str]) -> str:
    return found[0].encode("ascii", "backslashreplace").decode() if found[0] > "\x7f" else f"\\x{ord(found[0]):02x}"


def as_html(text: str) -> str:
    """Return a text as HTML."""
    return html.escape(visible(text))


def logger(name: str) -> logging.Logger:
    """Return a logger whose messages are visible, whatever shows them."""
    log = logging.getLogger(name)
    log.addFilter(_make_visible)  # the same function is added once
    return log


def _make_visible(record: logging.LogRecord) -> bool:
    words = record.getMessage()
    if (shown := visible(words)) != words:
        record.msg, record.args = shown, None
    return True


class VisibleStream:
    """A text stream that writes visible text; what is not text (`buffer`) goes to the stream below as it is."""

    def __init__(self, stream: Any) -> None:
        self.rich_proxied_file = stream  # rich's name for the stream below, to which styles are written

    def write(self, text: str) -> int:
        """Write a text."""
        self.rich_proxied_file.write(visible(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts."""
        self.write("".join(lines))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def written_as(stream: TextIO, other: TextIO) -> TextIO:
    """Return another stream with visible text, if the first is one."""
    shown: Any = VisibleStream(other) if isinstance(stream, VisibleStream) else other
    return shown  # type: ignore[no-any-return]
