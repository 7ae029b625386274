"""Real models under caps and strategies: episodes of models that no script played.

    smartplay-tools model get
    python experiments/models.py --qwen FILE --pilot     # ten worlds, from which the questions were chosen
    python experiments/models.py --qwen FILE             # other worlds; continues where it stopped
    python experiments/models.py --qwen FILE --publish   # both, with three records of every cell
    python experiments/tables.py models                  # the tables of the page, from the published rows

It needs the extras `local`, `popgym`, `evaluation`, `langchain` and `pydantic-ai`. Qwen2.5-Coder-1.5B-Instruct plays as
it was published, with replies drawn at temperature 0.7, because at temperature 0 it repeats a call without end.
SmolLM2-135M plays at temperature 0, as it was published and with the adapter of this package. Two processes play, each
with one thread. What the engine has kept of another episode can decide between two close replies, so rows that are
played again can differ; records hold what was replied.
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

from page_tables import (
    HERE,
    Experiment,
    arguments,
    interval,
    markdown_table,
    mean_of,
    repeat_previous,
    score_of,
    verdict,
)

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.decisions import mde
from smartplay_tools.evaluation.analysis.pairs import paired_difference, reward, score, steps
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.evaluation.run_folder.folder import RunFolder
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.records.rows import Row
from smartplay_tools.types.groups import grouped

SEED, PILOT_SEED = 27_112_026, 11
CALLS = 20
"""An episode ends after as many calls, which bounds what one costs on a processor."""
CAP = 700
"""The smallest cap on prompts, in tokens, under which strategies play."""
ENGINE = ("xllamacpp", "format", "model", "adapter")
"""What a row says of what has answered: a version, a format of calls, and the digests of files."""
MODELS = QWEN, TAUGHT, UNTAUGHT = "qwen2.5-coder-1.5b", "smollm2-135m-player", "smollm2-135m"
HANDS, BANDIT = "RockPaperScissorBasic-v0", "BanditTwoArmedHighLowFixed-v0"
GAMES = {
    HANDS: "Rock Paper Scissors",
    BANDIT: "bandit",
    "MessengerL1-v0": "MESSENGER L1",
    "MessengerL2-v0": "MESSENGER L2",
    repeat_previous(2): "RepeatPrevious, k = 2",
    repeat_previous(8): "RepeatPrevious, k = 8",
    "popgym-CountRecallEasy-v0": "CountRecall",
}
"""The games, and their names in the tables."""
WIDEST, DROPPING, TOLD = "no cap", f"{CAP}", f"{CAP}, budget told"
WAYS: Mapping[str, Mapping[str, Any]] = {
    WIDEST: {},
    "1,000": {"prompt_tokens": 1_000, "slack": 0.5},
    DROPPING: {"slack": 0.5},
    "masking": {"beyond_history": "mask", "history": 4, "slack": 0.5},
    "notes": {"notes_tokens": 60, "slack": 0.5},
    "summary": {"summary_tokens": 60, "slack": 0.5},
    "recall": {"recall_tokens": 100, "slack": 0.5},
    "LangChain, clearing": {"strategy": "langchain-clear"},
    "Pydantic AI, newest": {"strategy": "pydantic-ai-newest"},
    "LangChain, summary": {"strategy": "langchain-summary", "question_tokens": 4 * CAP},
    TOLD: {"slack": 0.5},
}
"""The ways to bound prompts, as fields of a budget; all but the first two are under the smallest cap."""
CAPS = (WIDEST, DROPPING)


@dataclass(frozen=True)
class Stage:
    """A model at some games in some ways, in so many worlds."""

    player: str
    games: Sequence[str]
    ways: Sequence[str]
    worlds: int


ASKED = (*CAPS, TOLD)
"""The ways of the questions, which are played in more worlds."""
SLOW = ("LangChain, summary",)
"""An episode takes five minutes, because every prompt asks for a summary."""
QUICK = tuple(way for way in WAYS if way not in (*ASKED, *SLOW))
FEW = tuple(game for game in GAMES if game not in (HANDS, BANDIT))
PILOT = (Stage(TAUGHT, (HANDS, BANDIT), CAPS, 10), Stage(QWEN, (HANDS,), CAPS, 10))
STAGES = (
    Stage(UNTAUGHT, (HANDS, BANDIT), CAPS, 8),
    Stage(TAUGHT, (BANDIT,), ASKED, 16),
    Stage(TAUGHT, (HANDS,), ASKED, 24),
    Stage(QWEN, (HANDS,), ASKED, 8),
    Stage(QWEN, (HANDS,), QUICK, 4),
    Stage(QWEN, FEW, CAPS, 4),
    Stage(TAUGHT, (HANDS, BANDIT), QUICK, 8),
    Stage(TAUGHT, FEW, CAPS, 5),
    Stage(TAUGHT, (HANDS,), SLOW, 4),
)
"""In the order in which they are played."""


def play(out: Path, stages: Sequence[Stage], seed: int, qwen: str) -> None:
    """Play stages in their order; what was played is not played again."""
    for stage in stages:
        config = _config(stage.player, qwen)
        for game in stage.games:
            for way in stage.ways:
                given: Any = {"trials": stage.worlds, "seed": seed, "executor": "processes", "workers": 2}
                _evaluate(out, config, game, way, **given)


def _evaluate(out: Path, config: PlayerConfig, game: str, way: str, **given: Any) -> None:
    fields = {"prompt_tokens": None if way == WIDEST else CAP, "history": None, "tool_calls": CALLS, **WAYS[way]}
    given |= {"budget_line": "on"} if way == TOLD else {}
    folder, budget = out / _folder(config.name) / game / way, sp.Budget(**fields)
    done = sp.evaluate([game], [config], budgets=budget, out=folder, **given)
    print(f"{folder}: {len(done.rows)} of {done.planned} episodes", flush=True)


def _config(player: str, qwen: str) -> PlayerConfig:
    from smartplay_local import LocalPlayer

    options = {"model": qwen, "temperature": 0.7} if player == QWEN else {"model": player}
    return PlayerConfig(name=player, factory=LocalPlayer, options={**options, "format": "text", "threads": 1})


READING = {HANDS: ("win-stay", "leave-after-two", "last-hand", "count-last-5"), BANDIT: ("win-stay", "leave-after-two")}
"""The baselines of one line that read what a window shows, so that they play under the same caps as the models."""


def fixed_actions(game: str) -> Sequence[str]:
    """Return the baselines that play one action and read nothing, so that no cap changes what they play."""
    return [f"always:{number}" for number in range(1, sp.GAMES[game].count_actions() + 1)]


def play_controls(out: Path) -> None:
    """Play the same worlds with scripts, whose scores the models' are read against."""
    for game in GAMES:
        scripted = "reader" if sp.GAMES[game].memory else "rule"
        worlds = max(8, *(stage.worlds for stage in STAGES if game in stage.games))
        capped = ASKED if game in READING else CAPS
        players: dict[str, Sequence[str]] = dict.fromkeys(("random", *fixed_actions(game)), (WIDEST,))
        players |= dict.fromkeys((*READING.get(game, ()), scripted), capped)
        players |= {f"blind:{out / scripted / game / WIDEST}": (WIDEST,)}
        for name, ways in players.items():
            for way in ways:
                given: Any = {"trials": worlds, "seed": SEED, "executor": "inline"}
                _evaluate(out, PlayerConfig(name=name), game, way, **given)


def _folder(player: str) -> str:
    """The name of a player's folder and of its rows: `always` keeps its action, and `blind` no path."""
    return player if player.startswith("always:") else player.partition(":")[0]


def rows_of(out: Path) -> Iterator[Row]:
    """Yield the rows of everything that was played, with what their tables need."""
    for folder in folders(out):
        worlds, player, _, way = folder.path.relative_to(out).parts
        for row in folder.rows():
            engine = {name: row["versions"].get(name) for name in ENGINE}
            yield {**row, "player": player, "way": way, "worlds": worlds, "engine": engine}


def folders(out: Path) -> Iterator[RunFolder]:
    """Yield the folder of every cell that was played."""
    for folder in sorted(out.glob("*/*/*/*")):
        yield RunFolder(folder)


def write_records(out: Path, path: Path, models: Sequence[str] = MODELS, count: int = 3) -> None:
    """Write the records of the first worlds of every cell of a model into one archive."""
    path.parent.mkdir(exist_ok=True)
    with tarfile.open(path, "w:xz", preset=9) as archive:
        for folder in folders(out):
            is_model = folder.path.parts[-3] in models
            for row in sorted(folder.rows(), key=lambda row: row["trial"])[:count] if is_model else ():
                content = folder.transcript(row["key"]).read_bytes()
                about = tarfile.TarInfo(f"{folder.path.relative_to(out)}/{row['trial']}.jsonl")
                about.size = len(content)
                archive.addfile(about, BytesIO(content))


Cells = Mapping[tuple[str, str, str, str], list[Row]]
"""Rows by worlds, player, game and way."""


def cells_of(rows: Sequence[Row]) -> Cells:
    """Group the published rows."""
    return grouped(rows, lambda row: (row["worlds"], row["player"], row["game"], row["way"]))


def scores_table(cells: Cells) -> str:
    """The mean score of the models in the ways of the questions, with its interval and the number of worlds."""
    lines = []
    for player, game in product(MODELS, GAMES):
        own = [cells.get(("fresh", player, game, way), []) for way in ASKED]
        if any(own):
            lines.append([player, GAMES[game], *map(_score, own)])
    return markdown_table(["player", "game", *ASKED], lines)


def points_table(cells: Cells) -> str:
    """The points that the two games of the questions have paid, which are not their scores."""
    lines = []
    for player, game in product((*MODELS, "rule"), READING):
        own = [cells.get(("fresh", player, game, way), []) for way in ASKED]
        if any(own):
            paid = [f"{mean_of(rows, reward):+.2f}" if rows else "" for rows in own]
            lines.append([player, GAMES[game], *paid])
    return markdown_table(["player", "game", *ASKED], lines)


def baselines_table(cells: Cells) -> str:
    """Every baseline of one line in the worlds of the taught model under the smallest cap, and the model less it."""
    lines = []
    for game in READING:
        own = cells.get(("fresh", TAUGHT, game, DROPPING), [])
        lines.append([GAMES[game], f"**{TAUGHT}**", *_facts(own), "", ""])
        for player in (*baselines(game), "blind", "rule", "random"):
            rows = _under(cells, player, game, DROPPING)
            less = (interval(paired_difference(own, rows, measure), "+") for measure in (score, reward))
            lines.append([GAMES[game], player, *_facts(rows), *less])
    headings = ["game", "player", "score", "points", "steps", "model less it, score [95 %]", "points [95 %]"]
    return markdown_table(headings, lines)


def best_table(cells: Cells) -> str:
    """Every model under the smallest cap beside the baseline of one line that scores most in the same worlds."""
    lines = []
    for player, game in product(MODELS, GAMES):
        if own := cells.get(("fresh", player, game, DROPPING), []):
            worlds = {row["trial"] for row in own}
            known = {each: _under(cells, each, game, DROPPING) for each in baselines(game)}
            known = {each: [row for row in rows if row["trial"] in worlds] for each, rows in known.items()}
            best = max(known, key=lambda each: mean_of(known[each], score))
            named = f"{best} ({mean_of(known[best], score):.2f})"
            less = interval(paired_difference(own, known[best], score), "+")
            lines.append([player, GAMES[game], f"{len(own)}", f"{mean_of(own, score):.2f}", named, less])
    headings = ["player", "game", "worlds", "score", "best baseline", "model less it, score [95 %]"]
    return markdown_table(headings, lines)


def baselines(game: str) -> Sequence[str]:
    """Return the baselines of one line that can play a game."""
    return (*READING.get(game, ()), *fixed_actions(game))


def _under(cells: Cells, player: str, game: str, way: str) -> list[Row]:
    """The rows of a script in a way; one that reads nothing was played without a cap, which is the same."""
    return cells.get(("fresh", player, game, way)) or cells.get(("fresh", player, game, WIDEST), [])


def _facts(rows: Sequence[Row]) -> tuple[str, ...]:
    return f"{mean_of(rows, score):.2f}", f"{mean_of(rows, reward):+.2f}", f"{mean_of(rows, steps):.1f}"


def _score(rows: Sequence[Row]) -> str:
    """The mean score, and the number of worlds."""
    return f"{score_of(rows)} ({len(rows)})" if rows else ""


Question = tuple[str, str, str, str]
"""Of a model at a game: whether it scores otherwise in the first way than in the second."""

QUESTIONS: tuple[Question, ...] = (
    (TAUGHT, HANDS, DROPPING, WIDEST),
    (TAUGHT, BANDIT, DROPPING, WIDEST),
    (TAUGHT, HANDS, TOLD, DROPPING),
    (TAUGHT, BANDIT, TOLD, DROPPING),
    (QWEN, HANDS, DROPPING, WIDEST),
    (QWEN, HANDS, TOLD, DROPPING),
)
"""Written down after the pilot, before the models that they ask about had played the worlds of `SEED`."""


def questions_table(cells: Cells) -> str:
    """Every question with its answer; the intervals hold together."""
    lines, together = [], bonferroni(len(QUESTIONS))
    for player, game, way, other in QUESTIONS:
        rows, reference = (cells.get(("fresh", player, game, each), []) for each in (way, other))
        each = paired_difference(rows, reference, score, together)
        if each is None:
            continue
        shown = f"{mde(each.sd, each.episodes, confidence=together.confidence):.1f}" if each.sd else ""
        names = [player, GAMES[game], way, other, f"{each.episodes}"]
        lines.append([*names, interval(each, "+"), verdict(each), shown])
    difference_heading, shown_heading = "difference [95 %, all together]", "would be seen"
    headings = ["player", "game", "in this way", "than in this", "worlds", difference_heading, "scores", shown_heading]
    return markdown_table(headings, lines)


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """Return the tables of the page by their names."""
    cells = cells_of(rows)
    return {
        "models": scores_table(cells),
        "models-points": points_table(cells),
        "models-baselines": baselines_table(cells),
        "models-best": best_table(cells),
        "models-questions": questions_table(cells),
    }


EXPERIMENT = Experiment("models", tables)


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/models")
    parser.add_argument("--pilot", action="store_true", help="play the worlds from which the questions were chosen")
    parser.add_argument("--qwen", default="", help="the file of Qwen2.5-Coder-1.5B-Instruct in four bits")
    asked = parser.parse_args()
    if not (asked.publish or asked.qwen):
        parser.error("name the file of Qwen2.5-Coder with --qwen")
    if asked.qwen:
        stages, seed = (PILOT, PILOT_SEED) if asked.pilot else (STAGES, SEED)
        play(asked.out / ("pilot" if asked.pilot else "fresh"), stages, seed, asked.qwen)
        play_controls(asked.out / "fresh")
    if asked.publish:
        write_records(asked.out, HERE / EXPERIMENT.name / "records.tar.xz")
    EXPERIMENT.conclude(rows_of(asked.out), publishes=asked.publish)


if __name__ == "__main__":
    main()
