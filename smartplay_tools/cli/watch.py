"""The live page of an episode that `play --watch` plays: the site over its record, in the same process."""

from __future__ import annotations

import tempfile
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from rich.console import Console


@contextmanager
def live_page(transcript: Path | None, *, open_browser: bool) -> Iterator[Path]:
    """Serve the page of a record that is being written, and yield its path; afterwards serve on until Ctrl-C.

    Without a `transcript` the record is a temporary file.
    """
    from smartplay_tools.evaluation.pages.view import SiteRecord, ViewServer
    from smartplay_tools.evaluation.pages.view.record import PLAYING

    console = Console(stderr=True)
    with tempfile.TemporaryDirectory() as folder:
        path = transcript or Path(folder) / "episode.jsonl"
        with ViewServer([SiteRecord(path)]) as server:
            page = f"{server.url}episode/{quote(path.name)}/{PLAYING}"
            console.print(f"The episode is shown at {page}", highlight=False, soft_wrap=True)
            if open_browser:
                webbrowser.open(page)
            yield path
            console.print("The page stays until Ctrl-C.", highlight=False)
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
