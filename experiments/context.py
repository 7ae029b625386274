"""What a smaller context costs in score, and what it saves in tokens: the experiment of `docs/experiments.md`.

    python experiments/context.py                        # rule players: no key, no network, minutes
    python experiments/context.py --player openai:MODEL  # the same questions to a model; see --help

The players are rules that know only what their prompts say. They count the rounds that they see and do not depend on
the size of the window, so the effect of the window is measured and not programmed. The player `random` ignores its
prompts and is the control: it has to have exactly the same score with every window.

Each question is one sweep with its own folder. The same command again continues where it stopped, and does not repeat
finished episodes. `--publish` puts rows, tables and figures into the checkout.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from context_questions import CONTROL, QUESTIONS
from context_tables import TARIFFS, table
from page_tables import DOCS, Experiment, arguments, check_finished, player_options, priced, records_of

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.run import run_figures
from smartplay_tools.evaluation.runs.sweeps import Sweep, sweep
from smartplay_tools.records.rows import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CONTROL", "EXPERIMENTS", "QUESTIONS", "main", "table"]


def figures(name: str, rows: Sequence[Row]) -> dict[str, Figure]:
    """The figures of a question's answer that the pages show."""
    pages = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    named = {f"{name}-{figure}": drawn for figure, drawn in run_figures(rows).items()}
    return {figure: drawn for figure, drawn in named.items() if f"figures/{figure}.svg)" in pages}


EXPERIMENTS = {
    name: Experiment(name, lambda rows, name=name: {name: table(name, rows)}, partial(figures, name))
    for name in QUESTIONS
}


def main() -> None:
    """Play the sweeps, and print or publish the tables."""
    asked = _arguments()
    for name in asked.questions:
        run = _ask(name, asked)
        tariffs = TARIFFS.get(name, [])
        rows = priced(run.rows, records_of(run), tariffs) if tariffs else run.rows
        print(f"## {name}\n")
        EXPERIMENTS[name].conclude(rows, publishes=asked.publish)


def _arguments() -> argparse.Namespace:
    parser = arguments("What a smaller context costs in score, and saves in tokens.", "runs/context")
    player_options(parser)
    parser.add_argument("--base-url", help="the address of the server of openai:MODEL")
    parser.add_argument("--questions", nargs="+", choices=QUESTIONS, default=list(QUESTIONS), help="all by default")
    parser.add_argument("--trials", type=int, help="episodes of every cell")
    parser.add_argument("--seed", type=int, default=0, help="the seed of all randomness")
    parser.add_argument("--reply-tokens", type=int, help="cap on every reply, which a model needs")
    parser.add_argument("--run-tokens", type=int, help="cap on the tokens of each question")
    return parser.parse_args()


def _ask(name: str, asked: argparse.Namespace) -> Sweep:
    arguments = dict(QUESTIONS[name])
    if asked.player:
        arguments["players"] = tuple(asked.player)
        arguments.pop("player_options", None)
    if asked.base_url:
        arguments["player_options"] = {**arguments.get("player_options", {}), "base_url": asked.base_url}
    if asked.reply_tokens:
        budget = arguments.get("budget", sp.Budget())
        arguments["budget"] = budget.model_copy(update={"reply_tokens": asked.reply_tokens})
    if asked.trials:
        arguments["trials"] = asked.trials
    played = sweep(
        **arguments, out=asked.out / name, seed=asked.seed, workers=asked.workers, run_tokens=asked.run_tokens
    )
    check_finished(played, asked.out / name)
    played.write()
    return played


if __name__ == "__main__":
    main()
