"""Which local models can play, in which format of calls, and what a cap takes from those that can.

    smartplay-tools model get
    python experiments/entry.py --gemma FILE --qwen FILE            # every format; continues where it stopped
    python experiments/entry.py --qwen FILE --enter FORMAT          # all in view, and curves if the model enters
    python experiments/entry.py --publish                           # what was played, with three records of every cell
    python experiments/tables.py entry                              # the tables of the page, from the published rows

It needs the extras `local` and `evaluation`. One process plays at temperature 0 with one thread, in pairs of worlds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models import QWEN, TAUGHT, UNTAUGHT, rows_of, write_records
from page_tables import HERE, Experiment, arguments, interval, markdown_table, mean_score

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
from smartplay_tools.games.specs import lockers_setting
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED, PAIRS, CALLS = 29_112_026, 4, 10
LOCKERS, BANDIT = "Lockers6-v0", "BanditTwoArmedHighLowFixed-v0"
"""The games: in `CALLS` calls the first tells six things and asks for four of them."""
GEMMA = "gemma-3-270m"
MODELS = UNTAUGHT, TAUGHT, GEMMA, QWEN
FORMATS = ("template", "text", "call", "bare", "words", "legal")
RULES: Mapping[str, Any] = {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"}
ENTRY, ENTRY_WORLDS = 0.9, 16
IN_VIEW = "all in view"
FOUR, EIGHT = (sp.register(lockers_setting(f"Lockers{facts}-v0", facts=facts)).id for facts in (4, 8))
FACTS = {LOCKERS: 6, FOUR: 4, EIGHT: 8}
ENTRIES = {
    "call": (LOCKERS, "call", SEED),
    "text": (LOCKERS, "text", SEED),
    "fresh": (LOCKERS, "text", SEED + 100),
    "four": (FOUR, "text", SEED + 200),
    "eight": (EIGHT, "legal", SEED + 300),
}
"""Every time that a model was asked to enter, one after the other: the game, the format and the seed of the worlds.

`text` was asked for after `call` had failed and six worlds of `text` were seen, two of which are among its own; `fresh`
has others. A game of four things was tried in one world and asked for; then, after three worlds of six things in
`legal`, one of eight.
"""
CURVED = "eight"
"""The entry whose curves are shown."""
BOUNDS = {"cap": "tokens of a prompt", "history": "steps of history"}
SCRIPTS = "reader", "random"
CURVES: Mapping[str, Mapping[str, int]] = {
    **{f"cap {cap}": {"prompt_tokens": cap} for cap in (400, 500, 600, 700, 800, 900)},
    **{f"history {steps}": {"history": steps} for steps in (2, 4, 6, 8, 10, 12)},
}
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


def play_entry(out: Path, model: str, file: str, entry: str) -> None:
    """Play a model and the scripts with all in view, and under every cap and history if the model enters."""
    game, form, seed = ENTRIES[entry]
    players = (*(PlayerConfig(name=script) for script in SCRIPTS), player_of(model, file, form))
    for worlds, way in ((ENTRY_WORLDS, IN_VIEW), *product(ROUNDS, CURVES), (ROUNDS[-1], IN_VIEW)):
        fields = {"result_tokens": MANUAL, **CURVES.get(way, {})}
        for player in players:
            play_cell(out / entry / player.name / game / way, player, game, worlds, seed, **fields)
        if not enters(cells_of(rows_of(out), entry)[model, game, IN_VIEW]):
            return


def player_of(model: str, file: str, form: str) -> PlayerConfig:
    """Return a model that plays in a format."""
    from smartplay_local import LocalPlayer

    return PlayerConfig(name=model, factory=LocalPlayer, options={"model": file, "format": form, "threads": 1})


def play_cell(folder: Path, player: PlayerConfig, game: str, worlds: int, seed: int, **fields: Any) -> None:
    """Play worlds with fields of the budget; what was played is not played again."""
    budget = sp.Budget(**{"history": None, "reply_tokens": 80, **fields})
    given: Any = {"trials": worlds, "seed": seed, "executor": "inline", **RULES}
    done = sp.evaluate([game], [player], budgets=budget, out=folder, **given)
    print(f"{folder}: {len(done.rows)} of {done.planned} episodes", flush=True)


Cells = Mapping[tuple[str, str, str], list[Row]]


def cells_of(rows: Iterable[Row], entry: str | None = None) -> Cells:
    """Group rows by player, game and way: what bounds the prompts of an entry, or without one a format."""
    own = (row for row in rows if (row["worlds"] if row["worlds"] in ENTRIES else None) == entry)
    return grouped(own, lambda row: (row["player"], row["game"], row["way"]))


def enters(rows: Sequence[Row]) -> bool:
    """Whether a model enters the main table: with all in view its mean is near the best, in enough worlds."""
    return len(rows) >= ENTRY_WORLDS and mean_score(rows).mean >= ENTRY * FACTS[rows[0]["game"]]


def formats_table(cells: Cells) -> str:
    """For each model and format: the steps, the illegal actions, and the right answers, all of which are in view."""
    headings = ("model", "format", "worlds", "steps", "illegal", "right of asked", "bandit: worlds", "steps", "illegal")
    lines = []
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
    for entry, (game, form, _) in ENTRIES.items():
        cells = cells_of(rows, entry)
        if own := cells.get((QWEN, game, IN_VIEW)):
            failed = "does not enter" if len(own) >= ENTRY_WORLDS else "too few worlds"
            scripts = (interval(mean_score(cells[script, game, IN_VIEW])) for script in SCRIPTS)
            told = [f"{FACTS[game]}", form, f"{len(own)}", interval(mean_score(own)), *scripts, _right(own)]
            lines.append([*told, "enters" if enters(own) else failed])
    return markdown_table(("facts", "format", "worlds", "score", *SCRIPTS, "right", "verdict"), lines)


def curves_table(cells: Cells, game: str) -> str:
    """The scores under every cap and history, and the right answers where all that is needed is in view."""
    lines = []
    for way in (IN_VIEW, *CURVES):
        if own := cells.get((QWEN, game, way)):
            scripts = (interval(mean_score(cells[script, game, way])) for script in SCRIPTS)
            lines.append([way, f"{len(own)}", interval(mean_score(own)), *scripts, _right(own)])
    return markdown_table(("way", "worlds", "score", *SCRIPTS, "right where in view"), lines)


def knee(cells: Cells, player: str, game: str, bound: str) -> str:
    """The least cap or history from which on a player reaches nine tenths of its score with all in view."""
    best, found = mean_score(cells[player, game, IN_VIEW]).mean, "none"
    for way in reversed([way for way in CURVES if way.startswith(bound) and (player, game, way) in cells]):
        if mean_score(cells[player, game, way]).mean < ENTRY * best:
            break
        found = way.removeprefix(bound).strip()
    return found


def knees_table(cells: Cells, game: str) -> str:
    """The knee of the model beside that of `reader`."""
    lines = ([bound, knee(cells, QWEN, game, bound), knee(cells, "reader", game, bound)] for bound in BOUNDS)
    return markdown_table(("bound", "its knee", "reader's"), lines)


@figure
def curves(cells: Cells, game: str) -> Figure:
    """Draw the scores of the model and of the scripts over the cap and the history."""
    drawn, axes = panels(len(BOUNDS), columns=len(BOUNDS), size=(4.2, 3.6))
    counts = set()
    for panel, bound in zip(axes, BOUNDS, strict=True):
        for look, player in enumerate((QWEN, *SCRIPTS)):
            played = {way: cells[player, game, way] for way in CURVES if way.startswith(bound)}
            means = [mean_score(rows) for rows in played.values()]
            at = [float(way.split()[1]) for way in played]
            draw_estimates(panel, at, means, Series.number(look), player)
            counts |= {each.episodes for each in means}
        found = f"knee at {knee(cells, QWEN, game, bound)}, reader's at {knee(cells, 'reader', game, bound)}"
        panel.set(title=found, xlabel=BOUNDS[bound], ylabel=f"right answers of {FACTS[game]}")
    legend_below(drawn, note=sample_note(counts))
    return drawn


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells, game = cells_of(rows, CURVED), ENTRIES[CURVED][0]
    return {
        "entry-formats": formats_table(cells_of(rows)),
        "entry": entry_table(rows),
        "entry-curves": curves_table(cells, game),
        "entry-knees": knees_table(cells, game),
    }


EXPERIMENT = Experiment(
    "entry", tables, lambda rows: {"entry-curves": curves(cells_of(rows, CURVED), ENTRIES[CURVED][0])}
)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/entry")
    for model in ("gemma", "qwen"):
        parser.add_argument(f"--{model}", help="its file, which is played by its path")
    parser.add_argument("--enter", choices=ENTRIES, help="ask whether Qwen enters")
    asked = parser.parse_args()
    files = {UNTAUGHT: UNTAUGHT, TAUGHT: TAUGHT, GEMMA: asked.gemma, QWEN: asked.qwen}
    if asked.publish:
        write_records(asked.out, HERE / EXPERIMENT.name / "records.tar.xz", MODELS)
    elif asked.enter:
        play_entry(asked.out, QWEN, asked.qwen, asked.enter)
    else:
        play_formats(asked.out, {model: file for model, file in files.items() if file})
    EXPERIMENT.conclude(rows_of(asked.out), publishes=asked.publish)


if __name__ == "__main__":
    main()
