"""The arena: strategies for the past under the same exact caps, on the same seeds: a table of `docs/experiments.md`.

    python experiments/arena.py                          # scripted players: no key, no network, minutes
    python experiments/arena.py --player openai:MODEL    # the same question to a model
    python experiments/arena.py --strategy FILE.py:CLASS # with a strategy of your own beside the others
    python experiments/arena.py --table areas            # one of its tables alone: strategies, or areas
    python experiments/arena.py --table areas --game MessengerL3-v0 --out runs/messenger  # at another game

`rule-notes` has a use for a memory; told to say nothing, it keeps one where a strategy offers a place for it. `random`
ignores its prompts and is the control: it has to score the same under every strategy that asks it for nothing. The same
command continues where it stopped; `--publish` puts the tables into the documentation.

The table of areas has one number for all caps: what a strategy keeps of the gain of full context over `random`. There
the cap alone limits what is shown, not the history. Beside it is what an episode costs under the rules of three caches.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from page_tables import publish

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import MEASURES, MeanEstimate, by_cell, compare_windows, differences
from smartplay_tools.evaluation.analysis.area import Area, areas, curve_name
from smartplay_tools.evaluation.analysis.figures import areas_under_curves, save_figure
from smartplay_tools.evaluation.analysis.money import CellCost, cell_costs
from smartplay_tools.evaluation.analysis.names import strategy_name
from smartplay_tools.evaluation.analysis.windows import WindowComparison
from smartplay_tools.evaluation.runs import PlayerConfig, Run
from smartplay_tools.records.rows import Row
from smartplay_tools.records.tariffs import charge_records, tariffs_of
from smartplay_tools.types import STRATEGIES

PAGE = Path(__file__).parents[1] / "docs" / "experiments.md"
FIRST_AND_NEWEST = "experiments/first_and_newest.py:FirstAndNewest:turns=3"
"""The strategy of docs/add-a-strategy.md, as everybody brings one; the folder is that of the checkout."""
GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0")
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


CURVE_SEED = 815
"""Of the run of the areas: its worlds are in no other table."""
CURVE_CAPS = (700, 900, 1200)
CURVE_WAYS: tuple[dict[str, Any], ...] = (
    {},
    {"slack": 0.5},
    {"first_turns": 3},
    {"notes_tokens": 200},
    {"summary_tokens": 100, "slack": 0.5},
    {"recall_tokens": 150},
)
"""Of the areas: strategies that can differ from dropping for a player that is silent."""
PRICED_AT = 900
"""The cap whose episodes are priced."""
CACHES = ("none", "openai-5-5", "anthropic-512")
"""The rules of caches under which they are: without a cache, one by itself, and one that is marked."""


def budgets(brought: Sequence[str]) -> list[sp.Budget]:
    """Every strategy under every cap; `brought` are names of further ones."""
    ways = [*WAYS, *({"strategy": name} for name in brought)]
    return [sp.Budget(history=HISTORY, prompt_tokens=cap, **way) for cap in CAPS for way in ways]


def main() -> None:
    """Play the run, print the table, and write it."""
    asked = _arguments()
    subjects: Sequence[str | PlayerConfig] = asked.player or (
        PlayerConfig(name="rule-notes", options={"words": False}),
        CONTROL,
    )
    tables = {"strategies": _strategies, "areas": _areas}
    for name in asked.table or tables:
        written = tables[name](asked, subjects)
        print(written)
        if asked.publish:
            publish(PAGE, "arena" if name == "strategies" else "arena-areas", written)


def _strategies(asked: argparse.Namespace, subjects: Sequence[str | PlayerConfig]) -> str:
    done = _complete(
        GAMES,
        subjects,
        budgets=budgets([FIRST_AND_NEWEST, *(asked.strategy or ())]),
        trials=asked.trials,
        out=asked.out,
        workers=asked.workers,
    )
    return table(done)


def _areas(asked: argparse.Namespace, subjects: Sequence[str | PlayerConfig]) -> str:
    """Play every strategy under every cap, and full context and the control once, and return the table of areas."""
    brought = [{"strategy": name} for name in asked.strategy or ()]
    ways = [*CURVE_WAYS, *brought]
    full = sp.Budget(history=None)
    capped = [sp.Budget(history=None, prompt_tokens=cap, **way) for cap in CURVE_CAPS for way in ways]
    playing = [subject for subject in subjects if subject != CONTROL]
    games = asked.game or GAMES
    options = {"trials": asked.trials, "workers": asked.workers, "seed": CURVE_SEED}
    whole = _complete(games, [*playing, CONTROL], budgets=full, out=asked.out / "whole", **options)
    limited = _complete(games, playing, budgets=capped, out=asked.out / "capped", **options)
    # Without a cap nothing leaves, so full context is the same episodes under every strategy.
    shared = [
        {**row, "budget": {**row["budget"], **way}}
        for row in whole.rows
        for way in ([{}] if row["player"] == CONTROL else ways)
    ]
    records = {row["key"]: limited.transcript(row["key"]) for row in limited.rows}
    charged = charge_records(records, tariffs_of(CACHES), {})
    return areas_of(areas([*shared, *limited.rows]), cell_costs(limited.rows, charged), asked.figure)


def areas_of(curves: Sequence[Area], costs: Sequence[CellCost], figure: Path | None) -> str:
    """Every strategy in one number, and what an episode costs with it, in Markdown; differences hold together."""
    if figure is not None:
        save_figure(areas_under_curves(curves), figure, formats=["svg"])
    cost_of = {
        (each.cell.game, curve_name(each.cell)): each
        for each in costs
        if each.cell.budget["prompt_tokens"] == PRICED_AT
    }
    headings = ("game", "strategy", "seeds", "area [95 %]", "less dropping [95 %, all together]")
    lines = [_row([*headings, *(f"{PRICED_AT} tokens, {name}" for name in CACHES)]), _row(["---"] * (5 + len(CACHES)))]
    for each in curves:
        cost = cost_of.get((each.game, each.name))
        area = each.reason or f"{each.area:.2f} [{each.low:.2f}, {each.high:.2f}]"
        less = "reference" if each.together is None else "{:+.2f} [{:+.2f}, {:+.2f}]".format(*each.together)
        prices = [f"{cost.costs[at]:,.0f}" if cost else "-" for at in range(len(CACHES))]
        lines.append(_row([f"`{each.game}`", each.name, str(each.seeds), area, less, *prices]))
    return "\n".join(lines)


def _complete(*arguments: Any, **options: Any) -> Run:
    """Play a run, or leave if some of its episodes have no result."""
    done = sp.evaluate(*arguments, **options)
    if not done.complete:
        left = done.planned - len(done.rows)
        sys.exit(f"{left} episodes of {done.folder.path} are not finished; run the command again.")
    return done


def table(done: Run) -> str:
    """Every strategy beside plain dropping under the same cap, in Markdown; intervals hold together."""
    comparisons = compare_windows(done.rows, along=(*STRATEGIES, "slack"))
    columns: list[tuple[str, Callable[[WindowComparison], str]]] = [
        ("game", lambda c: f"`{c.cell.game}`"),
        ("player", _player),
        ("cap: strategy", lambda c: f"{c.cell.budget['prompt_tokens']:,}: {_way(c)}"),
        ("episodes", lambda c: str(c.episodes)),
        ("score [95 %]", lambda c: _interval(c.means["score"])),
        ("less dropping [95 %, all together]", lambda c: "reference" if c.is_full else _interval(c.together, "+")),
        ("tokens an episode", lambda c: f"{c.means['tokens'].mean:,.0f}"),
        ("prefix-stable", lambda c: f"{100 * c.means['prefix_share'].mean:.1f} %"),
    ]
    lines = [_row([heading for heading, _ in columns]), _row(["---"] * len(columns))]
    shown = [c for c in comparisons if c.cell.player != CONTROL]
    lines += [_row([show(comparison) for _, show in columns]) for comparison in shown]
    return "\n".join([*lines, "", *_control(done.rows)])


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
    differing = sum(map(bool, pairs))
    return [f"The control, `{CONTROL}`, without summaries: {len(pairs):,} pairs, of which {differing} differ in score."]


def _player(comparison: WindowComparison) -> str:
    silent = comparison.cell.player_options.get("words") is False
    return f"{comparison.cell.player}{', silent' if silent else ''}"


def _way(comparison: WindowComparison) -> str:
    slack = comparison.cell.budget["slack"]
    return strategy_name(comparison.cell) + (f", slack {slack:g}" if slack else "")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Strategies for the past under the same caps, on the same seeds.")
    parser.add_argument("--player", action="append", help="play with this player instead; repeatable")
    parser.add_argument("--strategy", action="append", help="a strategy of your own, FILE.py:CLASS; repeatable")
    parser.add_argument("--trials", type=int, default=20, help="episodes of every cell")
    parser.add_argument("--workers", type=int, help="episodes at a time; one for every processor by default")
    parser.add_argument("--out", type=Path, default=Path("runs/arena"), help="the folder of the run")
    parser.add_argument("--game", action="append", help="for the areas, these games instead; repeatable")
    parser.add_argument("--table", action="append", choices=["strategies", "areas"], help="one of the tables alone")
    parser.add_argument("--figure", type=Path, help="draw the areas: a path without suffix")
    parser.add_argument("--publish", action="store_true", help="put the table into the documentation")
    return parser.parse_args()


def _interval(estimate: MeanEstimate | None, sign: str = "-") -> str:
    if estimate is None:
        return "no pairs"
    mean = f"{estimate.mean:{sign}.2f}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{estimate.low:{sign}.2f}, {estimate.high:{sign}.2f}]"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
