"""What a smaller context costs in score, and what it saves in tokens: the experiment of `docs/experiments.md`.

    python experiments/context.py                        # rule players: no key, no network, minutes
    python experiments/context.py --player openai:MODEL  # the same questions to a model; see --help

The players are rules that know only what their prompts say. They count the rounds that they see and do not depend on
the size of the window, so the effect of the window is measured and not programmed. The player `random` ignores its
prompts and is the control: it has to have exactly the same score with every window.

Each question is one sweep with its own folder. The same command again continues where it stopped, and does not repeat
finished episodes. `--publish` puts figures and tables into the documentation.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from context_questions import CONTROL, QUESTIONS
from context_tables import table
from page_tables import arguments, mark, publish as publish_table
from strategy_figure import ALONG, effects_of_strategies

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.style import save_figure
from smartplay_tools.evaluation.analysis.windows import compare_windows
from smartplay_tools.evaluation.runs.sweeps import Sweep, sweep

__all__ = ["CONTROL", "QUESTIONS", "main", "table"]

DOCS = Path(__file__).parents[1] / "docs"
PAGES = (DOCS / "experiments.md", DOCS / "context-cost.md")
"""The pages that have tables of this experiment."""


def main() -> None:
    """Play the sweeps, print the tables, and write them and the figures."""
    asked = _arguments()
    tables: dict[str, str] = {}
    for name in asked.questions:
        played = _ask(name, asked)
        tables[name] = table(name, played)
        print(f"## {name}\n\n{tables[name]}\n", flush=True)
    (asked.out / "tables.md").write_text("\n\n".join(tables.values()) + "\n", encoding="utf-8")
    if asked.publish:
        publish(tables, asked.out)


def _arguments() -> argparse.Namespace:
    parser = arguments("What a smaller context costs in score, and saves in tokens.", "runs/context")
    parser.add_argument("--player", action="append", help="play with this player instead; repeatable")
    parser.add_argument("--base-url", help="the address of the server of openai:MODEL")
    parser.add_argument("--questions", nargs="+", choices=QUESTIONS, default=list(QUESTIONS), help="all by default")
    parser.add_argument("--trials", type=int, help="episodes of every cell")
    parser.add_argument("--seed", type=int, default=0, help="the seed of all randomness")
    parser.add_argument("--workers", type=int, help="episodes at a time; one for every processor by default")
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
    if not played.run.complete:
        left = played.run.planned - len(played.rows)
        sys.exit(f"{left} episodes of {asked.out / name} are not finished; the same command goes on with them.")
    played.write()
    if name == "strategies":
        drawn = effects_of_strategies(compare_windows(played.rows, along=ALONG))
        save_figure(drawn, asked.out / name / "figures" / "strategies")
    return played


def publish(tables: dict[str, str], out: Path) -> None:
    """Write the tables between their marks in the pages, and the figures into their folder."""
    texts = {page: page.read_text(encoding="utf-8") for page in PAGES}
    for name, answer in tables.items():
        publish_table(next(page for page, text in texts.items() if mark(name) in text), name, answer)
        for path in sorted((out / name / "figures").iterdir()):
            if any(f"figures/{name}-{path.name})" in text for text in texts.values()):
                drawn = _compact(path.read_text(encoding="utf-8"))
                (DOCS / "figures" / f"{name}-{path.name}").write_text(drawn, encoding="utf-8", newline="\n")


def _compact(drawing: str) -> str:
    """A drawing with two decimals and without indentation: a repository keeps every version of it."""
    return re.sub(r"\n +", "\n", re.sub(r"(\.\d\d)\d+", r"\1", drawing))


if __name__ == "__main__":
    main()
