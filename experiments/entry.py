"""Which local models can play, in which format of calls, and what a cap takes from those that can.

    smartplay-tools model get
    python experiments/entry.py --gemma FILE --qwen FILE            # every format; continues where it stopped
    python experiments/entry.py --qwen FILE --enter FORMAT          # all in view, and curves if the model enters
    python experiments/entry.py --publish                           # what was played, with three records of every cell
    python experiments/tables.py entry                              # the tables of the page, from the published rows

It needs the extras `local` and `evaluation`. One process plays at temperature 0 with one thread, in pairs of worlds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from models import QWEN, TAUGHT, UNTAUGHT, rows_of, write_records
from page_tables import HERE, Experiment, arguments, interval, markdown_table, mean_score

import smartplay_tools as sp
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

SEED, PAIRS, CALLS = 29_112_026, 4, 10
LOCKERS, BANDIT, MOST = "Lockers6-v0", "BanditTwoArmedHighLowFixed-v0", 6
"""The games, and the best score of the first: in `CALLS` calls it tells six things and asks for four of them."""
GEMMA = "gemma-3-270m"
MODELS = UNTAUGHT, TAUGHT, GEMMA, QWEN
FORMATS = ("template", "text", "call", "bare", "words", "legal")
RULES: Mapping[str, Any] = {"manual": "pinned", "first_observation": "prompt", "offered_tools": "useful"}
ENTRY, ENTRY_WORLDS, CURVE_WORLDS = 0.9, 16, 24
IN_VIEW = "all in view"
SCRIPTS = "reader", "random"
CURVES: Mapping[str, Mapping[str, int]] = {
    **{f"cap {cap}": {"prompt_tokens": cap} for cap in (420, 490, 560, 600, 650, 700)},
    **{f"history {steps}": {"history": steps} for steps in (1, 3, 5, 7, 9, 11)},
}


def play_formats(out: Path, files: Mapping[str, str]) -> None:
    """Play every model in every format, two worlds at a time."""
    from smartplay_local import find_model, read_gguf

    for pair, game, model in product(range(PAIRS), (LOCKERS, BANDIT), files):
        for form in FORMATS[not read_gguf(find_model(files[model])).knows_tools :]:
            _play(
                out / str(pair) / model / game / form,
                _config(model, files[model], form),
                game,
                2,
                SEED + pair,
                tool_calls=CALLS,
            )


def play_entry(out: Path, model: str, file: str, form: str) -> None:
    """Play a model and the scripts with all in view, and under every cap and history if the model enters."""
    for way, worlds in {IN_VIEW: ENTRY_WORLDS, **dict.fromkeys(CURVES, CURVE_WORLDS)}.items():
        for player in (*(PlayerConfig(name=script) for script in SCRIPTS), _config(model, file, form)):
            _play(out / "entry" / player.name / LOCKERS / way, player, LOCKERS, worlds, SEED, **CURVES.get(way, {}))
        if not enters(cells_of(list(rows_of(out)))[model, LOCKERS, IN_VIEW]):
            return


def _config(model: str, file: str, form: str) -> PlayerConfig:
    from smartplay_local import LocalPlayer

    return PlayerConfig(name=model, factory=LocalPlayer, options={"model": file, "format": form, "threads": 1})


def _play(folder: Path, player: PlayerConfig, game: str, worlds: int, seed: int, **fields: Any) -> None:
    budget = sp.Budget(**{"history": None, "reply_tokens": 80, **fields})
    given: Any = {"trials": worlds, "seed": seed, "executor": "inline", **RULES}
    done = sp.evaluate([game], [player], budgets=budget, out=folder, **given)
    print(f"{folder}: {len(done.rows)} of {done.planned} episodes", flush=True)


Cells = Mapping[tuple[str, str, str], list[Row]]


def cells_of(rows: Sequence[Row]) -> Cells:
    """Group rows by player, game and way: a format, or for the entry condition what bounds the prompts."""
    return grouped(rows, lambda row: (row["player"], row["game"], row["way"]))


def enters(rows: Sequence[Row]) -> bool:
    """Whether a model enters the main table: with all in view its mean is near the best, in enough worlds."""
    return len(rows) >= ENTRY_WORLDS and mean_score(rows).mean >= ENTRY * MOST


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


def entry_table(cells: Cells) -> str:
    """Every way in which a model was asked to enter, beside the scripts, and its right answers where all is in view."""
    lines = []
    for model, way in product(MODELS, (IN_VIEW, *CURVES)):
        if rows := cells.get((model, LOCKERS, way)):
            failed = "does not enter" if len(rows) >= ENTRY_WORLDS else "too few worlds"
            verdict = "" if way != IN_VIEW else "enters" if enters(rows) else failed
            own = interval(mean_score(rows))
            others = (cells.get((script, LOCKERS, way), []) for script in SCRIPTS)
            scripts = (interval(mean_score(each)) if each else "" for each in others)
            lines.append([model, way, f"{len(rows)}", own, *scripts, _right(rows), verdict])
    return markdown_table(("model", "way", "worlds", "score", *SCRIPTS, "right where in view", "verdict"), lines)


def knee(cells: Cells, player: str, bound: str) -> str:
    """The least cap or history from which on a player reaches nine tenths of its score with all in view."""
    best, found = mean_score(cells[player, LOCKERS, IN_VIEW]).mean, "none"
    for way in reversed([way for way in CURVES if way.startswith(bound) and (player, LOCKERS, way) in cells]):
        if mean_score(cells[player, LOCKERS, way]).mean < ENTRY * best:
            break
        found = way.removeprefix(bound).strip()
    return found


def knees_table(cells: Cells) -> str:
    """For each model with curves, its knee beside that of `reader`."""
    models = [model for model in MODELS if any((model, LOCKERS, way) in cells for way in CURVES)]
    lines = [
        [model, bound, knee(cells, model, bound), knee(cells, "reader", bound)]
        for model, bound in product(models, ("cap", "history"))
    ]
    return markdown_table(("model", "bound", "its knee", "reader's"), lines)


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells = cells_of(rows)
    ways, made = {way for *_, way in cells}, {"entry-formats": formats_table(cells)}
    made |= {"entry": entry_table(cells)} if IN_VIEW in ways else {}
    return made | ({"entry-knees": knees_table(cells)} if ways & set(CURVES) else {})


def _without_folder(row: Row) -> Row:
    """The row with the name of a model's file, whose folder says nothing; its digest is under `engine`."""
    options = row.get("player_options", {})
    named = {"model": Path(options["model"]).name} if "model" in options else {}
    return {**row, "player_options": options | named}


EXPERIMENT = Experiment("entry", tables)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/entry")
    for model in ("gemma", "qwen"):
        parser.add_argument(f"--{model}", help="its file, which is played by its path")
    parser.add_argument("--enter", metavar="FORMAT", help="ask whether Qwen enters, in this format")
    asked = parser.parse_args()
    files = {UNTAUGHT: UNTAUGHT, TAUGHT: TAUGHT, GEMMA: asked.gemma, QWEN: asked.qwen}
    if asked.publish:
        write_records(asked.out, HERE / EXPERIMENT.name / "records.tar.xz", MODELS)
    elif asked.enter:
        play_entry(asked.out, QWEN, asked.qwen, asked.enter)
    else:
        play_formats(asked.out, {model: file for model, file in files.items() if file})
    EXPERIMENT.conclude(map(_without_folder, rows_of(asked.out)), publishes=asked.publish)


if __name__ == "__main__":
    main()
