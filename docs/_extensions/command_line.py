"""The directive `all-commands`: every command of `smartplay-tools`, from the help that it prints itself."""

from __future__ import annotations

import re
from typing import Any

import typer
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from typer.cli import get_docs_for_click
from typer.main import get_command

from smartplay_tools.cli import app as commands

NAME = "smartplay-tools"
EXAMPLE = re.compile(r"^Example: (.+?)\n(?=\n)", flags=re.MULTILINE | re.DOTALL)


class AllCommands(SphinxDirective):
    """A section for each command."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        command = get_command(commands)
        words = get_docs_for_click(obj=command, ctx=typer.Context(command, info_name=NAME), name=NAME)
        _, *sections = re.split(r"^(?=## )", words, flags=re.MULTILINE)  # what comes first lists the commands
        text = EXAMPLE.sub(lambda example: f"```sh\n{' '.join(example[1].split())}\n```\n", "".join(sections))
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("all-commands", AllCommands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
