"""How much of a score is the wording, and how much is chance: one model in four wordings, and each world four times.

    smartplay-tools model get
    python experiments/wordings.py             # continues where it stopped; about an hour of one processor
    python experiments/wordings.py --publish   # puts its rows and tables into the checkout
    python experiments/tables.py wordings      # the tables, from the published rows

The taught model of `models.py` plays the worlds of `models.py` in the newest version of the prompts and in the three
paraphrases of this package, beside the baselines of one line, which read the same words. The repeats of a world draw
the model's replies at temperature 0.7.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from models import BANDIT, CALLS, CAP, GAMES, HANDS, READING, SEED, TAUGHT, fixed_actions
from page_tables import Experiment, arguments, interval, markdown_table, mean_score, score_of

import smartplay_tools as sp
from smartplay_tools.context.prompts.wording import PARAPHRASES
from smartplay_tools.evaluation.analysis.pairs import paired_difference, reward, score
from smartplay_tools.evaluation.analysis.repeats import repeated
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import Bounds, mean_estimate
from smartplay_tools.types.groups import grouped

WORDINGS = ("version 3", *PARAPHRASES)
STAGES = ((BANDIT, 8), (HANDS, 8), (BANDIT, 16), (HANDS, 16), (HANDS, 24))
"""Games and the number of their worlds, in the order in which they are played."""
REPEATED, WORLDS, REPEATS = "MessengerL1-v0", 16, 4
BUDGET = {"prompt_tokens": CAP, "history": None, "tool_calls": CALLS, "slack": 0.5}


def play(out: Path) -> None:
    """Play what was not played before."""
    for number, (game, worlds) in enumerate(STAGES):
        for wording in WORDINGS:
            for player in (*READING[game], TAUGHT):
                rules: Any = {} if wording == WORDINGS[0] else {"wording": wording}
                _evaluate(out / wording / game / player, game, _config(player), trials=worlds, **rules)
        if not number:
            for player in ("random", "rule", *fixed_actions(REPEATED), TAUGHT):
                config = _config(player, temperature=0.7)
                _evaluate(out / "repeats" / REPEATED / player, REPEATED, config, trials=WORLDS, repeats=REPEATS)


def _config(player: str, **options: Any) -> PlayerConfig:
    if player != TAUGHT:
        return PlayerConfig(name=player)
    from smartplay_local import LocalPlayer

    return PlayerConfig(name=player, factory=LocalPlayer, options={"model": player, "threads": 1, **options})


def _evaluate(folder: Path, game: str, config: PlayerConfig, **given: Any) -> None:
    budget = sp.Budget(**BUDGET)
    done = sp.evaluate([game], [config], budgets=budget, out=folder, seed=SEED, executor="inline", **given)
    print(f"{folder}: {len(done.rows)} of {done.planned} episodes", flush=True)


def rows_of(out: Path) -> Iterator[Row]:
    """Yield the rows of everything that was played, with the wording that they were played in."""
    for folder in sorted(out.glob("*/*/*")):
        wording, _, player = folder.relative_to(out).parts
        yield from ({**row, "player": player, "wording": wording} for row in RunFolder(folder).rows())


def wordings_table(rows: Sequence[Row]) -> str:
    """The model in every wording beside the best baseline of one line in the same words, and beside version 3."""
    cells, lines = grouped(rows, lambda row: (row["game"], row["player"], row["wording"])), []
    for game, names in READING.items():
        for wording in WORDINGS:
            played, usual = cells[game, TAUGHT, wording], cells[game, TAUGHT, WORDINGS[0]]
            worlds = {row["trial"] for row in played}
            others = {name: [row for row in cells[game, name, wording] if row["trial"] in worlds] for name in names}
            best = max(names, key=lambda name: mean_score(others[name]).mean)
            less = [interval(paired_difference(played, others[best], measure), "+") for measure in (score, reward)]
            change = [interval(paired_difference(played, usual, score), "+") if played is not usual else ""]
            line = f"{best} ({mean_score(others[best]).mean:.2f})"
            lines.append([GAMES[game], wording, f"{len(played)}", score_of(played), line, *less, *change])
    less_line = ["best of one line", "model less it", "in points"]
    return markdown_table(["game", "wording", "worlds", "score [95 %]", *less_line, "less version 3"], lines)


def repeats_table(rows: Sequence[Row]) -> str:
    """How alike the repeats of a world are, and how often all of them succeed."""
    repeats = [row for row in rows if row["wording"] == "repeats"]
    lines, best = [], max(fixed_actions(REPEATED), key=lambda name: mean_score(_of(repeats, name)).mean)
    figures = repeated([row | {"completed": row["score"] >= 1} for row in repeats])
    shown = next(each.passes for each in figures if each.passes)
    for each in figures:
        if each.cell.player in {*fixed_actions(REPEATED)} - {best}:
            continue
        own = _of(repeats, each.cell.player)
        never = mean_estimate([0.0] * each.worlds, Bounds(0, 1))  # what so many worlds without a success leave
        passes: list[tuple[Any, ...]] = [every for _, _, every in each.passes] or [
            (never.mean, never.low, never.high)
        ] * len(shown)
        lines.append(
            [each.cell.player, score_of(own), _share(each.icc), f"{each.noise_floor:.2f}", *map(_share, passes)]
        )
    headings = ["player", "score [95 %]", "ICC", "noise floor", *(f"pass^{k}" for k, _, _ in shown)]
    return markdown_table(headings, lines)


def _of(rows: Sequence[Row], player: str) -> list[Row]:
    return [row for row in rows if row["player"] == player]


def _share(share: tuple[Any, ...] | None) -> str:
    return "all equal" if share is None else "{:.2f} [{:.2f}, {:.2f}]".format(*share)


EXPERIMENT = Experiment("wordings", lambda rows: {"wordings": wordings_table(rows), "repeats": repeats_table(rows)})


def main() -> None:
    """Play, and print or publish the tables."""
    asked = arguments(__doc__, "runs/wordings").parse_args()
    if not asked.publish:
        play(asked.out)
    EXPERIMENT.conclude(rows_of(asked.out), publishes=asked.publish)


if __name__ == "__main__":
    main()
