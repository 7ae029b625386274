"""The rows of `experiments/learned.py`, and the tables and the figure that are made of them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from learned_cells import BANDIT, CAPS, GAME, SMALL, WAYS, Cell
from page_tables import publish as publish_table

import smartplay_tools as sp
from smartplay_tools.evaluation.analysis import MEASURES, MeanEstimate, mean_estimate
from smartplay_tools.evaluation.analysis.figures.style import Series, figure, panels, save_figure
from smartplay_tools.evaluation.analysis.intervals import mean_estimates
from smartplay_tools.evaluation.analysis.pairs import difference_sample, pairs
from smartplay_tools.evaluation.analysis.windows import jointly

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = Path(__file__).parents[1] / "docs" / "train-a-tiny-agent.md"
NUMBERS = ("trial", "seed", "steps", "turns", "illegal_actions", "malformed_calls", "idle_replies", "refused_notes")
ABOUT = ("game", "player", "cap", "way", "manual")
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
        "learned-differences": _differences(played, list(_comparisons(played))),
    }


def _matrix(played: Played, columns: Mapping[str, Mapping[str, Any]]) -> str:
    """A row for every player that has played all columns: mean, interval and number of failures."""
    every = [cell.player for cell in played.rows]
    players = [
        player
        for player in dict.fromkeys(every)
        if all(Cell(player, **column) in played.rows for column in columns.values())
    ]
    lines = [f"| played with | {' | '.join(columns)} |", f"|{' --- |' * (len(columns) + 1)}"]
    for player in sorted(players, key=_order):
        cells = [Cell(player, **column) for column in columns.values()]
        shown = (f"{_interval(mean_estimate(played.scores(cell)), '-')}, {played.failures(cell)}" for cell in cells)
        lines.append(f"| {player} | {' | '.join(shown)} |")
    return "\n".join(lines)


def _order(player: str) -> tuple[bool, bool, str]:
    """Scripted players stand first, then models, those of a regime together."""
    return bool(re.search(r"-\d", player)), player.endswith("-rewarded"), player


def long_table(played: Played) -> str:
    """Every cell as a line of CSV: mean, interval, median, failures, share of turns with a mistake."""
    written = io.StringIO()
    lines = csv.writer(written, lineterminator="\n")
    lines.writerow((*ABOUT, "worlds", "mean", "low", "high", "median", "failures", "mistakes"))
    for cell, rows in played.rows.items():
        scores = played.scores(cell)
        estimate = mean_estimate(scores)
        wrong = sum(row["illegal_actions"] + row["malformed_calls"] + row["idle_replies"] for row in rows)
        bounds = ("" if bound is None else f"{bound:.2f}" for bound in (estimate.low, estimate.high))
        figures = (f"{median(scores):g}", played.failures(cell), f"{wrong / sum(row['turns'] for row in rows):.4f}")
        about = (cell.cap or "" if name == "cap" else getattr(cell, name) for name in ABOUT)
        lines.writerow((*about, len(rows), f"{estimate.mean:.2f}", *bounds, *figures))
    return written.getvalue()


def _comparisons(played: Played) -> Iterator[tuple[Cell, Cell]]:
    """What is compared, as far as it was played."""
    small, full = CAPS[0], None
    models = [f"{regime}-{seed}" for regime in ("small", "full", "all") for seed in range(3)]
    wanted: list[tuple[Cell, Cell]] = []
    for player in ("rule", *models):
        wanted += [(Cell(player, small, game=game), Cell(player, full, game=game)) for game in (GAME, BANDIT)]
    for seed in range(3):
        wanted += [(Cell(f"small-{seed}", cap), Cell(f"full-{seed}", cap)) for cap in (small, full)]
    for player in models:
        wanted += [(Cell(f"{player}-rewarded", cap), Cell(player, cap)) for cap in (small, full)]
    for player in ("rule-notes", "tally", *(f"tally-notes-{seed}" for seed in range(3)), "tally-notes-0-rewarded"):
        wanted += [(Cell(player, SMALL, "notes"), Cell(player, SMALL))]
    wanted += [(Cell("tally-notes-0", SMALL, "notes"), Cell(player, SMALL)) for player in ("tally", "small-1")]
    wanted += [(Cell("tally-notes-0-rewarded", SMALL, "notes"), Cell("tally-notes-0", SMALL, "notes"))]
    wanted += [(Cell("tally-summary-0", SMALL, "summary"), Cell("tally", SMALL))]
    wanted += [(Cell("small-1", SMALL, way), Cell("small-1", SMALL)) for way in WAYS if way != "drop"]
    for player in ("rule", "small-1"):
        wanted += [(Cell(player, cap, manual="none"), Cell(player, cap)) for cap in (small, full)]
    yield from (pair for pair in wanted if all(cell in played.rows for cell in pair))


def _differences(played: Played, compared: Sequence[tuple[Cell, Cell]]) -> str:
    """Paired differences, whose intervals hold together in 95 of 100 such tables."""
    paired = [pairs(played.rows[cell], played.rows[other]) for cell, other in compared]
    samples = [difference_sample(each, MEASURES["score"]) for each in paired]
    estimates = mean_estimates(samples, jointly(len(samples)))
    lines = ["| this | less this | difference [95 %, all together] |", f"|{' --- |' * 3}"]
    for (cell, other), estimate in zip(compared, estimates, strict=True):
        lines.append(f"| {_name(cell)} | {_name(other)} | {_interval(estimate, '+')} |")
    return "\n".join(lines)


def _name(cell: Cell) -> str:
    cap = "no cap" if cell.cap is None else f"{cell.cap:,}"
    game = "bandit" if cell.game == BANDIT else ""
    way = "" if cell.way == "drop" else cell.way
    return ", ".join(filter(None, (cell.player, game, cap, way, "no manual" if cell.manual == "none" else "")))


def _interval(estimate: MeanEstimate, sign: str) -> str:
    if estimate.low is None or estimate.high is None:
        return f"{estimate.mean:{sign}.1f}"
    return f"{estimate.mean:{sign}.1f} [{estimate.low:{sign}.1f}, {estimate.high:{sign}.1f}]"


@figure
def curves(played: Played) -> Figure:
    """Draw mean score against the cap, a line for all models of a regime; no cap stands at the right."""
    drawn, [axes] = panels(1)
    groups: dict[str, list[str]] = {}
    for player in sorted((cell.player for cell in played.rows if cell == Cell(cell.player, None)), key=_order):
        groups.setdefault(re.sub(r"-\d", "", player), []).append(player)
    for number, (name, players) in enumerate(groups.items()):
        look = Series.number(number)
        means = [fmean(fmean(played.scores(Cell(player, cap))) for player in players) for cap in CAPS]
        label = name if len(players) == 1 else f"{name}, {len(players)} models"
        axes.plot(range(len(CAPS)), means, color=look.colour, marker=look.marker, linestyle=look.line, label=label)
    axes.set_xticks(range(len(CAPS)), ["none" if cap is None else f"{cap:,}" for cap in CAPS])
    axes.set_xlabel("cap on prompts, in budget tokens")
    axes.set_ylabel("mean score, of 50")
    axes.legend()
    return drawn


def publish(written: Mapping[str, str], played: Played) -> None:
    """Put the tables between their marks in the page and beside the rows, and draw the figure."""
    for name, table in written.items():
        publish_table(PAGE, name, table)
    played.path.with_name("cells.csv").write_text(long_table(played), encoding="utf-8", newline="")
    save_figure(curves(played), PAGE.parent / "figures" / "learned-curves", formats=["svg"])
