"""The directive `other-pages`: a table of contents of the pages that no other one on the page names.

A page that is written tomorrow is in the site tomorrow, without an edit here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.directives.other import TocTree


class OtherPages(TocTree):
    """`toctree`, which finds its pages by itself."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Return the table of contents."""
        named = Path(self.env.doc2path(self.env.docname)).read_text(encoding="utf-8").splitlines()
        self.content = StringList(sorted(self.env.found_docs - {self.env.docname, *named}), source=self.env.docname)
        self.env.note_reread()  # what there is can change while the page does not
        return super().run()


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("other-pages", OtherPages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
