"""Which local models can play, in which format of calls, and what a cap takes from those that can.

    smartplay-tools model get
    python experiments/entry.py --gemma FILE --qwen FILE            # every format; continues where it stopped
    python experiments/entry.py --qwen FILE --enter NAME            # all in view, and curves if the model enters
    python experiments/entry.py --adapter FILE --enter "taught 0"   # the same of an adapter of local_training.py
    python experiments/entry.py --publish                           # what was played, with three records of every cell
    python experiments/tables.py entry                              # the tables of the page, from the published rows

It needs the extras `local` and `evaluation`. One process plays at temperature 0 with one thread, in pairs of worlds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models import QWEN, TAUGHT, UNTAUGHT, rows_of, write_records
from page_tables import HERE, Experiment, arguments, complete, interval, markdown_table, mean_score

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.style import (
    Series,
    draw_estimates,
    figure,
    legend_below,
    panels,
    sample_note,
)
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED, PAIRS, CALLS = 29_112_026, 4, 10
LOCKERS, BANDIT = "Lockers6-v0", "BanditTwoArmedHighLowFixed-v0"
"""The games: in `CALLS` calls the first tells six things and asks for four of them."""
GEMMA, LEARNED = "gemma-3-270m", "smollm2-135m-lockers"
MODELS = UNTAUGHT, TAUGHT, GEMMA, QWEN
CAPS, HISTORIES = (400, 500, 600, 700, 800, 900), (2, 4, 6, 8, 10, 12)
MODEL = "model"
"""The model that is asked, among the players of its worlds."""
FORMATS = ("template", "text", "call", "bare", "words", "legal")
RULES: Mapping[str, Any] = {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"}
ENTRY, ENTRY_WORLDS = 0.9, 16
IN_VIEW = "all in view"
FOUR, EIGHT = "Lockers4-v0", "Lockers8-v0"
FACTS = {LOCKERS: 6, FOUR: 4, EIGHT: 8}


@dataclass(frozen=True)
class Asking:
    """One time that the model is asked to enter, and the curves that it plays if it does."""

    game: str
    form: str
    seed: int
    caps: Sequence[int] = ()
    histories: Sequence[int] = ()
    model: str = QWEN

    @property
    def curves(self) -> Mapping[str, Mapping[str, int]]:
        """Fields of the budget by the names of the ways."""
        caps = {f"cap {cap}": {"prompt_tokens": cap} for cap in self.caps}
        return caps | {f"history {steps}": {"history": steps} for steps in self.histories}


ASKED = {
    "call": Asking(LOCKERS, "call", SEED),
    "text": Asking(LOCKERS, "text", SEED),
    "fresh": Asking(LOCKERS, "text", SEED + 100),
    "four": Asking(FOUR, "text", SEED + 200, (390, 430, 470, 515, 560, 600), (1, 2, 3, 4, 5, 6)),
    "eight": Asking(EIGHT, "legal", SEED + 300, CAPS, HISTORIES),
    "untaught": Asking(EIGHT, "legal", SEED + 400, model=UNTAUGHT),
    **{
        f"taught {number}": Asking(EIGHT, "legal", SEED + 400, CAPS, HISTORIES, f"{LEARNED}-{number}")
        for number in range(3)
    },
}
"""One after the other.

`text` was asked for after `call` had failed and six worlds of `text` were seen, two of which are among its own; `fresh`
has others. A game of four things was tried in one world and asked for; then, after three worlds of six things in
`legal`, one of eight. The last four are a smaller model as it is and after three trainings, in worlds of their own.
"""
BOUNDS = {"cap": "tokens of a prompt", "history": "steps of history"}
SCRIPTS = "reader", "random"
MANUAL = 160
"""The cap on results, in tokens, under which no cap on prompts cuts the manual."""
ROUNDS = (8, 16, 24)
"""The worlds of every point of the curves, a round after the other."""


def play_formats(out: Path, files: Mapping[str, str]) -> None:
    """Play every model in every format, two worlds at a time."""
    from smartplay_local import find_model, read_gguf

    for pair, game, model in product(range(PAIRS), (LOCKERS, BANDIT), files):
        for form in FORMATS[not read_gguf(find_model(files[model])).knows_tools :]:
            play_cell(
                out / str(pair) / model / game / form,
                player_of(model, files[model], form),
                game,
                2,
                SEED + pair,
                tool_calls=CALLS,
            )


def play_entry(out: Path, file: str, entry: str) -> None:
    """Play the model and the scripts with all in view, and under every cap and history if the model enters."""
    asked = ASKED[entry]
    players = (*(PlayerConfig(name=script) for script in SCRIPTS), player_of(asked.model, file, asked.form))
    for worlds, way in ((ENTRY_WORLDS, IN_VIEW), *product(ROUNDS, asked.curves), (ROUNDS[-1], IN_VIEW)):
        fields = {"result_tokens": MANUAL, **asked.curves.get(way, {})}
        for player in players:
            play_cell(out / entry / player.name / asked.game / way, player, asked.game, worlds, asked.seed, **fields)
        if not enters(cells_of(rows_of(out), entry)[MODEL, IN_VIEW]):
            return


def player_of(model: str, file: str, form: str) -> PlayerConfig:
    """Return a model that plays in a format; the file of one that was taught lockers is that of its adapter."""
    from smartplay_local import LocalPlayer

    files = {"model": UNTAUGHT, "adapter": file} if model.startswith(LEARNED) else {"model": file}
    return PlayerConfig(name=model, factory=LocalPlayer, options={**files, "format": form, "threads": 1})


def play_cell(folder: Path, player: PlayerConfig, game: str, worlds: int, seed: int, **fields: Any) -> None:
    """Play worlds with fields of the budget, unless as many or more were played."""
    if sum(1 for _ in folder.glob("episodes/*.jsonl")) >= worlds:
        return
    budget = sp.Budget(**{"history": None, "reply_tokens": 80, **fields})
    given: Any = {"trials": worlds, "seed": seed, "executor": "inline", **RULES}
    done = complete([game], [player], budgets=budget, out=folder, **given)
    print(f"{folder}: {len(done.rows)} of {done.planned} episodes", flush=True)


Cells = Mapping[tuple[str, str], list[Row]]


def cells_of(rows: Iterable[Row], entry: str) -> Cells:
    """Group the rows of one time that the model was asked to enter by player and way; scripts in its worlds."""
    names = {ASKED[entry].model: MODEL, **{script: script for script in SCRIPTS}}
    own = (row for row in rows if row["worlds"] == entry)
    cells = grouped(own, lambda row: (names[row["player"]], row["way"]))
    played = {way: {row["trial"] for row in own} for (player, way), own in cells.items() if player == MODEL}
    return {
        (player, way): [row for row in own if row["trial"] in played[way]]
        for (player, way), own in cells.items()
        if way in played
    }


def enters(rows: Sequence[Row]) -> bool:
    """Whether a model enters the main table: with all in view its mean is near the best, in enough worlds."""
    return len(rows) >= ENTRY_WORLDS and mean_score(rows).mean >= ENTRY * FACTS[rows[0]["game"]]


def formats_table(rows: Sequence[Row]) -> str:
    """For each model and format: the steps, the illegal actions, and the right answers, all of which are in view."""
    counts = ("worlds", "steps", "illegal")
    headings = ("model", "format", *counts, "right of asked", *(f"bandit: {count}" for count in counts))
    lines, own = [], (row for row in rows if row["worlds"] not in ASKED)
    cells = grouped(own, lambda row: (row["player"], row["game"], row["way"]))
    for model, form in product(MODELS, FORMATS):
        if told := cells.get((model, LOCKERS, form)):
            lines.append([model, form, *_counts(told), _right(told), *_counts(cells.get((model, BANDIT, form), []))])
    return markdown_table(headings, lines)


def _counts(rows: Sequence[Row]) -> tuple[str, str, str]:
    steps, illegal = (sum(row[name] for row in rows) for name in ("steps", "illegal_actions"))
    return (f"{len(rows)}", f"{steps} of {CALLS * len(rows)}", f"{illegal}") if rows else ("", "", "")


def _right(rows: Sequence[Row]) -> str:
    """The right answers of those for which all that is needed was in view."""
    seen = [row.get("memory", {}).get("in view", (0, 0)) for row in rows]
    return " of ".join(f"{sum(counts)}" for counts in zip(*seen, strict=True))


def entry_table(rows: Sequence[Row]) -> str:
    """Every time that the model was asked to enter, beside the scripts, and its right answers; all was in view."""
    lines = []
    for number, (entry, asked) in enumerate(ASKED.items(), 1):
        cells = cells_of(rows, entry)
        if own := cells.get((MODEL, IN_VIEW)):
            failed = "does not enter" if len(own) >= ENTRY_WORLDS else "too few worlds"
            told = [f"{number}", asked.model, f"{FACTS[asked.game]}", asked.form, *_scores(cells, IN_VIEW)]
            lines.append([*told, "enters" if enters(own) else failed])
    return markdown_table(("asked", "model", "facts", "format", "worlds", "score", *SCRIPTS, "right", "verdict"), lines)


def _scores(cells: Cells, way: str) -> list[str]:
    """The worlds, the scores of the model and of the scripts, and its right answers where what they need is in view."""
    own = cells[MODEL, way]
    scripts = (interval(mean_score(cells[script, way])) for script in SCRIPTS)
    return [f"{len(own)}", interval(mean_score(own)), *scripts, _right(own)]


def curves_table(rows: Sequence[Row]) -> str:
    """The scores under every cap and history that was played."""
    lines = []
    for entry, asked in ASKED.items():
        cells = cells_of(rows, entry)
        ways = [way for way in asked.curves if (MODEL, way) in cells]
        who = asked.model, f"{FACTS[asked.game]}"
        lines += [[*who, way, *_scores(cells, way)] for way in (*[IN_VIEW] * bool(ways), *ways)]
    return markdown_table(("model", "facts", "way", "worlds", "score", *SCRIPTS, "right where in view"), lines)


def points(rows: Sequence[Row]) -> Mapping[tuple[str, str], Mapping[str, Mapping[float, MeanEstimate]]]:
    """Return the means of whole curves by time and bound, player, and cap or history; the last has all in view."""
    found: dict[tuple[str, str], Mapping[str, Mapping[float, MeanEstimate]]] = {}
    for (entry, asked), bound in product(ASKED.items(), BOUNDS):
        cells = cells_of(rows, entry)
        ways = {way: float(way.split()[1]) for way in asked.curves if way.startswith(bound)}
        if ways and all((MODEL, way) in cells for way in ways):
            found[entry, bound] = {
                player: {at: mean_score(cells[player, way]) for way, at in (*ways.items(), (IN_VIEW, math.inf))}
                for player in (MODEL, *SCRIPTS)
            }
    return found


def knee(curve: Mapping[float, MeanEstimate]) -> str:
    """The least cap or history from which on a player reaches nine tenths of its score with all in view."""
    found = "none"
    for at in sorted(curve, reverse=True):
        if curve[at].mean < ENTRY * curve[math.inf].mean:
            break
        found = f"{at:.0f}" if at < math.inf else found
    return found


def knees_table(rows: Sequence[Row]) -> str:
    """The knees of the model beside those of `reader`."""
    lines = (
        [ASKED[entry].model, f"{FACTS[ASKED[entry].game]}", bound, knee(curves[MODEL]), knee(curves["reader"])]
        for (entry, bound), curves in points(rows).items()
    )
    return markdown_table(("model", "facts", "bound", "its knee", "reader's"), lines)


@figure
def drawn_curves(rows: Sequence[Row]) -> Figure:
    """Draw the scores of the model and of the scripts over the cap and the history."""
    found, counts = points(rows), set[int]()
    drawn, axes = panels(len(found), columns=min(3, len(found)), size=(4.6, 3.6))
    for panel, ((entry, bound), curves) in zip(axes, found.items(), strict=True):
        asked = ASKED[entry]
        facts = FACTS[asked.game]
        for look, (player, curve) in enumerate(curves.items()):
            at = [at for at in curve if at < math.inf]
            draw_estimates(panel, at, [curve[each] for each in at], Series.number(look), player)
            counts |= {curve[each].episodes for each in at}
        knees = f"knee: {knee(curves[MODEL])}; reader's: {knee(curves['reader'])}"
        panel.set(
            title=f"{asked.model}, {facts} things:\n{knees}",
            xlabel=BOUNDS[bound],
            ylabel="right answers",
            ylim=(0, facts),
        )
    legend_below(drawn, note=sample_note(counts))
    return drawn


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    return {
        "entry-formats": formats_table(rows),
        "entry": entry_table(rows),
        "entry-curves": curves_table(rows),
        "entry-knees": knees_table(rows),
    }


EXPERIMENT = Experiment("entry", tables, lambda rows: {"entry-curves": drawn_curves(rows)})


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/entry")
    for model in ("gemma", "qwen"):
        parser.add_argument(f"--{model}", help="its file, which is played by its path")
    parser.add_argument("--adapter", help="the file of an adapter that was taught lockers")
    parser.add_argument("--enter", choices=ASKED, help="ask whether a model enters")
    asked = parser.parse_args()
    files = {UNTAUGHT: UNTAUGHT, TAUGHT: TAUGHT, GEMMA: asked.gemma, QWEN: asked.qwen}
    if asked.publish:
        models = (*MODELS, *(each.model for each in ASKED.values()))
        write_records(asked.out, HERE / EXPERIMENT.name / "records.tar.xz", models)
    elif asked.enter:
        play_entry(asked.out, files.get(ASKED[asked.enter].model, asked.adapter), asked.enter)
    else:
        play_formats(asked.out, {model: file for model, file in files.items() if file})
    EXPERIMENT.conclude(rows_of(asked.out), publishes=asked.publish)


if __name__ == "__main__":
    main()
