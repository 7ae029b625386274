"""The arena: strategies for the past under the same exact caps, on the same seeds: a table of `docs/experiments.md`.

    python experiments/arena.py                          # scripted players: no key, no network; needs the extra popgym
    python experiments/arena.py --player openai:MODEL    # the same question to a model
    python experiments/arena.py --strategy FILE.py:CLASS # with a strategy of your own beside the others

`rule-notes` has a use for a memory; told to say nothing, it keeps one where a strategy offers a place for it. In
RepeatPrevious, where the right answer stands in an earlier observation, `reader` plays rightly from what is visible, or
was kept as notes or a summary, and guesses otherwise: the score is that of the strategy alone. `random` ignores its
prompts and is the control: it has to score the same under every strategy that asks it for nothing. The same command
continues where it stopped; `--publish` puts rows and table into the checkout.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from page_tables import (
    GAME,
    TOGETHER,
    Column,
    Experiment,
    Line,
    arguments,
    compared_lines,
    complete,
    control_line,
    player_options,
    repeat_previous,
    score_or,
    table_across,
)

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.names import way_name
from smartplay_tools.evaluation.analysis.pairs import MEASURES, differences
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.types import STRATEGIES

FIRST_AND_NEWEST = "experiments/first_and_newest.py:FirstAndNewest:turns=3"
"""The strategy of docs/add-a-strategy.md, as everybody brings one; the folder is that of the checkout."""
RULE_NOTES, READER = PlayerConfig(name="rule-notes", options={"words": False}), PlayerConfig(name="reader")
GAMES = {
    "BanditTwoArmedHighLowFixed-v0": RULE_NOTES,
    "RockPaperScissorDifferentScore-v0": RULE_NOTES,
    repeat_previous(8): READER,
    repeat_previous(12): READER,
}
"""The games, each with its scripted player."""
CAPS = (700, 1000)
HISTORY = 10
CONTROL = "random"
WAYS: tuple[dict[str, Any], ...] = (
    {},
    {"slack": 0.5},
    {"beyond_history": "mask"},
    {"own_words": 2},
    {"first_turns": 3},
    {"notes_tokens": 200},
    {"summary_tokens": 100, "slack": 0.5},
)
"""The strategies, as fields of a budget; the first is what the others are compared with."""


def budgets(custom: Sequence[str]) -> list[sp.Budget]:
    """Every strategy under every cap; `custom` are names of further ones."""
    ways = [*WAYS, *({"strategy": name} for name in custom)]
    return [sp.Budget(history=HISTORY, prompt_tokens=cap, **way) for cap in CAPS for way in ways]


def main() -> None:
    """Play the run, print the table, and write it."""
    asked = _arguments()
    rows = [
        row
        for game, subject in GAMES.items()
        for row in complete(
            [game],
            [*(player for player in asked.player or [subject] if player != CONTROL), CONTROL],
            budgets=budgets([FIRST_AND_NEWEST, *(asked.strategy or ())]),
            trials=asked.trials,
            out=asked.out / game,
            workers=asked.workers,
        ).rows
    ]
    EXPERIMENT.conclude(rows, publishes=asked.publish)


def table(rows: Sequence[Row]) -> str:
    """Every strategy beside plain dropping under the same cap, a cap a column; intervals hold together."""
    less: Column = "less dropping", score_or(TOGETHER[1])
    subjects = {SUBJECT[1](line) for line in compared_lines(rows, (), [CONTROL])}
    columns = [GAME, *([] if subjects <= {"rule-notes, silent", "reader"} else [SUBJECT]), WAY]
    shown = table_across(rows, (*STRATEGIES, "slack"), columns, _cap, [less], without=[CONTROL])
    return "\n".join([shown, "", *_control(rows)])


def _player(line: Line) -> str:
    cell = line.compared.cell
    return f"{cell.player}{', silent' if cell.player_options.get('words') is False else ''}"


def _cap(line: Line) -> str:
    return f"{line.compared.cell.budget['prompt_tokens']:,}"


SUBJECT: Column = "player", _player
WAY: Column = "strategy", lambda line: way_name(line.compared.cell)


def _control(rows: Sequence[Row]) -> list[str]:
    """How often the control scores differently under a strategy, seed by seed."""
    cells = [(cell, members) for cell, members in by_cell(rows) if cell.player == CONTROL]
    if not cells:
        return []
    pairs: list[float] = []
    for game in GAMES:
        # A request for a summary takes one of the draws with which it would have played on.
        asked = [(cell, members) for cell, members in cells if cell.budget["summary_tokens"] is None]
        own = [members for cell, members in asked if cell.game == game]
        pairs += [pair for members in own[1:] for pair in differences(members, own[0], MEASURES["score"])]
    return [control_line(f"`{CONTROL}`, without summaries", pairs)]


EXPERIMENT = Experiment("arena", lambda rows: {"arena": table(rows)})


def _arguments() -> argparse.Namespace:
    parser = arguments("Strategies for the past under the same caps, on the same seeds.", "runs/arena")
    player_options(parser)
    parser.add_argument("--strategy", action="append", help="a strategy of your own, FILE.py:CLASS; repeatable")
    parser.add_argument("--trials", type=int, default=20, help="episodes of every cell")
    return parser.parse_args()


if __name__ == "__main__":
    main()
