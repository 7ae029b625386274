"""The curves of the arena: every strategy under every cap, at four games, played by rules and by learned models.

    python experiments/arena_curves.py                         # plays them; continues where it stopped
    python experiments/arena_curves.py --game MessengerL3-v0   # one of the games alone; repeatable
    python experiments/arena_curves.py --learned runs/learned  # with the models of experiments/learned.py, too

Rows are those of runs, each with the calls of memory tools and with what the episode costs under three caches.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from page_tables import (
    EPISODES,
    GAME,
    PLAYER,
    SCORE,
    TOGETHER,
    Column,
    Experiment,
    Line,
    arguments,
    comparison_table,
    complete,
    priced,
    records_of,
)

import smartplay_tools as sp
from smartplay_tools.episode.seeds import trial_seed
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.names import way_name
from smartplay_tools.evaluation.analysis.pairs import tokens
from smartplay_tools.evaluation.costs.tariffs import tariffs_of
from smartplay_tools.evaluation.runs.plan import check_playable, make_cells
from smartplay_tools.evaluation.runs.players import PlayerConfig
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

    def budgets(self, further: Iterable[str] = ()) -> Iterator[sp.Budget]:
        """Yield every strategy under every cap that holds its head and its reserve, custom ones included."""
        for cap in self.caps:
            for way in (*self.ways, *({"strategy": name} for name in further)):
                budget = sp.Budget(history=None, prompt_tokens=cap, **way)
                try:
                    check_playable(*make_cells([self.game], [CONTROL], [budget]))
                except InvalidArgumentError:
                    continue
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


def play(
    stage: Stage, players: Sequence[PlayerConfig], custom: Sequence[str], out: Path, **options: Any
) -> Iterator[Row]:
    """Play a game, and yield its rows: full context and the control once, and every strategy under every cap."""
    full = sp.Budget(history=None)
    whole = complete([stage.game], [*players, PlayerConfig(name=CONTROL)], budgets=full, out=out / "whole", **options)
    limited = complete([stage.game], players, budgets=list(stage.budgets(custom)), out=out / "capped", **options)
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
    """Every strategy beside dropping under the same cap, in Markdown; intervals of differences hold together."""
    costs = ((cache, partial(_cost, at)) for at, cache in enumerate(CACHES))
    less: Column = (
        TOGETHER[0],
        lambda line: "" if line.compared.cell.budget["prompt_tokens"] is None else TOGETHER[1](line),
    )
    columns = [GAME, PLAYER, ("cap: strategy", _way), EPISODES, SCORE, less, *MEANS, *costs]
    return comparison_table(rows, (*STRATEGIES, "slack"), columns, without=[CONTROL])


def _way(line: Line) -> str:
    cap = line.compared.cell.budget["prompt_tokens"]
    return "full context" if cap is None else f"{cap:,}: {way_name(line.compared.cell)}"


def _cost(at: int, line: Line) -> str:
    return line.mean(lambda row: row["costs"][at])


MEANS: tuple[Column, ...] = (
    ("tokens", lambda line: line.mean(tokens)),
    ("largest prompt", lambda line: f"{max(row['peak_prompt_tokens'] for row in line.rows):,}"),
    ("calls of memory", lambda line: line.mean(lambda row: row["memory_calls"], 1)),
    ("ended by the cap", lambda line: str(sum(row["end_reason"] == "prompt_tokens" for row in line.rows))),
)


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
        yield from play(STAGES[game], [SUBJECT], (), out / game, executor="inline", **options)
        if models is not None and game == LEARNED_GAME:
            from learned_lab import Lab

            for name in LEARNED:
                yield from play_learned(STAGES[game], Lab(models, game), name, out / "learned", **options)


if __name__ == "__main__":
    main()
