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
import json
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import (
    MEASURES,
    MeanEstimate,
    PlayedCell,
    WindowComparison,
    by_cell,
    compare_windows,
    differences,
    paired_difference,
)
from smartplay_tools.evaluation.analysis.money import CellCost, cell_costs
from smartplay_tools.evaluation.analysis.names import strategy_name
from smartplay_tools.evaluation.runs.sweeps import Sweep, sweep
from smartplay_tools.games import PAPER_RESULTS
from smartplay_tools.quantities import short
from smartplay_tools.records.tariffs import Tariff, charge_records, tariffs_of
from smartplay_tools.types import STRATEGIES

DOCS = Path(__file__).parents[1] / "docs"
PAGES = (DOCS / "experiments.md", DOCS / "context-cost.md")
"""The pages that have tables of this experiment."""
SMALL_GAMES = ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorBasic-v0")

CONTROL = "random"

QUESTIONS: dict[str, dict[str, Any]] = {
    "history": {
        "games": SMALL_GAMES,
        "players": ("rule", CONTROL),
        "vary": {
            "history": (0, 1, 2, 5, 10, 20, 50),
        },
        "trials": 100,
    },
    "prompt-tokens": {
        "games": SMALL_GAMES,
        "players": ("rule",),
        "vary": {
            "prompt_tokens": (500, 600, 800, 1000, 1500, None),
        },
        "trials": 100,
    },
    "slack": {
        "games": SMALL_GAMES,
        "players": ("rule",),
        "vary": {
            "history": (10,),
            "slack": (0, 0.1, 0.25, 0.5, 0.75, 1),
        },
        "trials": 100,
    },
    "crafter": {
        "games": ("Crafter-v0",),
        "players": ("rule", "rule-notes"),
        "vary": {
            "history": (2, 5, 10),
        },
        # With notes the player lives for the paper's 10,000 steps; fewer are enough to show the effect of notes.
        "budget": sp.Budget(tool_calls=1000),
        "trials": 40,
    },
    "messenger": {
        "games": ("MessengerL1-v0", "MessengerL2-v0", "MessengerL3-v0"),
        "players": ("rule", "rule-notes"),
        # The rules use the newest four observations: the latest one and three past ones.
        "vary": {
            "history": (0, 1, 2, 3),
        },
        "trials": 200,
    },
    "minecraft": {
        "games": ("MinedojoCreative0-v0", "MinedojoCreative1-v0"),
        "players": ("rule",),
        "vary": {
            "history": (0, 2, 5),
        },
        "trials": 20,
    },
    "strategies": {
        "games": ("BanditTwoArmedHighLowFixed-v0", "RockPaperScissorDifferentScore-v0"),
        # A memory is written only where a strategy offers a place for it.
        "players": ("rule-notes",),
        "player_options": {"words": False},
        "vary": {
            "history": (10,),
            "prompt_tokens": (700, 1000),
            "slack": (0.5,),
            "beyond_history": ("drop", "mask"),
            "notes_tokens": (None, 200),
            "summary_tokens": (None, 100),
        },
        "trials": 20,
    },
    "money": {
        "games": ("BanditTwoArmedHighLowFixed-v0", "Crafter-v0"),
        "players": ("rule",),
        "vary": {
            "history": (None,),
            "prompt_tokens": (1200, 2400, 8000),
            "slack": (0, 0.5),
        },
        "budget": sp.Budget(tool_calls=300),
        "trials": 10,
    },
    "capabilities": {
        "games": tuple(PAPER_RESULTS[0].raw)[
            :-1
        ],  # the last is Minecraft, for which the default engine is not the paper's
        "players": ("rule", "random"),
        "trials": 20,
    },
}
"""A sweep for each question."""


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
    parser = argparse.ArgumentParser(description="What a smaller context costs in score, and saves in tokens.")
    parser.add_argument("--player", action="append", help="play with this player instead; repeatable")
    parser.add_argument("--base-url", help="the address of the server of openai:MODEL")
    parser.add_argument("--questions", nargs="+", choices=QUESTIONS, default=list(QUESTIONS), help="all by default")
    parser.add_argument("--trials", type=int, help="episodes of every cell")
    parser.add_argument("--seed", type=int, default=0, help="the seed of all randomness")
    parser.add_argument("--workers", type=int, help="episodes at a time; one for every processor by default")
    parser.add_argument("--reply-tokens", type=int, help="cap on every reply, which a model needs")
    parser.add_argument("--run-tokens", type=int, help="cap on the tokens of each question")
    parser.add_argument("--out", type=Path, default=Path("runs/context"), help="the folder of the runs")
    parser.add_argument("--publish", action="store_true", help="put figures and tables into the documentation")
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
    return played


def table(name: str, played: Sweep) -> str:
    """The answer to a question, in Markdown."""
    along = {"slack": ("slack",), "strategies": tuple(STRATEGIES)}.get(name, ("history", "prompt_tokens", "slack"))
    comparisons = compare_windows(played.rows, along=along)
    if name == "strategies":
        return _strategies(played, comparisons)
    if name == "money":
        return _money(played)
    varied = {"prompt-tokens": "prompt_tokens", "slack": "slack"}.get(name, "history")
    columns: list[tuple[str, Callable[[WindowComparison], str]]] = [
        ("game", lambda c: f"`{c.cell.game}`"),
        ("player", lambda c: c.cell.player),
        (varied.replace("_", " "), lambda c: _limit(c.cell.budget[varied])),
        ("episodes", lambda c: str(c.episodes)),
        ("score [95 %]", lambda c: _interval(c.means["score"])),
        ("difference [95 %]", lambda c: "reference" if c.is_full else _interval(c.differences.get("score"), "+")),
        ("tokens an episode", lambda c: f"{c.means['tokens'].mean:,.0f}"),
        ("prefix-stable", lambda c: _percent(c.means["prefix_share"])),
    ]
    if name == "slack":
        columns.append(("gain (percentage points)", lambda c: _points(c.differences.get("prefix_share"))))
    lines = [_row(heading for heading, _ in columns), _row("---" for _ in columns)]
    shown = [c for c in comparisons if name != "history" or c.cell.player != CONTROL]
    lines += [_row(show(comparison) for _, show in columns) for comparison in shown]
    more = {"history": _control, "crafter": _notes, "messenger": _notes}.get(name)
    return "\n".join(lines + (["", *more(played)] if more else []))


def _strategies(played: Sweep, comparisons: Sequence[WindowComparison]) -> str:
    """Every strategy beside plain dropping under the same cap, and what it costs where prompts are cached."""
    costs = _costs(played, STRATEGY_RULES)
    columns: list[tuple[str, Callable[[WindowComparison], str]]] = [
        ("game", lambda c: f"`{c.cell.game}`"),
        ("player", lambda c: c.cell.player),
        ("cap: strategy", lambda c: f"{_limit(c.cell.budget['prompt_tokens'])}: {strategy_name(c.cell)}"),
        ("episodes", lambda c: str(c.episodes)),
        ("score [95 %]", lambda c: _interval(c.means["score"])),
        ("less dropping [95 %]", lambda c: "reference" if c.is_full else _interval(c.differences.get("score"), "+")),
        ("tokens an episode", lambda c: f"{c.means['tokens'].mean:,.0f}"),
        ("prefix-stable", lambda c: _percent(c.means["prefix_share"])),
    ]
    columns += [
        (tariff.label, lambda c, at=at: short(costs[_key(c.cell)].costs[at]))  # type: ignore[misc]
        for at, tariff in enumerate(STRATEGY_RULES)
    ]
    lines = [_row(heading for heading, _ in columns), _row("---" for _ in columns)]
    return "\n".join(lines + [_row(show(comparison) for _, show in columns) for comparison in comparisons])


def _money(played: Sweep) -> str:
    """What an episode of every window costs under the rules of caches, the least of a game and a rule in bold."""
    costs = list(_costs(played, MONEY_RULES).values())
    headings = (
        "game",
        "player",
        "cap, slack",
        "episodes",
        "score",
        "tokens",
        *(tariff.label for tariff in MONEY_RULES),
    )
    lines = [_row(headings), _row("---" for _ in headings)]
    for cost in costs:
        rivals = [other for other in costs if other.cell.game == cost.cell.game]
        amounts = (
            f"**{short(own)}**" if own == min(other.costs[at] for other in rivals) else short(own)
            for at, own in enumerate(cost.costs)
        )
        window = f"{_limit(cost.cell.budget['prompt_tokens'])}, {cost.cell.budget['slack']:g}"
        facts = (f"`{cost.cell.game}`", cost.cell.player, window, str(cost.episodes), f"{cost.score:,.4g}")
        lines.append(_row((*facts, short(cost.tokens), *amounts)))
    return "\n".join(lines)


def _costs(played: Sweep, tariffs: Sequence[Tariff]) -> dict[str, CellCost]:
    """What every cell costs."""
    records = {row["key"]: played.run.folder.transcript(row["key"]) for row in played.rows}
    return {_key(cost.cell): cost for cost in cell_costs(played.rows, charge_records(records, tariffs, {}))}


def _key(cell: PlayedCell) -> str:
    return json.dumps(asdict(cell), sort_keys=True)


STRATEGY_RULES = tariffs_of(["none", "anthropic-512", "vllm"])
MONEY_RULES = [
    *tariffs_of(["none", "openai-5-5", "openai-5-6", "anthropic-512"]),
    *(replace(tariff, label="anthropic-512, one mark") for tariff in tariffs_of(["anthropic-512"], marks=["stable"])),
    *tariffs_of(["anthropic-4096", "gemini-3", "deepseek-4", "vllm"]),
]
"""The rules of the tables' columns; costs are in uncached tokens of the input."""


def _control(played: Sweep) -> list[str]:
    """How often the control scores differently from full context, seed by seed."""
    cells = [(cell, rows) for cell, rows in by_cell(played.rows) if cell.player == CONTROL]
    widest = max(QUESTIONS["history"]["vary"]["history"])
    full = {cell.game: rows for cell, rows in cells if cell.budget["history"] == widest}
    others = [(cell, rows) for cell, rows in cells if cell.budget["history"] != widest]
    pairs = [pair for cell, rows in others for pair in differences(rows, full[cell.game], MEASURES["score"])]
    changed = sum(difference != 0 for difference in pairs)
    return [f"The control, `{CONTROL}`: {len(pairs):,} pairs, of which {changed} differ in score."] if pairs else []


def _notes(played: Sweep) -> list[str]:
    """The effect of notes with each history, seed by seed."""
    lines = [_row(("history", "game", "pairs", "score of rule-notes less that of rule [95 %]")), _row(("---",) * 4)]
    with_notes, without = (
        {(cell.game, cell.budget["history"]): rows for cell, rows in by_cell(played.rows) if cell.player == name}
        for name in ("rule-notes", "rule")
    )
    for game, history in with_notes:
        effect = paired_difference(with_notes[game, history], without.get((game, history), []), MEASURES["score"])
        if effect is not None:
            lines.append(_row((str(history), f"`{game}`", str(effect.episodes), _interval(effect, sign="+"))))
    return lines if len(lines) > 2 else []


def publish(tables: dict[str, str], out: Path) -> None:
    """Write the tables between their marks in the pages, and the figures into their folder."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name, table in tables.items():
            marked = re.compile(rf"(<!-- table: {name} -->\n)(.*?)(<!-- end -->)", flags=re.DOTALL)
            text = marked.sub(lambda match, table=table: f"{match[1]}\n{table}\n\n{match[3]}", text)  # type: ignore[misc]
        page.write_text(text, encoding="utf-8")
        for name in tables:
            for path in sorted((out / name / "figures").iterdir()):
                if f"figures/{name}-{path.name})" in text:
                    shutil.copyfile(path, DOCS / "figures" / f"{name}-{path.name}")


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _limit(value: float | None) -> str:
    return "none" if value is None else f"{value:,g}"


def _interval(estimate: MeanEstimate | None, sign: str = "-") -> str:
    if estimate is None:
        return "no pairs"
    digits = ",.0f" if max(abs(estimate.mean), abs(estimate.high or 0)) >= 100 else ",.2f"
    mean = f"{estimate.mean:{sign}{digits}}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{estimate.low:{sign}{digits}}, {estimate.high:{sign}{digits}}]"


def _percent(estimate: MeanEstimate) -> str:
    return f"{100 * estimate.mean:.1f} %"


def _points(estimate: MeanEstimate | None) -> str:
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    mean, low, high = (f"{100 * share:+.1f}" for share in (estimate.mean, estimate.low, estimate.high))
    return mean if low == high else f"{mean} [{low}, {high}]"


if __name__ == "__main__":
    main()
