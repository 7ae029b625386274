"""Answers of the site: their headers, pages from templates, scripts and styles."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response

from smartplay_tools.evaluation.pages import environment as template_environment
from smartplay_tools.types.arguments import well_formed

STATIC = {
    **dict.fromkeys(
        ("site.js", "view.js", "runs.js", "groups.js", "play.js", "games.js", "view.css"),
        "smartplay_tools.web.site",
    ),
    **dict.fromkeys(("basics.js", "snapshot.js", "page.css"), "smartplay_tools.evaluation.pages.report"),
}
"""What the pages load, and where it is."""

TYPES = {"js": "text/javascript", "css": "text/css"}

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; frame-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""The pages run their own scripts, speak to their own server and load nothing else."""

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class AsciiJson(JSONResponse):
    """JSON in ASCII, which can hold the half characters of names that are not UTF-8."""

    def render(self, content: Any) -> bytes:
        """Return the body."""
        return json.dumps(content, allow_nan=False).encode("ascii")


def missing(text: str) -> Response:
    """Return the answer 404, with a sentence."""
    return PlainTextResponse(well_formed(text), 404, HEADERS)


def page(template: str, **values: Any) -> Response:
    """Answer with a page."""
    return _text(template_environment(__package__, "The site").get_template(template).render(values), "text/html")


async def static(request: Request) -> Response:
    """Answer with a script or a style."""
    name = request.path_params["name"]
    if name not in STATIC:
        return missing("There is no such file.")
    text = resources.files(STATIC[name]).joinpath("static", name).read_text(encoding="utf-8")
    return _text(text, TYPES[name.rpartition(".")[2]])


def _text(text: str, kind: str) -> Response:
    return Response(text, media_type=kind, headers={**HEADERS, "Content-Security-Policy": POLICY})
