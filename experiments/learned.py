"""What is context worth to a model that was trained for it? The experiment of `docs/train-a-tiny-agent.md`.

    pip install 'smartplay-tools[train,evaluation]'
    python experiments/learned.py --quick       # a minute, which shows that everything works and teaches nothing
    python experiments/learned.py               # trains and plays, and continues where it stopped: an hour
    python experiments/tables.py learned        # the tables, from the published rows

Tiny transformers (`examples/tiny_agent.py`) learn to reply as a teacher did, each from windows of one kind, and play
worlds that neither the teacher nor they have played, under caps and strategies that they were trained for and under
others. Every episode is one line of `episodes.csv`. `play` records the first episode of each cell; the records of six
cells are published beside the rows.
"""

from __future__ import annotations

from learned_lab import play
from page_tables import arguments


def main() -> None:
    """Train and play."""
    parser = arguments(__doc__, "runs/learned", publishes=False)
    parser.add_argument("--quick", action="store_true", help="play a few small cells, of each kind one")
    asked = parser.parse_args()
    play(asked.out, quick=asked.quick)


if __name__ == "__main__":
    main()
