"""The live page of an episode that `play --watch` plays: the site over its record, in the same process."""

from __future__ import annotations

import tempfile
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import typer


@dataclass(frozen=True)
class LivePage:
    """The page of a record that is being written."""

    path: Path
    """The record."""
    url: str
    open_browser: bool

    def announce(self) -> None:
        """Say where the page is, once its record has begun: before, there is nothing to show."""
        typer.echo(f"The episode is shown at {self.url}", err=True)
        if self.open_browser:
            webbrowser.open(self.url)


@contextmanager
def live_page(transcript: Path | None, *, open_browser: bool) -> Iterator[LivePage]:
    """Serve the page of a record that is being written, and yield it; afterwards serve on until Ctrl-C.

    Without a `transcript` the record is a temporary file.
    """
    from smartplay_tools.web.site import SiteRecord, ViewServer
    from smartplay_tools.web.site.site_record import PLAYING

    with tempfile.TemporaryDirectory() as folder:
        path = transcript or Path(folder) / "episode.jsonl"
        with ViewServer([SiteRecord(path)]) as server:
            yield LivePage(path, f"{server.url}episode/{quote(path.name)}/{PLAYING}", open_browser)
            typer.echo("The page stays until Ctrl-C.", err=True)
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
