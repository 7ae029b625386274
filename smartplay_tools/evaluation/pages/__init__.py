"""Pages: runs and records as HTML, for browsers and notebooks. Nothing here plays.

report/    the replay page, one file that opens from disk
notebook   tables and replays below a notebook's cells

The environment of the HTML templates: everything is escaped, and a name that is not given is an error.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from smartplay_tools.errors import extra_named
from smartplay_tools.visible import visible

if TYPE_CHECKING:
    from jinja2 import Environment


__all__ = ["environment"]


@cache
def environment(package: str, what: str) -> Environment:
    """Return the environment of a package's folder `templates`; without Jinja, a `MissingExtraError` about `what`.

    Each package has one, which remembers its compiled templates.
    """
    with extra_named(what, "evaluation"):
        from jinja2 import Environment, PackageLoader, StrictUndefined
    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: type(value)(visible(value)) if isinstance(value, str) else value,
    )
