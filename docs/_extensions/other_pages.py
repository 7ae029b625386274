"""The directive `other-pages`: a table of contents that ends with the pages that none on its page names.

A page that is written tomorrow is in the site tomorrow, without an edit here.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.directives.other import TocTree


class OtherPages(TocTree):
    """`toctree`: what it lists, and then what nobody does."""

    def run(self) -> list[nodes.Node]:
        """Return the table of contents."""
        text = Path(self.env.doc2path(self.env.docname)).read_text(encoding="utf-8")
        named = re.findall(r"^(?:.+ <)?([\w-]+)>?$", text, flags=re.MULTILINE)
        others = sorted(self.env.found_docs - {self.env.docname, *named})
        self.content = StringList([*self.content, *others], source=self.env.docname)
        self.env.note_reread()  # what there is can change while the page does not
        return super().run()


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("other-pages", OtherPages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
