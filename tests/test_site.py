"""The documentation as a site: it is built without a warning, and contains every public name."""

from __future__ import annotations

import ast
import html
import importlib
import os
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import pytest
from typer.main import get_command

import smartplay_tools as sp
from smartplay_tools.cli import app
from smartplay_tools.errors import MissingExtraError
from tests.evaluation.conftest import CHROMIUM
from tests.processes import printed_by

pytest.importorskip("furo", reason="the extra `docs` is not installed")

ROOT = Path(__file__).parents[1]
ADAPTERS = sorted(folder.name for folder in (ROOT / "adapters").glob("smartplay_*"))


ELSEWHERE = {
    "smartplay_inspect": "inspect.md",
    "smartplay_local": "local.md",
    "smartplay_minigrid": "memory.md",
    "smartplay_openenv": "openenv.md",
    "smartplay_otel": "traces.md",
    "smartplay_popgym": "memory.md",
    "smartplay_pydantic_ai": "pydantic-ai.md",
    "smartplay_trl": "trl.md",
    "smartplay_verifiers": "verifiers.md",
}
"""Adapters with an environment of their own, and their pages."""

OF_SUB_PACKAGES = (
    *("evaluation.analysis.summary.summarize", "evaluation.analysis.comparison.compare", "providers.prices.Price"),
    *(
        "evaluation.runs.estimate.estimate",
        "evaluation.analysis.figures.frontier.frontier",
        "evaluation.analysis.figures.run.write_figures",
        "evaluation.pages.report.page.write_report",
    ),
    *("records.sent_prompts", "testing.CHECKS", "players.Reading"),
)
"""Some names that are not the root's."""


def assert_signatures_have_fields(pages: str) -> None:
    """A budget and the configs are shown with their fields, and what these are where they are not given."""
    for name, fields in {
        "Budget": ("history='game'", "prompt_tokens=None", "slack=0.0"),
        "EpisodeConfig": ("seed", "manual='tool'"),
        "evaluation.runs.players.PlayerConfig": ("name", "concurrency=None"),
    }.items():
        signature = re.search(rf'<dt [^>]*id="smartplay_tools\.{re.escape(name)}">(.*?)</dt>', pages, flags=re.DOTALL)
        assert signature, name
        plain = html.unescape(re.sub(r"<[^>]+>", "", signature[1]))
        assert all(field in plain for field in fields), plain


def assert_every_example_has_a_title(page: Path) -> None:
    """Said as people would say it, and not as its file is called."""
    text = page.read_text(encoding="utf-8")
    programs = text.partition('id="complete-programs"')[2]
    titles = [html.unescape(title) for title in re.findall(r"<h3>(.*?)<a class", programs)]
    assert len(titles) == len(list((ROOT / "examples").glob("*.py")))
    assert all(re.match(r"[A-Z][a-z]+ ", title) and "_" not in title for title in titles), titles


def public_names(adapter: str) -> list[str]:
    """The names of an adapter's `__all__`, read without importing its framework."""
    with suppress(MissingExtraError):
        return list(importlib.import_module(adapter).__all__)
    tree = ast.parse((ROOT / "adapters" / adapter / "__init__.py").read_text(encoding="utf-8"))
    [listed] = [n.value for n in tree.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "__all__"]
    names: list[str] = ast.literal_eval(listed)
    return names


def missing(page: Path, anchors: Iterable[str]) -> list[str]:
    """The names that cannot be linked to on a page."""
    text = page.read_text(encoding="utf-8")
    return [anchor for anchor in anchors if f'id="{anchor}"' not in text]


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not ADAPTERS, reason="the site is built from a checkout"),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site; a warning is an error. `SMARTPLAY_SITE` names one that `make docs` has built."""
    if built_before := os.environ.get("SMARTPLAY_SITE"):
        return ROOT / built_before
    folder: Path = tmp_path_factory.mktemp("site")
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", folder / "trees"]
    command = [sys.executable, "-m", "sphinx", *options, ROOT / "docs", folder]
    printed_by(*command)
    return folder


def test_what_is_public_is_documented(site):
    pages = "".join(page.read_text(encoding="utf-8") for page in sorted(site.glob("api*.html")))
    documented = set(re.findall(r'id="(smartplay_tools\.[\w.]+)"', pages))
    assert {f"smartplay_tools.{name}" for name in sp.__all__} - documented == set()
    for name in OF_SUB_PACKAGES:
        assert f"smartplay_tools.{name}" in documented, name
    for adapter in ADAPTERS:
        if adapter in ELSEWHERE:  # its framework is not installed with the others: its names are on its own page
            page = (ROOT / "docs" / ELSEWHERE[adapter]).read_text(encoding="utf-8")
            assert [name for name in public_names(adapter) if f"`{name}`" not in page] == []
            continue
        own = [name for name in importlib.import_module(adapter).__all__ if name not in sp.__all__]
        assert missing(site / "api.html", (f"{adapter}.{name}" for name in own)) == []
    commands = (f"smartplay-tools-{name}" for name in get_command(app).commands)
    assert missing(site / "command-line.html", commands) == []


def test_every_page_is_in_the_contents(site):
    contents = (site / "index.html").read_text(encoding="utf-8")
    pages = [path.stem for path in (ROOT / "docs").glob("*.md") if path.stem != "index"]
    assert [
        page for page in pages if f'toctree-l1"><a class="reference internal" href="{page}.html"' not in contents
    ] == []


def test_signatures_have_fields_and_examples_have_titles(site):
    assert_signatures_have_fields("".join(page.read_text(encoding="utf-8") for page in sorted(site.glob("api*.html"))))
    assert_every_example_has_a_title(site / "interfaces.html")


def test_no_code_has_to_be_scrolled_sideways(site):
    """On a screen and on a phone, in every block of code and every signature of every page."""
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("there is no chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--headless", "--no-sandbox"])
        page, wide = browser.new_page(), {}
        for file in sorted(site.glob("*.html")):
            page.goto(file.as_uri())
            for width in (1280, 390):
                page.set_viewport_size({"width": width, "height": 900})
                wide[file.name, width] = page.evaluate(TOO_WIDE)
        browser.close()
    assert {place: lines for place, lines in wide.items() if lines} == {}


TOO_WIDE = """() => [...document.querySelectorAll("article pre, article dt.sig")]
  .filter((element) => element.scrollWidth > element.clientWidth + 1)
  .map((element) => element.textContent.slice(0, 60))"""
