"""A browser for tests of the replay page.

Every test that opens a page fails on an error in the browser's console and on any request that leaves the file.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from smartplay_tools.evaluation.pages.report.page import write_report

CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)


FILES = ("file:", "data:", "blob:")
"""How addresses begin that lead to no server."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("there is no chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        yield browser
        browser.close()


@contextmanager
def pages_of(browser: Any, *allowed: str, **settings: Any) -> Iterator[Callable[..., Any]]:
    """What opens an address in the browser; what went wrong there, or asked for what does not begin with one of the
    allowed words, fails the test in the end."""
    wrong: list[str] = []
    contexts = []

    def opened(url: str, **options: Any) -> Any:
        context = browser.new_context(**settings, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: wrong.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("dialog", lambda dialog: wrong.append(f"dialog: {dialog.message}"))
        page.on("request", lambda request: request.url.startswith(allowed) or wrong.append(f"request: {request.url}"))
        page.goto(url)
        page.wait_for_selector("body[data-ready]")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []


@pytest.fixture
def show(browser, tmp_path) -> Iterator[Any]:
    """Make the page of a run and open it."""
    out = tmp_path / "page.html"

    def opened(run: Path | list[Path] | None, fragment: str = "", **options: Any) -> Any:
        if run is not None:
            write_report(run, out)
        return open_page(out.as_uri() + fragment, **options)

    with pages_of(browser, *FILES, offline=True) as open_page:
        yield opened
