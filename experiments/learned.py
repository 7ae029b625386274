"""What is context worth to a model that was trained for it? The experiment of `docs/train-a-tiny-agent.md`.

    pip install 'smartplay-tools[train,evaluation]'
    python experiments/learned.py play              # trains and plays, and continues where it stopped; takes hours
    python experiments/learned.py table --publish   # the tables and the figure, from the published rows

Tiny transformers (`examples/tiny_agent.py`) learn to reply as a teacher did, each from windows of one kind, and play
worlds that neither the teacher nor they have played, under caps and strategies that they were trained for and under
others. Every episode is one line of `episodes.csv`. `play` records the first episode of each cell; the records of six
cells are published beside the rows.
"""

from __future__ import annotations

import argparse
import csv
import random
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

import smartplay_tools as sp
from smartplay_tools.evaluation import PlayerConfig
from smartplay_tools.evaluation.analysis import MEASURES, MeanEstimate, mean_estimate
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, panels, save_figure
from smartplay_tools.evaluation.analysis.intervals import mean_estimates
from smartplay_tools.evaluation.analysis.pairs import difference_sample, pairs
from smartplay_tools.evaluation.analysis.windows import jointly
from smartplay_tools.exports import export
from smartplay_tools.records.manifest import trial_seed

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from transformers import LlamaForCausalLM, PreTrainedTokenizerFast

GAME = "RockPaperScissorBasic-v0"
CAPS = (600, 800, 1_200, None)
SMALL = 700
EPISODES = 240
"""Episodes of the teacher for each kind of window."""
TOKENS = 3_000_000
"""Tokens that a model reads in training, in its own tokenizer, whatever its windows are."""
WORLDS = 40
PLAY_SEED, TEACH_SEED, REWARD_SEED = 0, 1, 2
"""The worlds of play, of the teacher's records and of the training by reward."""
PUBLISHED = Path(__file__).parent / "learned"
PAGE = Path(__file__).parents[1] / "docs" / "train-a-tiny-agent.md"

WAYS: Mapping[str, Mapping[str, Any]] = {
    "drop": {},
    "notes": {"notes_tokens": 60},
    "summary": {"summary_tokens": 60, "slack": 0.5},
}
"""What happens to what no longer fits, as fields of a budget."""


@dataclass(frozen=True)
class Regime:
    """What a model is trained on: the windows of a teacher."""

    budgets: Sequence[sp.Budget]
    teacher: PlayerConfig


def _budget(cap: int | None, way: str = "drop") -> sp.Budget:
    return sp.Budget(prompt_tokens=cap, **WAYS[way])


RULE = PlayerConfig(name="rule")
REMEMBERING = PlayerConfig(name="rule-notes", options={"words": False})
REGIMES: Mapping[str, Regime] = {
    "small": Regime([_budget(SMALL)], RULE),
    "all": Regime([_budget(cap) for cap in CAPS], RULE),
    "full": Regime([_budget(None)], RULE),
    "notes": Regime([_budget(SMALL, "notes")], REMEMBERING),
    "summary": Regime([_budget(SMALL, "summary")], REMEMBERING),
}


@dataclass(frozen=True)
class Cell:
    """Who plays, and under what."""

    player: str
    """A scripted player; or a model: its regime and the seed of its training, such as `small-0`.

    `small-0-half` read half as many tokens in training, `small-0-rewarded` was trained on by reward.
    """
    cap: int | None
    way: str = "drop"
    manual: str = "tool"


@dataclass
class Played:
    """The rows of all cells, as far as they are played."""

    path: Path
    rows: dict[Cell, list[dict[str, Any]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.path.exists():
            with self.path.open(encoding="utf-8", newline="") as file:
                for row in csv.DictReader(file):
                    self._keep(row)

    def _keep(self, row: Mapping[str, Any]) -> None:
        cap = int(row["cap"]) if row["cap"] else None
        numbers = {name: int(row[name]) for name in NUMBERS}
        kept = {"game": GAME, "score": float(row["score"]), "end_reason": row["end_reason"], **numbers}
        self.rows.setdefault(Cell(row["player"], cap, row["way"], row["manual"]), []).append(kept)

    def add(self, cell: Cell, episodes: Sequence[sp.Episode]) -> None:
        """Append the rows of a cell to the file."""
        is_new = not self.path.exists()
        with self.path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if is_new:
                writer.writerow(COLUMNS)
            for trial, episode in enumerate(episodes):
                row = _row(cell, trial, episode)
                writer.writerow(row[name] for name in COLUMNS)
                self._keep(row)


NUMBERS = ("trial", "seed", "steps", "turns", "illegal_actions", "malformed_calls", "idle_replies", "refused_notes")
COLUMNS = ("player", "cap", "way", "manual", *NUMBERS, "score", "end_reason", "prompt_tokens", "reply_tokens")


def _row(cell: Cell, trial: int, episode: sp.Episode) -> dict[str, Any]:
    result = episode.result
    assert result is not None
    facts = {name: getattr(result, name) for name in (*NUMBERS[1:], "score", "end_reason")}
    tokens = {"prompt_tokens": result.tokens.prompt, "reply_tokens": result.tokens.reply}
    about = {"player": cell.player, "cap": cell.cap or "", "way": cell.way, "manual": cell.manual, "trial": trial}
    return {**about, **facts, **tokens}


def cells() -> Iterator[Cell]:
    """All cells, in the order in which they are played: what matters most comes first."""
    for player in ("rule", "random", "all-0", "small-1", "full-0", "small-0-half", "all-0-half"):
        yield from (Cell(player, cap) for cap in CAPS)
    for player in ("rule-notes", "small-1", "small-0-half", "notes-0", "summary-0"):
        yield from (Cell(player, SMALL, way) for way in WAYS)
    for player in ("rule", "small-1", "all-0"):
        yield from (Cell(player, cap, manual="none") for cap in (600, None))
    for player in ("small-0", "all-1", "full-1", "small-0-rewarded"):
        yield from (Cell(player, cap) for cap in CAPS)


def episodes_of(cell: Cell, folder: Path | None) -> list[sp.Episode]:
    """The episodes of a cell; the first is recorded."""
    names = (cell.player, str(cell.cap or "none"), cell.way, "manual-none" if cell.manual == "none" else "")
    record = None if folder is None else folder / f"{'.'.join(filter(None, names))}.jsonl"
    if record is not None:
        record.unlink(missing_ok=True)
    return [
        sp.Episode(
            GAME,
            seed=trial_seed(PLAY_SEED, GAME, trial),
            budget=_budget(cell.cap, cell.way),
            manual=cell.manual,
            transcript=None if trial else record,
        )
        for trial in range(WORLDS)
    ]


class Lab:
    """Makes models and keeps them in a folder."""

    def __init__(self, out: Path) -> None:
        self._out = out

    def rows(self, regime: str) -> list[dict[str, Any]]:
        """The rows of a regime's records, which are played the first time; their order is drawn."""
        import tiny_agent

        data = self._out / "data" / regime
        if not data.exists():
            asked = REGIMES[regime]
            run = self._out / "teacher" / regime
            trials = EPISODES // len(asked.budgets)
            sp.evaluate(
                [GAME],
                [asked.teacher],
                budgets=asked.budgets,
                trials=trials,
                seed=TEACH_SEED,
                out=run,
                executor="inline",
            )
            made = export(run, data, "sft-chains", summaries=True)
            print(regime, made.counts, flush=True)
        rows = tiny_agent.read_rows(data)
        random.Random(0).shuffle(rows)
        return rows

    def tokenizer(self) -> PreTrainedTokenizerFast:
        """The one tokenizer of all models, made from some rows of every regime."""
        import tiny_agent
        from transformers import PreTrainedTokenizerFast

        folder = self._out / "tokenizer"
        if not folder.exists():
            rows = [row for regime in REGIMES for row in self.rows(regime)[:400]]
            tiny_agent.make_tokenizer(rows).save_pretrained(folder)
        made: PreTrainedTokenizerFast = PreTrainedTokenizerFast.from_pretrained(folder)
        return made

    def model(self, name: str) -> LlamaForCausalLM:
        """The model of a name, which is trained the first time."""
        import tiny_agent
        from transformers import LlamaForCausalLM

        folder = self._out / "models" / name
        if not folder.exists():
            if name.endswith("-rewarded"):
                model = self.model(name.removesuffix("-rewarded"))
                self._reward(model)
            else:
                regime, number, *half = name.split("-")
                tokenizer = self.tokenizer()
                samples = [tiny_agent.encode(tokenizer, row) for row in self.rows(regime)]
                model = tiny_agent.new_model(tokenizer, seed=int(number))
                tokens = TOKENS // 2 if half else TOKENS
                loss = tiny_agent.train(model, samples, tokens, seed=int(number))
                print(f"{name}: {len(samples)} rows, loss {loss:.4f}", flush=True)
            model.save_pretrained(folder)
        made: LlamaForCausalLM = LlamaForCausalLM.from_pretrained(folder)
        return made

    def _reward(self, model: LlamaForCausalLM, updates: int = 30) -> None:
        import tiny_agent

        def world(number: int) -> list[sp.Episode]:
            seed = trial_seed(REWARD_SEED, GAME, number)
            return [sp.Episode(GAME, seed=seed, budget=_budget(CAPS[0])) for _ in range(6)]

        groups = ([world(4 * update + at) for at in range(4)] for update in range(updates))
        for update, score in enumerate(tiny_agent.reinforce(model, self.tokenizer(), groups)):
            print(f"update {update}: {score:.2f}", flush=True)


def play(out: Path) -> None:
    """Train and play what is missing."""
    import tiny_agent
    import torch

    torch.set_num_threads(1)
    (out / "records").mkdir(parents=True, exist_ok=True)
    lab, played = Lab(out), Played(out / "episodes.csv")
    for cell in cells():
        if cell in played.rows:
            continue
        episodes = episodes_of(cell, out / "records")
        if cell.player in ("rule", "random", "rule-notes"):
            options = {"words": False} if cell.player == "rule-notes" else {}
            for trial, episode in enumerate(episodes):
                sp.play(episode, sp.get_player(cell.player, seed=trial, **options))
        else:
            tiny_agent.play(lab.model(cell.player), lab.tokenizer(), episodes, name=cell.player)
        played.add(cell, episodes)
        scores = [row["score"] for row in played.rows[cell]]
        print(cell, f"{sum(scores) / len(scores):.2f}, median {median(scores):g}", flush=True)


def tables(played: Played) -> dict[str, str]:
    """The tables of the page, by their names in it, of the cells that were played."""
    return {
        "learned-scores": _scores(played, list(played.rows)),
        "learned-differences": _differences(played, _comparisons(played)),
    }


def _name(cell: Cell) -> str:
    cap = "no cap" if cell.cap is None else f"{cell.cap:,}"
    words = (cell.player, cap, "" if cell.way == "drop" else cell.way, "no manual" if cell.manual == "none" else "")
    return ", ".join(filter(None, words))


def _scores(played: Played, shown: Sequence[Cell]) -> str:
    """Mean, interval, median and failures of every cell; a failure scores no more than `random` did on average."""
    floor = fmean(row["score"] for row in played.rows[Cell("random", None)])
    lines = ["| player, cap | worlds | mean [95 %] | median | failures | illegal or malformed |", f"|{' --- |' * 6}"]
    for cell in shown:
        rows = played.rows[cell]
        scores = [row["score"] for row in rows]
        estimate = mean_estimate(scores)
        failures = sum(score <= floor for score in scores)
        wrong = sum(row["illegal_actions"] + row["malformed_calls"] + row["idle_replies"] for row in rows)
        steps = sum(row["turns"] for row in rows)
        figures = (len(rows), _interval(estimate, "-"), f"{median(scores):g}", failures, f"{wrong / steps:.1%}")
        lines.append(f"| {_name(cell)} | {' | '.join(map(str, figures))} |")
    return "\n".join(lines)


def _comparisons(played: Played) -> list[tuple[Cell, Cell]]:
    """Which cells are compared: with no cap, the teacher, the model of full context, no strategy, the manual."""
    compared: list[tuple[Cell, Cell]] = []
    for cell in played.rows:
        others = [replace(cell, way="drop"), replace(cell, manual="tool")]
        if cell.way == "drop" and cell.manual == "tool":
            others += [replace(cell, cap=None)]
            others += [replace(cell, player=name) for name in ("rule", "full-0") if "-" in cell.player]
        if cell.player != "random":
            compared += [(cell, other) for other in others if other != cell and other in played.rows]
    return compared


def _differences(played: Played, compared: Sequence[tuple[Cell, Cell]]) -> str:
    """Paired differences, whose intervals hold together in 95 of 100 such tables."""
    paired = [pairs(played.rows[cell], played.rows[other]) for cell, other in compared]
    samples = [difference_sample(each, MEASURES["score"]) for each in paired]
    estimates = mean_estimates(samples, jointly(len(samples)))
    lines = ["| this | less this | pairs | difference [95 %, all together] |", f"|{' --- |' * 4}"]
    for (cell, other), estimate in zip(compared, estimates, strict=True):
        lines.append(f"| {_name(cell)} | {_name(other)} | {estimate.episodes} | {_interval(estimate, '+')} |")
    return "\n".join(lines)


def _interval(estimate: MeanEstimate, sign: str) -> str:
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:{sign}.1f}"
    return f"{estimate.mean:{sign}.1f} [{estimate.low:{sign}.1f}, {estimate.high:{sign}.1f}]"


@figure
def curves(played: Played) -> Figure:
    """Draw mean score against the cap, a line for each player; no cap stands at the right."""
    drawn, [axes] = panels(1)
    players = [cell.player for cell in played.rows if cell == Cell(cell.player, None)]
    for number, player in enumerate(players):
        look = Series.number(number)
        means = [fmean(row["score"] for row in played.rows[Cell(player, cap)]) for cap in CAPS]
        axes.plot(range(len(CAPS)), means, color=look.colour, marker=look.marker, linestyle=look.line, label=player)
    axes.set_xticks(range(len(CAPS)), ["none" if cap is None else f"{cap:,}" for cap in CAPS])
    axes.set_xlabel("cap on prompts, in budget tokens")
    axes.set_ylabel("mean score, of 50")
    axes.legend()
    return drawn


def publish(written: Mapping[str, str], played: Played) -> None:
    """Put the tables between their marks in the page, and draw the figure."""
    text = PAGE.read_text(encoding="utf-8")
    for name, table in written.items():
        marked = re.compile(rf"(<!-- table: {name} -->\n)(.*?)(<!-- end -->)", flags=re.DOTALL)
        text = marked.sub(lambda match, table=table: f"{match[1]}\n{table}\n\n{match[3]}", text)  # type: ignore[misc]
    PAGE.write_text(text, encoding="utf-8")
    save_figure(curves(played), PAGE.parent / "figures" / "learned-curves", formats=["svg"])


def main() -> None:
    """Play, or print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("play", "table"))
    parser.add_argument("--out", type=Path, default=Path("runs/learned"))
    parser.add_argument("--publish", action="store_true", help="put tables and figure into the documentation")
    asked = parser.parse_args()
    if asked.what == "play":
        play(asked.out)
        return
    played = Played(PUBLISHED / "episodes.csv")
    written = tables(played)
    print("\n\n".join(written.values()))
    if asked.publish:
        publish(written, played)


if __name__ == "__main__":
    main()
