"""The directive `live-replay`: an episode that is played when the site is built, and its replay page in a frame.

    ```{live-replay} BanditTwoArmedHighLowFixed-v0
    :turn: 12
    :prompt-tokens: 700
    ```

The page is one file without a network.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import smartplay_tools as sp
from smartplay_tools.evaluation.pages.report.page import write_episode

SEED = 7


class LiveReplay(SphinxDirective):
    """Plays an episode with the rule player and frames its replay."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {
        "turn": directives.nonnegative_int,
        "prompt-tokens": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        """Return the frame."""
        game, cap = self.arguments[0], self.options.get("prompt-tokens")
        out = Path(self.env.app.outdir) / "_static" / f"replay-{game}.html"
        with tempfile.TemporaryDirectory() as folder:
            record = Path(folder) / "episode.jsonl"
            with sp.Episode(game, seed=SEED, budget=sp.Budget(prompt_tokens=cap), transcript=record) as episode:
                sp.play(episode, sp.get_player("rule"))
            write_episode(record, out, title=game)
        address = f"_static/{out.name}#episode=episode&turn={self.options.get('turn', 0)}&bare"
        title = f"The replay of an episode of {game}"
        frame = f'<iframe class="replay" src="{address}" title="{title}" loading="lazy"></iframe>'
        return [nodes.raw("", frame, format="html")]


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("live-replay", LiveReplay)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
