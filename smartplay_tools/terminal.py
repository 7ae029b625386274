"""What a command prints: everything passes `visible` before a terminal gets it, but for the styles that we set.

The streams of a process write visible text, whoever prints to them. Only rich's styles and movements of the cursor have
to pass; a `Console` writes these past the stream, and makes the text between them visible itself.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import IO, Any

import rich.console
import rich.text
from rich.segment import Segment

from smartplay_tools.visible import VisibleStream, visible

__all__ = ["Console", "Text", "make_streams_visible", "say"]


def make_streams_visible() -> None:
    """Let standard output and standard error write visible text from now on."""
    for name in ("stdout", "stderr"):
        stream: Any = getattr(sys, name)
        if stream is not None and not isinstance(stream, VisibleStream):
            setattr(sys, name, VisibleStream(stream))


def say(text: object = "", *, err: bool = False) -> None:
    """Print a line at once, to standard error if asked for."""
    print(text, file=sys.stderr if err else sys.stdout, flush=True)


class Text(rich.text.Text):
    """A text that is visible, which rich's own loses some control characters of."""

    def __init__(self, text: str = "", *arguments: Any, **settings: Any) -> None:
        super().__init__(visible(text), *arguments, **settings)


class Console(rich.console.Console):
    """A console that prints visible text; only where `print` is told so is anything in it rich's markup."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(markup=False, emoji=False, **settings)

    @property
    def file(self) -> IO[str]:
        """The stream that styles are written to."""
        file = super().file
        return getattr(file, "rich_proxied_file", file)

    @file.setter
    def file(self, new_file: IO[str]) -> None:
        self._file = new_file

    def render_str(self, text: str, **settings: Any) -> rich.text.Text:
        """Return a text with markup as rich's `Text`."""
        return super().render_str(visible(text), **settings)

    def render(self, *arguments: Any, **settings: Any) -> Iterable[Segment]:
        """Render anything that rich can."""
        for segment in super().render(*arguments, **settings):
            yield segment if segment.control else segment._replace(text=visible(segment.text))
