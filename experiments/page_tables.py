"""What the experiments share: published rows, tables of them in Markdown, and their places in the documentation.

The rows of an experiment are the file `rows.jsonl.xz` in the folder of its name; the pages have each table between
marks. `tables.py` makes all tables from the rows.
"""

from __future__ import annotations

import argparse
import json
import lzma
import re
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import smartplay_tools as sp
from smartplay_tools.errors import InvalidArgumentError
from smartplay_tools.evaluation.analysis.beside import EARLY, ends_of, grows
from smartplay_tools.evaluation.analysis.figures.style import save_figure
from smartplay_tools.evaluation.analysis.grouping import by_cell
from smartplay_tools.evaluation.analysis.pairs import MEASURES, Measure, sample
from smartplay_tools.evaluation.analysis.windows import WindowComparison, compare_windows
from smartplay_tools.evaluation.costs.tariffs import Tariff, charge_records
from smartplay_tools.evaluation.runs.plan import check_playable, make_cells
from smartplay_tools.evaluation.runs.runner import Run
from smartplay_tools.evaluation.runs.sweeps import Sweep
from smartplay_tools.records.rows import Row
from smartplay_tools.statistics.intervals import MeanEstimate, mean_estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent
DOCS = HERE.parent / "docs"
END = "<!-- end -->"

LEFT_OUT = ("versions", "deviations", "asked", "state_hash", "key")
"""What the tables do not need of a row."""

REPEAT = sp.GAMES["popgym-RepeatPreviousEasy-v0"]


def repeat_previous(k: int, decks: int = 1) -> str:
    """Register RepeatPrevious with this `k`, which needs k - 1 past steps; return its id."""
    steps = 52 * decks - 1
    facts: dict[str, Any] = {"kwargs": {"decks": decks, "k": k}, "memory": k - 1, "worst_step": -1 / (52 * decks - k)}
    facts |= {"history": steps, "rollout": steps}
    return sp.register(replace(REPEAT, id=f"RepeatPrevious{k}-v0", **facts)).id


@dataclass(frozen=True)
class Experiment:
    """The tables and the figures that pages show of rows."""

    name: str
    tables: Callable[[Any], Mapping[str, str]]
    """Makes the tables, in Markdown, by the names in their marks."""
    figures: Callable[[Any], Mapping[str, Figure]] = lambda _: {}
    """Draws the figures, by the names of their files."""
    read: Callable[[], Any] | None = None
    """Reads the published rows, if they are not in `rows.jsonl.xz`."""

    @property
    def path(self) -> Path:
        """The file of the published rows."""
        return HERE / self.name / "rows.jsonl.xz"

    def rows(self) -> Any:
        """Return the published rows."""
        return read_rows(self.path) if self.read is None else self.read()

    def publish(self) -> None:
        """Put tables and figures of the published rows into the documentation."""
        rows = self.rows()
        for name, written in self.tables(rows).items():
            publish(page_of(name), name, written)
        for name, drawn in self.figures(rows).items():
            save_figure(drawn, DOCS / "figures" / name, formats=["svg"])
            path = DOCS / "figures" / f"{name}.svg"
            path.write_text(_compact(path.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")

    def conclude(self, rows: Iterable[Row], *, publishes: bool) -> None:
        """Print the tables of rows that were played; if they are to be published, write them and what pages show."""
        played = list(rows)
        for written in self.tables(played).values():
            print(written, "\n", flush=True)
        if publishes:
            write_rows(played, self.path)
            self.publish()


def write_rows(rows: Iterable[Row], path: Path) -> None:
    """Write rows as JSON Lines, compressed, without what only their records need."""
    lines = [json.dumps({name: row[name] for name in row if name not in LEFT_OUT}) for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(lzma.compress("".join(f"{line}\n" for line in lines).encode(), preset=9))


def read_rows(path: Path) -> list[Row]:
    """Read rows."""
    return [json.loads(line) for line in lzma.decompress(path.read_bytes()).splitlines()]


def priced(rows: Iterable[Row], records: Mapping[str, Path], tariffs: Sequence[Tariff]) -> Iterator[Row]:
    """Yield rows with what only their records say: the cost of the episode under each rule of caches."""
    charged = charge_records(records, tariffs)
    for row in rows:
        charge = charged[row["key"]]
        yield {**row, "costs": [] if charge is None else [round(each.cost, 1) for each in charge]}


def records_of(run: Run) -> dict[str, Path]:
    """Return the records of a run's episodes by their keys."""
    return {row["key"]: run.transcript(row["key"]) for row in run.rows}


def mark(name: str) -> str:
    """Return the line that begins the table of a name."""
    return f"<!-- table: {name} -->\n"


def page_of(name: str) -> Path:
    """Return the page that has a place for a table; ValueError if none has."""
    for page in sorted(DOCS.glob("*.md")):
        if mark(name) in page.read_text(encoding="utf-8"):
            return page
    raise ValueError(f"No page has a place for the table {name}: a line {mark(name)!r} and, below it, {END!r}.")


def publish(page: Path, name: str, written: str) -> None:
    """Put a table between its marks in a page; ValueError if the page does not have them."""
    before, marked, rest = page.read_text(encoding="utf-8").partition(mark(name))
    _, end, after = rest.partition(END)
    if not end:
        raise ValueError(f"{page} has no place for the table {name}: a line {mark(name)!r} and, below it, {END!r}.")
    page.write_text(f"{before}{marked}\n{written}\n\n{end}{after}", encoding="utf-8")


def _compact(drawing: str) -> str:
    """A drawing with two decimals and without indentation: a repository keeps every version of it.

    Numbers below 1 keep theirs, since they are the scales of letters.
    """
    return re.sub(r"\n +", "\n", re.sub(r"([1-9]\d*\.\d\d)\d+", r"\1", drawing))


def table_row(cells: Iterable[str]) -> str:
    """Return a line of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def markdown_table(headings: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join(map(table_row, [headings, ["---"] * len(headings), *rows]))


@dataclass(frozen=True)
class Line:
    """A cell in a table: its comparison with the reference of its family, and its rows."""

    compared: WindowComparison
    rows: Sequence[Row]

    def mean(self, figure: Callable[[Row], float], digits: int = 0) -> str:
        """Return the mean of a figure of its episodes."""
        return f"{fmean(map(figure, self.rows)):,.{digits}f}"


Column = tuple[str, Callable[[Line], str]]
"""A heading, and what it shows of a cell."""


def comparison_table(
    rows: Sequence[Row], along: Sequence[str], columns: Sequence[Column], without: Container[str] = ()
) -> str:
    """Return a table in Markdown with a line for each cell, but those of the players `without`.

    Cells are compared with the widest of those that differ in the fields `along` of the budget alone.
    """
    lines = ([show(line) for _, show in columns] for line in compared_lines(rows, along, without))
    return markdown_table([heading for heading, _ in columns], lines)


def table_across(
    rows: Sequence[Row],
    along: Sequence[str],
    columns: Sequence[Column],
    across: Callable[[Line], str],
    shown: Sequence[Column],
    without: Container[str] = (),
) -> str:
    """Return the same with what is `shown` of a cell in columns of its own for each value `across`: its cap, say.

    Lines that differ in the last of the `columns` alone are one.
    """
    values: dict[str, None] = {}
    places: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for line in compared_lines(rows, along, without):
        values[across(line)] = None
        place = places.setdefault(tuple(show(line) for _, show in columns), {})
        place[across(line)] = [show(line) for _, show in shown]
    headings = [*(heading for heading, _ in columns), *(f"{value}: {name}" for value in values for name, _ in shown)]
    blank = [""] * len(shown)
    merged: dict[tuple[str, ...], list[str]] = {}
    for (*place, name), cells in places.items():
        shown_cells = (*place, *(cell for value in values for cell in cells.get(value, blank)))
        merged.setdefault(shown_cells, []).append(name)
    at = len(columns) - 1
    return markdown_table(headings, ([*row[:at], "; ".join(names), *row[at:]] for row, names in merged.items()))


def compared_lines(rows: Sequence[Row], along: Sequence[str], without: Container[str] = ()) -> list[Line]:
    """Return the cells of rows with their comparisons, without those of some players."""
    members = {cell.key(): own for cell, own in by_cell(rows)}
    return [
        Line(compared, members[compared.cell.key()])
        for compared in compare_windows(rows, along=along)
        if compared.cell.player not in without
    ]


GAME: Column = "game", lambda line: f"`{line.compared.cell.game}`"
PLAYER: Column = "player", lambda line: line.compared.cell.player
EPISODES: Column = "episodes", lambda line: str(line.compared.episodes)
SCORE: Column = "score [95 %]", lambda line: interval(line.compared.means["score"]) + in_steps(line.rows)
TOKENS: Column = "tokens an episode", lambda line: f"{line.compared.means['tokens'].mean:,.0f}"
STABLE: Column = "prefix-stable", lambda line: f"{100 * line.compared.means['prefix_share'].mean:.1f} %"


def difference(show: Callable[[WindowComparison], str]) -> Callable[[Line], str]:
    """Return a column's difference to the reference: "reference", "identical" play, or what `show` returns."""

    def shown(line: Line) -> str:
        each = line.compared
        return "reference" if each.is_reference else "identical" if each.is_identical else show(each)

    return shown


TOGETHER: Column = "less dropping [95 %, all together]", difference(lambda each: interval(each.together, "+"))


def score_or(shown: Callable[[Line], str]) -> Callable[[Line], str]:
    """Return a column's score for the cell that others are compared with, and what `shown` returns for the others."""
    return lambda line: SCORE[1](line) if line.compared.is_reference else shown(line) + in_steps(line.rows)


def in_steps(rows: Sequence[Row]) -> str:
    """Return what stands beside a score: a mark of early ends, and the steps where the score counts them as well."""
    early = EARLY * bool(ends_of(rows))
    counts = early or any(grows(row["game"]) and row["steps"] != sp.GAMES[row["game"]].rollout for row in rows)
    return f"{early} in {fmean(row['steps'] for row in rows):,.0f} steps" if counts else ""


def score_of(rows: Sequence[Row]) -> str:
    """Return the mean score of a cell's episodes with its interval, a mark of early ends, and steps that it counts."""
    return interval(mean_score(rows)) + in_steps(rows)


def mean_score(rows: Sequence[Row]) -> MeanEstimate:
    """Return the mean score of a cell's episodes with its interval."""
    scores = sample(rows, MEASURES["score"])
    return mean_estimate(scores.values, scores.bounds)


def mean_of(rows: Sequence[Row], measure: Measure) -> float:
    """Return the mean of a measure of episodes."""
    return fmean(sample(rows, measure).values)


def control_line(control: str, pairs: Sequence[float]) -> str:
    """Return how often a control, which no window may change, scores differently, seed by seed."""
    return f"The control, {control}: {len(pairs):,} pairs, of which {sum(map(bool, pairs))} differ in score."


def verdict(estimate: MeanEstimate) -> str:
    """Return whether an interval says more, or less, than 0, or nothing."""
    low, high = estimate.low or 0, estimate.high or 0
    return "undecided" if low <= 0 <= high else "more" if low > 0 else "less"


def outcome(estimate: MeanEstimate, *, better: bool) -> str:
    """Return what an interval says about the claim that a difference is more than 0, or less."""
    said = verdict(estimate)
    return said if said == "undecided" else "confirmed" if (said == "more") == better else "contradicted"


def interval(estimate: MeanEstimate | None, sign: str = "-") -> str:
    """Return a mean with its interval; without one, whether all its episodes were equal.

    A difference, whose `sign` is "+", that is the same in all pairs has the p value of the sign test instead, or is
    said to be equal.
    """
    if estimate is None:
        return "no pairs"
    digits = ",.0f" if max(abs(estimate.mean), abs(estimate.high or 0)) >= 100 else ",.2f"
    mean = f"{estimate.mean:{sign}{digits}}"
    if sign == "+" and estimate.sign_p is not None:
        return f"{mean} in all {estimate.episodes}, p {estimate.sign_p:.1g}"
    if sign == "+" and estimate.is_zero:
        return f"equal in all {estimate.episodes}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{estimate.low:{sign}{digits}}, {estimate.high:{sign}{digits}}]"


def arguments(description: str | None, out: str | None = None, *, publishes: bool = True) -> argparse.ArgumentParser:
    """Return a parser of what experiments take: the folder of their runs, if they have one, and whether to publish."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    if out is not None:
        parser.add_argument("--out", type=Path, default=Path(out), help="the folder of the runs")
    if publishes:
        parser.add_argument("--publish", action="store_true", help="put rows, tables and figures into the checkout")
    return parser


def player_options(parser: argparse.ArgumentParser) -> None:
    """Add who plays, instead of the players of the experiment, and how many episodes at a time."""
    parser.add_argument("--player", action="append", help="play with this player instead; repeatable")
    parser.add_argument("--workers", type=int, help="episodes at a time; one for every processor by default")


def complete(*arguments: Any, **options: Any) -> Run:
    """Play a run as `evaluate` does, or leave if some of its episodes have no result."""
    done = sp.evaluate(*arguments, **options)
    check_finished(done, done.folder.path)
    return done


def check_finished(done: Run | Sweep, folder: Path) -> None:
    """Leave if some episodes of what was played have no result."""
    if not done.complete:
        left = done.planned - len(done.rows)
        sys.exit(f"{left} episodes of {folder} are not finished; run the command again.")


def is_playable(game: str, budget: sp.Budget, player: str) -> bool:
    """Return whether the head of the prompts and the reserve leave room under a budget."""
    try:
        check_playable(*make_cells([game], [player], [budget]))
    except InvalidArgumentError:
        return False
    return True
