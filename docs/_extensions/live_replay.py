"""Directives that play an episode when the site is built: `live-replay` and `game-cards`.

`live-replay` frames the replay page of an episode:

    ```{live-replay} BanditTwoArmedHighLowFixed-v0
    :turn: 12
    :prompt-tokens: 700
    ```

The page is one file without a network, as `smartplay-tools share` writes it. `game-cards` shows a picture of each of
the games that it names, one a line: the card of a turn, as `smartplay-tools share --out card.png` draws it.
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
from smartplay_tools.evaluation.pages.cards import write_card
from smartplay_tools.evaluation.pages.report import write_excerpt

SEED = 7

CARD_TURNS = 12
"""Turns that are played for a card."""


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
            write_excerpt(record, out, title=game)
        address = f"_static/{out.name}#episode=episode&turn={self.options.get('turn', 0)}&bare"
        title = f"The replay of an episode of {game}"
        frame = f'<iframe class="replay" src="{address}" title="{title}" loading="lazy"></iframe>'
        return [nodes.raw("", frame, format="html")]


class GameCards(SphinxDirective):
    """Plays the first turns of games with the rule player and shows the card of the last of them."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the pictures."""
        return [nodes.raw("", f'<div class="cards">{"".join(map(self._card, self.content))}</div>', format="html")]

    def _card(self, game: str) -> str:
        out = Path(self.env.app.outdir) / "_static" / f"card-{game}.png"
        with tempfile.TemporaryDirectory() as folder:
            record = Path(folder) / "episode.jsonl"
            budget = sp.Budget(history=5, tool_calls=CARD_TURNS)
            with sp.Episode(game, seed=SEED, budget=budget, transcript=record) as episode:
                sp.play(episode, sp.get_player("rule"))
            write_card(record, out)
        return f'<img src="_static/{out.name}" alt="A turn of {game}, and which earlier turns its prompt showed">'


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("live-replay", LiveReplay)
    app.add_directive("game-cards", GameCards)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
