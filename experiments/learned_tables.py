"""The rows of `experiments/learned.py`, and the tables and the figure that are made of them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean, variance
from typing import TYPE_CHECKING, Any

from learned_cells import BANDIT, CAPS, GAME, LINES, SEEDS, SMALL, TEACHERS, WAYS, Cell
from page_tables import HERE, Experiment, in_steps, markdown_table, verdict

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, panels
from smartplay_tools.evaluation.analysis.together import bonferroni
from smartplay_tools.statistics.distributions import t_quantile
from smartplay_tools.statistics.intervals import CONFIDENCE, Bounds, MeanEstimate, mean_estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBERS = ("trial", "seed", "steps", "turns", "illegal_actions", "malformed_calls", "idle_replies", "refused_notes")
ABOUT = ("game", "player", "cap", "way", "manual")
SCORES = Bounds(0, 50)
BOUNDS = SCORES.of_differences
"""What two scores of one world can differ by, at either game."""
COLUMNS = (*ABOUT, *NUMBERS, "score", "end_reason", "prompt_tokens", "reply_tokens")


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
        kept = {"game": row["game"], "score": float(row["score"]), "end_reason": row["end_reason"], **numbers}
        self.rows.setdefault(Cell(row["player"], cap, row["way"], row["manual"], row["game"]), []).append(kept)

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

    def scores(self, cell: Cell) -> list[float]:
        """The score of every world."""
        return [row["score"] for row in self.rows[cell]]

    def early(self, cell: Cell) -> str:
        """A mark of early ends with the steps of an episode, if the cell was played and has any."""
        return in_steps(self.rows.get(cell, []))

    def failures(self, cell: Cell) -> int:
        """In how many worlds the score is at most the mean score of `random`."""
        floor = fmean(self.scores(Cell("random", None, game=cell.game)))
        return sum(score <= floor for score in self.scores(cell))


def _row(cell: Cell, trial: int, episode: sp.Episode) -> dict[str, Any]:
    result = episode.result
    assert result is not None
    facts = {name: getattr(result, name) for name in (*NUMBERS[1:], "score", "end_reason")}
    tokens = {"prompt_tokens": result.tokens.prompt, "reply_tokens": result.tokens.reply}
    about = {**vars(cell), "cap": cell.cap or "", "trial": trial}
    return {**about, **facts, **tokens}


def tables(played: Played) -> dict[str, str]:
    """The tables of the page, by their names in it, of the cells that were played."""
    caps = [("no cap" if cap is None else f"{cap:,}", cap) for cap in CAPS]
    return {
        "learned-scores": _matrix(played, {head: {"cap": cap} for head, cap in caps}),
        "learned-strategies": _matrix(played, {way: {"cap": SMALL, "way": way} for way in WAYS}),
        "learned-bandit": _matrix(played, {head: {"cap": cap, "game": BANDIT} for head, cap in caps}),
        "learned-trainings": _trainings(played, _of_trainings()),
        "learned-lines": _trainings(played, _of_lines()),
        "learned-manuals": _trainings(played, _of_manuals()),
    }


def _matrix(played: Played, columns: Mapping[str, Mapping[str, Any]]) -> str:
    """A row for every player that has played all columns: mean, interval and number of failures."""
    every = [cell.player for cell in played.rows]
    players = [
        player
        for player in dict.fromkeys(every)
        if all(Cell(player, **column) in played.rows for column in columns.values())
    ]
    lines = []
    for player in sorted(players, key=_order):
        cells = [Cell(player, **column) for column in columns.values()]
        means = (_interval(mean_estimate(played.scores(cell), SCORES), "-") for cell in cells)
        shown = (
            f"{mean}{played.early(cell)}, {played.failures(cell)}" for mean, cell in zip(means, cells, strict=True)
        )
        lines.append((player, *shown))
    return markdown_table(("played with", *columns), lines)


def _order(player: str) -> tuple[bool, bool, str]:
    """Scripted players stand first, then models, those of a regime together."""
    return bool(re.search(r"-\d", player)), player.endswith("-rewarded"), player


Compared = tuple[Cell, Cell]
"""This, and what it is less; `-{}` in a model's name stands for the seed of its training."""


def _of_lines() -> list[Compared]:
    """Every kind of training beside the baseline of one line, in the narrowest window and in the widest."""
    kinds = [(GAME, name) for name in ("full-{}", "small-{}", "all-{}", "full-{}-rewarded")]
    kinds += [(BANDIT, "full-{}"), (BANDIT, "small-{}")]
    ends = CAPS[0], CAPS[-1]
    return [(Cell(name, cap, game=game), Cell(LINES[game], cap, game=game)) for game, name in kinds for cap in ends]


def _of_trainings() -> list[Compared]:
    """What is compared of every training of a kind."""
    small, full = CAPS[0], None
    wanted = [(Cell("full-{}", cap), Cell("full-{}", full)) for cap in CAPS[1:-1]]
    for game in (GAME, BANDIT):
        for player in ("full-{}", "small-{}", "all-{}"):
            wanted += [(Cell(player, small, game=game), Cell(player, full, game=game))]
        for player, other in (("small-{}", "full-{}"), ("all-{}", "full-{}")):
            wanted += [(Cell(player, cap, game=game), Cell(other, cap, game=game)) for cap in (small, full)]
    for player in ("full-{}", "small-{}"):
        wanted += [(Cell(f"{player}-rewarded", cap), Cell(player, cap)) for cap in (small, full)]
    return wanted


def _of_manuals() -> list[Compared]:
    """What another manual, or none, changes."""
    return [
        (Cell(player, cap, manual=manual), Cell(player, cap))
        for player in ("rule", "full-{}", "small-{}")
        for manual in ("none", "swapped")
        for cap in (CAPS[0], None)
    ]


def _trainings(played: Played, wanted: Iterable[Compared]) -> str:
    """Paired differences of every training of a kind, which hold together, and what they say of a further training."""
    rows: list[tuple[Compared, list[list[float] | None], list[str]]] = []
    for pair in wanted:
        kinds = [_of_seed(pair, seed) for seed in (SEEDS if "{}" in pair[0].player else [0])]
        if any(each := [_paired(played, kind) for kind in kinds]):
            rows.append((pair, each, ["".join(map(played.early, kind)) for kind in kinds]))
    together = bonferroni(sum(values is not None for _, each, _ in rows for values in each))
    lines = []
    for (cell, other), each, early in rows:
        shown = [
            "not run" if values is None else _decided(mean_estimate(values, BOUNDS, together)) + mark
            for values, mark in zip(each, early, strict=True)
        ]
        shown += ["" for _ in SEEDS[len(each) :]]
        any_seed = _any_seed(each)
        lines.append((_name(cell), _name(other), *shown, "" if any_seed is None else _interval(any_seed, "+")))
    return markdown_table(("this", "less this", *(f"seed {seed}" for seed in SEEDS), "any seed"), lines)


def _decided(estimate: MeanEstimate) -> str:
    """A difference, in bold where its interval does not contain 0."""
    mark = "" if (estimate.low or 0) <= 0 <= (estimate.high or 0) else "**"
    return f"{mark}{estimate.mean:+.1f}{mark}"


def _of_seed(pair: Compared, seed: int) -> Compared:
    cell, other = (replace(each, player=each.player.format(seed)) for each in pair)
    return cell, other


def _paired(played: Played, pair: Compared) -> list[float] | None:
    """The difference in every world; None if one of the two was not played."""
    if not all(cell in played.rows for cell in pair):
        return None
    return [this - other for this, other in zip(*map(played.scores, pair), strict=True)]


def _any_seed(each: Sequence[Sequence[float] | None]) -> MeanEstimate | None:
    """The mean over trainings, and an interval for further trainings and worlds alike.

    Both were drawn: the variances of the trainings' means and of the worlds' means are added, each divided by its
    number, which counts what is left of either twice and so is not too narrow. Student's t has the degrees of freedom
    of the trainings, the fewer of the two.
    """
    seeds = [values for values in each if values is not None]
    if len(seeds) < len(SEEDS):
        return None
    of_seeds, of_worlds = [fmean(values) for values in seeds], [fmean(values) for values in zip(*seeds, strict=True)]
    spread = math.sqrt(variance(of_seeds) / len(of_seeds) + variance(of_worlds) / len(of_worlds))
    half = t_quantile((1 - CONFIDENCE) / 2, len(of_seeds) - 1) * spread
    mean = fmean(of_seeds)
    return MeanEstimate(mean, mean - half, mean + half, len(of_seeds))


def _name(cell: Cell) -> str:
    cap = "no cap" if cell.cap is None else f"{cell.cap:,}"
    game = "bandit" if cell.game == BANDIT else ""
    way = "" if cell.way == "drop" else cell.way
    manual = {"tool": "", "none": "no manual", "swapped": "swapped manual"}[cell.manual]
    return ", ".join(filter(None, (cell.player.replace("-{}", ""), game, cap, way, manual)))


def _interval(estimate: MeanEstimate, sign: str) -> str:
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:{sign}.1f}"
    return f"{estimate.mean:{sign}.1f} [{estimate.low:{sign}.1f}, {estimate.high:{sign}.1f}]"


@figure
def curves(played: Played) -> Figure:
    """Draw mean score against the cap, no cap at the right: a line for a regime, a thin one for each of its models."""
    drawn, [axes] = panels(1)
    groups: dict[str, list[str]] = {}
    for player in sorted((cell.player for cell in played.rows if cell == Cell(cell.player, None)), key=_order):
        groups.setdefault(player if player in TEACHERS else re.sub(r"-\d", "", player), []).append(player)
    for number, (name, players) in enumerate(groups.items()):
        look = Series.number(number)
        means = [fmean(fmean(played.scores(Cell(player, cap))) for player in players) for cap in CAPS]
        label = name if len(players) == 1 else f"{name}, {len(players)} models"
        axes.plot(range(len(CAPS)), means, color=look.colour, marker=look.marker, linestyle=look.line, label=label)
        for player in players if len(players) > 1 else ():
            alone = [fmean(played.scores(Cell(player, cap))) for cap in CAPS]
            axes.plot(range(len(CAPS)), alone, color=look.colour, linestyle=look.line, linewidth=0.7)
    axes.set_xticks(range(len(CAPS)), ["none" if cap is None else f"{cap:,}" for cap in CAPS])
    axes.set_xlabel("cap on prompts, in budget tokens")
    axes.set_ylabel("mean score, of 50")
    pairs = {cap: (Cell("full-{}", cap), Cell("full-{}", None)) for cap in CAPS[:-1]}
    lost = {cap: _any_seed([_paired(played, _of_seed(pair, seed)) for seed in SEEDS]) for cap, pair in pairs.items()}
    shown = ", ".join(f"{cap:,}" for cap, each in lost.items() if each is not None and verdict(each) == "less")
    axes.set_title(f"Trained on full context: a loss is shown under {shown or 'no cap'}")
    axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.07))  # above the line of `random`
    return drawn


EXPERIMENT = Experiment(
    "learned",
    tables,
    lambda played: {"learned-curves": curves(played)},
    lambda: Played(HERE / "learned" / "episodes.csv"),
)
