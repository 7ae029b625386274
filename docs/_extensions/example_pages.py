"""The directive `all-examples`: every program in `examples/`, whole, in the order of their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

EXAMPLES = Path(__file__).parents[2] / "examples"


class AllExamples(SphinxDirective):
    """A section for each example, which says itself what it is."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        self.env.note_reread()
        text = "\n\n".join(map(_section, sorted(EXAMPLES.glob("*.py"))))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def _section(path: Path) -> str:
    number, *words = path.stem.split("_")
    return f"## {number} {' '.join(words)}\n\n```{{literalinclude}} ../examples/{path.name}\n:language: python\n```"


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("all-examples", AllExamples)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
