"""The curves of the arena: every strategy under every cap, at four games, played by rules and by learned models.

    python experiments/arena_curves.py                         # plays them; continues where it stopped
    python experiments/arena_curves.py --game MessengerL3-v0   # one of the games alone; repeatable
    python experiments/arena_curves.py --learned runs/learned  # with the models of experiments/learned.py, too

Rows are those of runs, each with the calls of memory tools and with what the episode costs under three caches.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from page_tables import (
    TOGETHER,
    Experiment,
    Line,
    arguments,
    compared_lines,
    complete,
    interval,
    is_playable,
    markdown_table,
    priced,
    records_of,
    score_or,
)

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.names import way_name
from smartplay_tools.evaluation.costs.tariffs import tariffs_of
from smartplay_tools.evaluation.runs.players import PlayerConfig
from smartplay_tools.games.seeds import trial_seed
from smartplay_tools.records import Record
from smartplay_tools.records.rows import Row, row_of
from smartplay_tools.types import MEMORY_TOOL, NOTES_TOOL, PAGES_TOOL, RECALL_TOOL, STRATEGIES

if TYPE_CHECKING:
    from learned_lab import Lab

CONTROL = "random"
SEED = 815
"""Of the runs: their worlds are in no other table."""
TRIALS = {"MessengerL3-v0": 20, "CrafterFirst200-v0": 12}
"""Episodes of a cell, where they are not 32."""
CACHES = ("none", "openai-5-5", "anthropic-512")
"""The rules of caches under which an episode is priced: without a cache, one by itself, and one that is marked."""
ASKED = (RECALL_TOOL, PAGES_TOOL, MEMORY_TOOL, NOTES_TOOL)
"""The tools of memory."""
CRAFTER = sp.register(replace(sp.GAMES["Crafter-v0"], id="CrafterFirst200-v0", rollout=200))
"""The first 200 steps of Crafter. The limit is on steps, since one on calls would charge those of memory tools."""


@dataclass(frozen=True)
class Stage:
    """A game of the curves."""

    game: str
    caps: Sequence[int]
    ways: Sequence[Mapping[str, Any]]
    """The strategies, as fields of a budget; the first is what the others are compared with."""

    def budgets(self) -> Iterator[sp.Budget]:
        """Yield every strategy under every cap that holds its head and its reserve."""
        for cap in self.caps:
            for way in self.ways:
                budget = sp.Budget(history=None, prompt_tokens=cap, **way)
                if is_playable(self.game, budget, CONTROL):
                    yield budget


def _ways(notes: int, summary: int, recall: int, memory: int) -> list[dict[str, Any]]:
    return [
        {},
        {"slack": 0.5},
        {"first_turns": 3},
        {"notes_tokens": notes},
        {"summary_tokens": summary, "slack": 0.5},
        {"recall_tokens": recall},
        {"memory_tokens": memory},
    ]


STAGES = {
    stage.game: stage
    for stage in (
        Stage("BanditTwoArmedHighLowFixed-v0", (700, 900, 1200), _ways(200, 100, 150, 100)),
        Stage("RockPaperScissorBasic-v0", (700, 900, 1200), _ways(200, 100, 150, 100)),
        Stage("MessengerL3-v0", (700, 900, 1200), _ways(200, 100, 150, 200)),
        Stage(CRAFTER.id, (800, 1500, 3000), [*_ways(600, 500, 250, 600), {"beyond_result": "offload"}]),
    )
}
SUBJECT = PlayerConfig(name="rule-notes", options={"words": False})
"""The scripted player, told to say nothing."""
LEARNED_GAME = "RockPaperScissorBasic-v0"
"""The game of the models of `experiments/learned.py`."""
LEARNED = ("full-0", "small-1")
"""Those that play."""


def play(stage: Stage, out: Path, **options: Any) -> Iterator[Row]:
    """Play a game, and yield its rows: full context and the control once, and every strategy under every cap."""
    full = sp.Budget(history=None)
    whole = complete([stage.game], [SUBJECT, CONTROL], budgets=full, out=out / "whole", **options)
    limited = complete([stage.game], [SUBJECT], budgets=list(stage.budgets()), out=out / "capped", **options)
    for run in (whole, limited):
        yield from described(run.rows, records_of(run))


def described(rows: Iterable[Row], records: Mapping[str, Path]) -> Iterator[Row]:
    """Yield rows with what only their records say: the calls of memory tools, and the cost under each cache."""
    for row in priced(rows, records, tariffs_of(CACHES)):
        called = [event["name"] for event in Record.read(records[row["key"]]).calls]
        yield {**row, "memory_calls": sum(map(called.count, ASKED))}


def play_learned(stage: Stage, lab: Lab, name: str, out: Path, *, trials: int, seed: int) -> Iterator[Row]:
    """Play a game by a learned model, the episodes of a cell side by side, and yield its rows."""
    import tiny_agent  # type: ignore[import-not-found]  # from examples/, which `learned_lab` puts on the path

    for number, budget in enumerate([sp.Budget(history=None), *stage.budgets()]):
        records = [out / name / f"{number}-{trial}.jsonl" for trial in range(trials)]
        records[0].parent.mkdir(parents=True, exist_ok=True)
        if not all(path.exists() and Record.head(path).is_complete for path in records):
            for path in records:
                path.unlink(missing_ok=True)
            episodes = [
                sp.Episode(stage.game, seed=trial_seed(seed, stage.game, trial), budget=budget, transcript=path)
                for trial, path in enumerate(records)
            ]
            tiny_agent.play(lab.model(name), lab.tokenizer(), episodes, name=name)
        rows = [row_of(Record.read(path), trial) for trial, path in enumerate(records)]
        yield from described(rows, {row["key"]: path for row, path in zip(rows, records, strict=True)})


def curves_table(rows: Sequence[Row]) -> str:
    """Every strategy beside dropping under the same cap, in Markdown; intervals of differences hold together.

    Costs are in percent of those of dropping under the middle cap, one for each cache. What is decided under no cap is
    named below the table.
    """
    lines = compared_lines(rows, (*STRATEGIES, "slack"), without=[CONTROL])
    dropping = {_place(line): _costs(line) for line in lines if line.compared.is_reference}
    whole = {_place(line)[:2]: interval(line.compared.means["score"]) for line in lines if _cap(line) is None}
    table: dict[tuple[str, str, str], dict[int | None, Line]] = {}
    for line in lines:
        if _cap(line) is not None:
            table.setdefault((*_place(line)[:2], way_name(line.compared.cell)), {})[_cap(line)] = line
    decided = {key for key, cells in table.items() if any(map(_is_decided, cells.values()))}
    shown: list[list[str]] = []
    undecided: dict[str, list[str]] = {}
    for (game, player, way), cells in table.items():
        if (game, player, way) not in decided and way != "dropping":
            undecided.setdefault(f"`{player}` at `{game}`", []).append(way)
        if (game, player, way) not in decided | {(*key[:2], "dropping") for key in decided}:
            continue
        caps = STAGES[game].caps
        effects = [score_or(TOGETHER[1])(cells[cap]) if cap in cells else "" for cap in caps]
        middle = cells.get(caps[1])
        cost = "" if middle is None else _dearer(_costs(middle), dropping[_place(middle)])
        name = f"{way} (full context {whole[game, player]})" if way == "dropping" else way
        shown.append([f"`{game}`", player, name, *effects, cost])
    headings = ["game", "player", "strategy", "smallest cap", "middle cap", "largest cap", "/".join(CACHES)]
    none = (f"- {where}: {'; '.join(ways)}" for where, ways in undecided.items())
    return "\n".join([markdown_table(headings, shown), "", "Undecided under every cap:", "", *none])


def _is_decided(line: Line) -> bool:
    together = line.compared.together
    return together is not None and not (together.low or 0) <= 0 <= (together.high or 0)


def _cap(line: Line) -> int | None:
    cap: int | None = line.compared.cell.budget["prompt_tokens"]
    return cap


def _place(line: Line) -> tuple[str, str, int | None]:
    return line.compared.cell.game, line.compared.cell.player, _cap(line)


def _costs(line: Line) -> list[float]:
    return [fmean(row["costs"][at] for row in line.rows) for at in range(len(CACHES))]


def _dearer(costs: Sequence[float], than: Sequence[float]) -> str:
    return "/".join(f"{100 * own / other - 100:+.0f}" for own, other in zip(costs, than, strict=True))


EXPERIMENT = Experiment("arena-curves", lambda rows: {"arena-curves": curves_table(rows)})


def main() -> None:
    """Play, and print or publish the tables."""
    parser = arguments(__doc__, "runs/curves")
    parser.add_argument("--game", action="append", choices=[*STAGES], help="play this game alone; repeatable")
    parser.add_argument("--learned", type=Path, help="the folder in which experiments/learned.py keeps its models")
    asked = parser.parse_args()
    EXPERIMENT.conclude(_played(asked.game or STAGES, asked.out, asked.learned), publishes=asked.publish)


def _played(games: Iterable[str], out: Path, models: Path | None) -> Iterator[Row]:
    for game in games:
        options = {"trials": TRIALS.get(game, 32), "seed": SEED}
        yield from play(STAGES[game], out / game, executor="inline", **options)
        if models is not None and game == LEARNED_GAME:
            from learned_lab import Lab

            for name in LEARNED:
                yield from play_learned(STAGES[game], Lab(models, game), name, out / "learned", **options)


if __name__ == "__main__":
    main()
